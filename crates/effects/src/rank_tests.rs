//! The ranking contradicts itself in no kept scene and in none at random.

use std::path::{Path, PathBuf};

use case::{Canopy, Scene};
use coupling::interface::CanopyInterface;
use proptest::prelude::*;

use super::rank::{Ranked, Ranking, Verdict, refused};
use super::table::entry;
use super::*;
use crate::estimate::Scope;
use crate::numbers::Numbers;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

/// A canopy, built once for all variants of a scene.
struct Built(CanopyInterface, mesh::StructureMesh);

impl Built {
    fn of(scene: &Scene) -> Self {
        Self(CanopyInterface::new(scene).expect("a canopy"), mesh::structure_mesh(scene).expect("a mesh"))
    }

    fn ranked<T>(&self, scene: &Scene, see: impl FnOnce(Ranking) -> T) -> T {
        let n = Numbers::new(scene, &self.0, &self.1);
        see(Ranking::new(&Scope::new(&n, scene.stages.len() - 1, None)))
    }
}

/// Everything that a reader of the ranking may rely on.
fn consistent(name: &str, scene: &Scene) {
    let built = Built::of(scene);
    built.ranked(scene, |all| {
        figures(name, &all);
        order(name, &all);
        needs(name, &all);
        let advice: Vec<(&str, bool, Verdict)> = all
            .ranked
            .iter()
            .filter(|r| r.obstacle.is_none())
            .map(|r| (r.entry.key, r.on, r.verdict))
            .collect();
        follow(name, scene, &built, &advice);
    });
}

/// Whether all figures of a sentence are numbers.
fn sound(text: &str) -> bool {
    text.split(|c: char| !c.is_ascii_alphanumeric()).all(|word| word != "NaN" && word != "inf")
}

fn figures(name: &str, all: &Ranking) {
    let keys: Vec<&str> =
        all.ranked.iter().map(|r| r.entry.key).chain(all.unknown.iter().map(|u| u.entry.key)).collect();
    for e in TABLE.iter().filter(|e| !e.key.starts_with("flow.viscosity.turbulence")) {
        assert_eq!(keys.iter().filter(|k| **k == e.key).count(), 1, "{name}: {}", e.key);
    }
    let models = keys.iter().filter(|k| k.starts_with("flow.viscosity.turbulence")).count();
    assert_eq!(models, 1, "{name}: models of turbulence are one effect");
    for u in &all.unknown {
        assert!(!u.why.is_empty() && sound(&u.why), "{name}: {}", u.why);
    }
    for r in &all.ranked {
        let e = &r.estimate;
        assert!(e.factor >= 1.0 && sound(&e.why), "{name}: {}", e.why);
        assert!(e.changes.iter().any(Option::is_some), "{name}: {}", r.entry.key);
        for a in e.changes.iter().flatten() {
            assert!(a.value.is_finite() && a.most().is_finite(), "{name}: {} {a:?}", r.entry.key);
            assert!(a.range[0] <= a.value && a.value <= a.range[1], "{name}: {} {a:?}", r.entry.key);
        }
    }
}

/// The verdicts fall along the list, and within a verdict the estimated change.
fn order(name: &str, all: &Ranking) {
    let family = |r: &Ranked| {
        let root = r.entry.needs.unwrap_or(r.entry.key);
        let members = all.ranked.iter().filter(|m| m.entry.needs.unwrap_or(m.entry.key) == root);
        members.map(|m| m.estimate.size()).fold(0.0, f64::max)
    };
    for pair in all.ranked.windows(2) {
        let [a, b] = [&pair[0], &pair[1]];
        assert!(a.verdict <= b.verdict, "{name}: {} before {}", a.entry.key, b.entry.key);
        if a.verdict == b.verdict {
            assert!(family(a) >= family(b), "{name}: {} before {}", a.entry.key, b.entry.key);
        }
    }
}

/// What an effect needs is at least as important as the effect.
fn needs(name: &str, all: &Ranking) {
    for r in &all.ranked {
        let Some(need) = r.entry.needs else { continue };
        assert!(entry(need).is_some(), "{need}");
        if let Some(n) = all.find(need) {
            assert!(n.verdict <= r.verdict, "{name}: {need} is judged below {}", r.entry.key);
        }
    }
}

/// A scene changed as the advice says is a scene, and its own advice does not take the change back.
fn follow(name: &str, scene: &Scene, built: &Built, advice: &[(&str, bool, Verdict)]) {
    let mut without = scene.clone();
    let mut left_out = Vec::new();
    for (key, on, verdict) in advice {
        let e = entry(key).expect("a row");
        let mut changed = scene.clone();
        match (on, verdict) {
            (true, Verdict::Negligible) => {
                let Some(change) = e.without else { continue };
                change(&mut without);
                change(&mut changed);
                left_out.push(*key);
            }
            (false, Verdict::Matters) => {
                let Some(change) = e.with else { continue };
                change(&mut changed);
            }
            _ => continue,
        }
        assert_eq!(refused(&changed), None, "{name}: {key}");
        built.ranked(&changed, |all| {
            if let Some(r) = all.find(key) {
                let turned =
                    matches!((on, r.verdict), (true, Verdict::Matters) | (false, Verdict::Negligible));
                assert!(!turned, "{name}: the advice on {key} is taken back once it is followed");
            }
        });
    }
    assert_eq!(refused(&without), None, "{name}: without {left_out:?}");
}

