//! The ranking: which effects matter in a scene, in the order of what they change.
//!
//! One rule for effects that depend on each other: an effect is as important as the most important one
//! that needs it. Viscosity is thus never dispensable where turbulence, which needs it, matters.

use std::collections::HashMap;

use case::Scene;

use super::estimate::{Assessment, Estimate, Scope, WORTH};
use super::table::{Entry, TABLE};

/// How much an effect matters, in descending order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// The estimated change is of the order of a per cent or more.
    Matters,
    /// The estimated change is below that, but not with certainty.
    MayMatter,
    /// The largest change that the estimate allows is below that.
    Negligible,
}

impl Verdict {
    fn of(e: &Estimate) -> Self {
        if e.size() >= WORTH {
            Self::Matters
        } else if e.most() >= WORTH {
            Self::MayMatter
        } else {
            Self::Negligible
        }
    }
}

/// An effect that was assessed.
pub struct Ranked {
    /// Its row of the table.
    pub entry: &'static Entry,
    /// Whether the scene has it.
    pub on: bool,
    /// What it changes.
    pub estimate: Estimate,
    /// How much it matters, by itself and for what needs it.
    pub verdict: Verdict,
    /// Key of the effect that needs it and gives it its verdict.
    pub by: Option<&'static str>,
    /// Why the scene cannot simply be changed as the advice would have it.
    pub obstacle: Option<String>,
}

impl Ranked {
    /// What to do, in a few words.
    pub fn advice(&self) -> &'static str {
        match (self.on, self.verdict) {
            (true, Verdict::Negligible) if self.obstacle.is_some() => "required by the scene",
            (true, Verdict::Matters) => "needed",
            (true, Verdict::MayMatter) => "keep",
            (true, Verdict::Negligible) => "may be left out",
            (false, Verdict::Matters) => "missing",
            (false, Verdict::MayMatter) => "may be missing",
            (false, Verdict::Negligible) => "not needed",
        }
    }
}

/// An effect without estimate, and why.
pub struct Unknown {
    /// Its row of the table.
    pub entry: &'static Entry,
    /// Whether the scene has it.
    pub on: bool,
    /// The reason.
    pub why: String,
}

/// All effects of a scene: in the order of what they change, then those without estimate.
pub struct Ranking {
    /// Assessed, the most important first; effects that are judged together stand together.
    pub ranked: Vec<Ranked>,
    /// Not assessed.
    pub unknown: Vec<Unknown>,
}

impl Ranking {
    /// Of a scene.
    pub fn new(scope: &Scope<'_>) -> Self {
        let scene = scope.scene();
        let (mut ranked, mut unknown) = (Vec::new(), Vec::new());
        for entry in TABLE.iter().filter(|e| shown(e, scene)) {
            let on = (entry.on)(scene);
            match (entry.assess)(scope) {
                Assessment::Estimated(estimate) => {
                    let verdict = Verdict::of(&estimate);
                    ranked.push(Ranked { entry, on, estimate, verdict, by: None, obstacle: None });
                }
                Assessment::NotAssessed(why) => unknown.push(Unknown { entry, on, why }),
            }
        }
        together(&mut ranked);
        sort(&mut ranked);
        for r in &mut ranked {
            r.obstacle = obstacle(r, scene);
        }
        Self { ranked, unknown }
    }

    /// The row of a key.
    pub fn find(&self, key: &str) -> Option<&Ranked> {
        self.ranked.iter().find(|r| r.entry.key == key)
    }
}

/// The models of turbulence are one effect: the one that a scene has, or the general one.
fn shown(e: &Entry, scene: &Scene) -> bool {
    const GENERAL: &str = "flow.viscosity.turbulence";
    let on = (e.on)(scene);
    let special = |e: &Entry| e.key.strip_prefix(GENERAL).is_some_and(|rest| rest.starts_with('.'));
    if special(e) {
        on
    } else if e.key == GENERAL {
        !TABLE.iter().any(|o| special(o) && (o.on)(scene))
    } else {
        true
    }
}

/// Gives each effect the verdict of the most important one that needs it.
fn together(ranked: &mut [Ranked]) {
    // A chain of needs is no longer than the list.
    for _ in 0..ranked.len() {
        let asked: Vec<(&str, Verdict, &'static str)> =
            ranked.iter().filter_map(|r| Some((r.entry.needs?, r.verdict, r.entry.key))).collect();
        let mut changed = false;
        for r in ranked.iter_mut() {
            for (key, verdict, by) in &asked {
                if *key == r.entry.key && *verdict < r.verdict {
                    (r.verdict, r.by) = (*verdict, Some(*by));
                    changed = true;
                }
            }
        }
        if !changed {
            break;
        }
    }
}

/// By verdict, then by the largest change that an effect, or one that is judged with it, is estimated to make.
fn sort(ranked: &mut [Ranked]) {
    let root = |r: &Ranked| r.entry.needs.unwrap_or(r.entry.key);
    let mut sizes: HashMap<&str, (Verdict, f64)> = HashMap::new();
    for r in ranked.iter() {
        let family = sizes.entry(root(r)).or_insert((r.verdict, 0.0));
        *family = (family.0.min(r.verdict), family.1.max(r.estimate.size()));
    }
    ranked.sort_by(|a, b| {
        let family = |r: &Ranked| sizes[root(r)];
        a.verdict
            .cmp(&b.verdict)
            .then(family(b).1.total_cmp(&family(a).1))
            .then(root(a).cmp(root(b)))
            .then(a.entry.needs.is_some().cmp(&b.entry.needs.is_some()))
    });
}

/// Why the change that the advice means is refused by the scene, if it is.
fn obstacle(r: &Ranked, scene: &Scene) -> Option<String> {
    let change = match (r.on, r.verdict) {
        (false, Verdict::Matters | Verdict::MayMatter) => r.entry.with?,
        (true, Verdict::Negligible) => r.entry.without?,
        _ => return None,
    };
    let mut changed = scene.clone();
    change(&mut changed);
    refused(&changed)
}

/// What is wrong with a scene that was changed in memory: the first problem with its remedy.
pub fn refused(scene: &Scene) -> Option<String> {
    let text = match toml::to_string(scene) {
        Ok(text) => text,
        Err(error) => return Some(error.to_string()),
    };
    let error = case::parse(std::path::Path::new("/scene.toml"), &text).err()?;
    Some(error.problems.first().map_or_else(|| error.to_string(), |p| format!("{}: {}", p.what, p.help)))
}