/// All scenes of the repository.
fn kept() -> Vec<PathBuf> {
    let mut folders: Vec<PathBuf> = ["cases", "studies", "tests"].iter().map(|f| root().join(f)).collect();
    let mut found = Vec::new();
    while let Some(folder) = folders.pop() {
        for e in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            if e.path().is_dir() {
                folders.push(e.path());
            } else if e.path().extension().is_some_and(|x| x == "toml") && case::load(&e.path()).is_ok() {
                found.push(e.path());
            }
        }
    }
    found.sort();
    found
}

#[test]
fn no_kept_scene_is_judged_with_a_contradiction() {
    let scenes = kept();
    assert!(scenes.len() >= 25, "{}", scenes.len());
    for file in scenes {
        let scene = case::load(&file).expect("a scene");
        consistent(&file.display().to_string(), &scene);
    }
}

/// `square-drop` with other sizes and with the effects whose bits are set; `None`: such a scene is refused.
fn random(bits: u32, width: f64, speed: f64, mass: f64, viscosity: f64, pressure: f64) -> Option<Scene> {
    let bit = |k: u32| (bits >> k) & 1 == 1;
    let mut scene = case::load(&root().join("cases/square-drop/scene.toml")).expect("a scene");
    match &mut scene.canopy {
        Canopy::Square(f) => {
            (f.width_m, f.line_length_m, f.cells_across, f.line_count) = (width, 1.2 * width, 4, 8)
        }
        _ => return None,
    }
    if bit(0)
        && let Canopy::Square(f) = scene.canopy.clone()
    {
        scene.canopy = Canopy::Circular(f);
    }
    let descent = scene.descent.as_mut()?;
    (descent.initial_speed_m_s, descent.payload_mass_kg) = (speed, mass);
    scene.stages[0].pressure_pa = Some(pressure);
    scene.fabric.wrinkling = bit(1);
    let keys = [
        (2, "fabric.permeability"),
        (3, "fabric_gravity"),
        (4, "lines.drag"),
        (5, "descent.payload_drag"),
        (6, "flow.viscosity"),
        (7, "flow.energy"),
        (8, "flow.limiter"),
        (9, "flow.viscosity.turbulence"),
    ];
    for (k, key) in keys {
        if bit(k) {
            (entry(key)?.with?)(&mut scene);
        }
    }
    let flow = scene.flow.as_mut()?;
    if let Some(v) = &mut flow.viscosity {
        v.dynamic_viscosity_pa_s = viscosity;
        if bit(10) && v.turbulence.is_some() {
            v.turbulence =
                Some(if bit(11) { case::Turbulence::Ddes } else { case::Turbulence::SpalartAllmaras });
        }
    }
    if bit(12) {
        flow.wind_m_s = [0.3 * speed, 0.0, 0.0];
    }
    if bit(13) {
        scene.fabric.orthotropic =
            Some(case::Orthotropic { youngs_modulus_2_pa: 1e8, shear_modulus_pa: 3e7, direction: None });
    }
    if bit(14) && scene.fabric_gravity.is_some() {
        scene.descent.as_mut()?.body = Some(case::PayloadBody {
            inertia_kg_m2: [0.1; 3],
            attachments_m: vec![[0.0, 0.0, 0.2]],
            initial_velocity_m_s: [0.0; 3],
            initial_spin_rad_s: [0.0; 3],
            initial_rotation_deg: [0.0; 3],
        });
    }
    if bit(15) {
        scene.stages.truncate(1 + usize::from(bit(16)));
    }
    refused(&scene).is_none().then_some(scene)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn no_random_scene_is_judged_with_a_contradiction(
        bits in 0u32..1 << 17,
        width in 0.3..30.0f64,
        log_speed in -1.0..2.0f64,
        log_mass in -1.0..3.5f64,
        log_viscosity in -5.0..-0.5f64,
        log_pressure in -0.5..3.0f64,
    ) {
        let ten = |x: f64| 10f64.powf(x);
        if let Some(scene) = random(bits, width, ten(log_speed), ten(log_mass), ten(log_viscosity), ten(log_pressure)) {
            consistent(&format!("{bits:b}"), &scene);
        }
    }
}

/// Turbulence needs viscosity: where the one matters the other is not dispensable, on or off.
#[test]
fn viscosity_is_judged_with_turbulence() {
    for (turbulent, name) in [(false, "laminar"), (true, "turbulent")] {
        let mut scene = case::load(&root().join("cases/atps-descent/scene.toml")).expect("a scene");
        let key = if turbulent { "flow.viscosity.turbulence" } else { "flow.viscosity" };
        (entry(key).expect("a row").with.expect("defaults"))(&mut scene);
        Built::of(&scene).ranked(&scene, |all| {
            let [v, t] =
                ["flow.viscosity", "flow.viscosity.turbulence"].map(|k| all.find(k).expect("judged"));
            assert!(v.verdict <= t.verdict, "{name}");
            assert_eq!(v.by, Some("flow.viscosity.turbulence"), "{name}");
            assert_ne!(v.advice(), "may be left out", "{name}");
        });
    }
}
