//! What changes at once where one stage hands over to the next.

use std::fmt;

use crate::{BodyMotion, Motion, NodeMotion, Role, Scene, Stage, StageKind, StageTimes};

/// Change of the wind, as a share of the speed of the stream, that the flow takes without notice: it changes
/// the dynamic pressure by 0.2 %.
const WIND_SHARE: f64 = 1e-3;
/// Stream in still air, m/s: what the share of a smaller one is taken of.
const SLOW: f64 = 0.1;
/// Round-off of clocks, s, places, m, and velocities, m/s: far below what any solver resolves.
const ROUND_OFF: f64 = 1e-9;

/// A quantity that changes at once at the start of a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Jump {
    /// Stage at whose start it changes, from 0.
    pub stage: usize,
    /// What the scene calls it: `wind`, `gust`, `motion`, `body_motion` or `force`.
    pub key: &'static str,
    /// Size of the change, in [`Jump::unit`].
    pub size: f64,
    /// `m/s`, `rad/s`, `m` or `N`.
    pub unit: &'static str,
    /// What changes, from what to what, between which stages.
    pub what: String,
    /// What avoids it.
    pub remedy: String,
}

impl fmt::Display for Jump {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: a jump of {:.3} {}", self.what, self.size, self.unit)
    }
}

/// All jumps at the boundaries of the scene's stages, which take as long as `times` says.
pub fn jumps(scene: &Scene, times: &StageTimes) -> Vec<Jump> {
    let mut all = Vec::new();
    for stage in 0..scene.stages.len() {
        all.extend(wind(scene, stage, times));
        motions(scene, stage, times, &mut all);
        bodies(scene, stage, &mut all);
        forces(scene, stage, &mut all);
    }
    all
}

fn length(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn shown(v: [f64; 3]) -> String {
    format!("[{:.3}, {:.3}, {:.3}]", v[0], v[1], v[2])
}

/// The wind at the end of the last stage with the flow and at the start of `stage`.
fn wind(scene: &Scene, stage: usize, times: &StageTimes) -> Option<Jump> {
    let this = &scene.stages[stage];
    if !this.kind.roles().contains(&Role::Flow) {
        return None;
    }
    let before = &scene.stages[scene.source_stage(stage, Role::Flow)?];
    let wind = scene.wind(stage, times);
    let (end, start) = wind.start()?;
    let size = length(difference(start, end));
    let stream = length(difference(end, scene.resolved().initial_velocity_m_s)).max(SLOW);
    if size <= WIND_SHARE * stream {
        return None;
    }
    let steady = length(difference(wind.steady(), scene_steady(scene, stage, times)));
    let changed = steady > WIND_SHARE * stream;
    let key = if changed { "wind" } else { "gust" };
    let remedy = if changed {
        let ramp = if this.in_time() { "`ramp_s` in" } else { "a stage that runs in time with `ramp_s` in" };
        format!("change the wind over a time, by {ramp} the [stage.wind] of stage `{}`", this.name)
    } else {
        "let the gust end within its stage, or write it once, as [flow.gust], whose clock runs through all \
         stages from the release (clock = \"run\": from the start of the run)"
            .to_owned()
    };
    let what = format!(
        "the wind changes from {} m/s at the end of stage `{}` to {} m/s at the start of stage `{}`",
        shown(end),
        before.name,
        shown(start),
        this.name
    );
    Some(Jump { stage, key, size, unit: "m/s", what, remedy })
}

/// Steady wind at the end of the last stage with the flow before `stage`.
fn scene_steady(scene: &Scene, stage: usize, times: &StageTimes) -> [f64; 3] {
    let before = scene.source_stage(stage, Role::Flow);
    before.map_or([0.0; 3], |b| scene.wind(b, times).steady())
}

fn same_nodes(a: &Motion, b: &Motion) -> bool {
    (&a.nodes, a.at_m) == (&b.nodes, b.at_m)
}

fn selection(nodes: &Option<String>, at_m: Option<[f64; 3]>) -> String {
    match (nodes, at_m) {
        (Some(name), _) => format!("nodes `{name}`"),
        (None, Some(at)) => format!("the node at {} m", shown(at)),
        (None, None) => "no nodes".into(),
    }
}

/// Rates just after (`forward`) or just before `t` of what the motion moves: displacement, m/s, and angle, rad/s.
fn rates(m: &Motion, of: &NodeMotion, t: f64, forward: bool) -> ([f64; 3], f64) {
    let (v, rate) = of.rates(t, forward);
    (of_components(m, v), rate)
}

fn of_components(m: &Motion, v: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| if m.components.contains(['x', 'y', 'z'][i]) { v[i] } else { 0.0 })
}

/// Rates of the nodes of `m` at the end of the stage before `stage`, as [`rates`]; `None` where they are free in it.
fn rates_before(scene: &Scene, stage: usize, m: &Motion, times: &StageTimes) -> Option<([f64; 3], f64)> {
    let k = stage.checked_sub(1)?;
    let before = &scene.stages[k];
    let held = m.nodes.as_deref() == Some("held") || !before.kind.roles().contains(&Role::Structure);
    match before.motions.iter().find(|b| same_nodes(b, m)) {
        _ if !before.in_time() => Some(Default::default()),
        Some(b) => Some(rates(b, &b.in_stage(scene, k, times).ok()?, times.of(k), false)),
        None => held.then_some(Default::default()),
    }
}

/// Places and velocities of nodes that move as prescribed.
fn motions(scene: &Scene, stage: usize, times: &StageTimes, all: &mut Vec<Jump>) {
    let this = &scene.stages[stage];
    if !this.in_time() {
        return;
    }
    for m in &this.motions {
        let Ok(of) = m.in_stage(scene, stage, times) else { continue };
        let (nodes, name, start) = (selection(&m.nodes, m.at_m), &this.name, of.at(0.0));
        let place = length(of_components(m, start.displacement));
        let mut jump = |size: f64, unit, what: String, remedy: &str| {
            all.push(Jump { stage, key: "motion", size, unit, what, remedy: remedy.into() });
        };
        if place > ROUND_OFF {
            let what = format!("{nodes} are displaced at the start of stage `{name}`");
            jump(place, "m", what, "begin the table with a displacement of zero at time 0");
        }
        if start.angle.abs() > ROUND_OFF {
            let what = format!("{nodes} are turned at the start of stage `{name}`");
            jump(start.angle.abs(), "rad", what, "begin with an angle of zero at time 0");
        }
        let Some(before) = rates_before(scene, stage, m, times) else { continue };
        let after = rates(m, &of, 0.0, true);
        let between = |from: String, to: String| {
            let before = &scene.stages[stage - 1].name;
            format!(
                "changes from {from} at the end of stage `{before}` to {to} at the start of stage `{name}`"
            )
        };
        let size = length(difference(after.0, before.0));
        if size > ROUND_OFF {
            let change = between(format!("{} m/s", shown(before.0)), format!("{} m/s", shown(after.0)));
            let remedy = "begin the table with intervals in which the velocity grows from that of the stage \
                          before, or let the table of the stage before end at rest";
            jump(size, "m/s", format!("the velocity of {nodes} {change}"), remedy);
        }
        let size = (after.1 - before.1).abs();
        if size > ROUND_OFF.max(BODY_SHARE * of.largest_rate(this.windows(), this.window_s)) {
            let change = between(format!("{:.3} rad/s", before.1), format!("{:.3} rad/s", after.1));
            let remedy = "begin with an angle whose rate is that at the end of the stage before, as \"0.1*(1 - cos(t))\" after rest";
            jump(size, "rad/s", format!("the angular velocity of {nodes} {change}"), remedy);
        }
    }
    ended_motions(scene, stage, times, all);
}

/// Motions of the stage before that stop at once because `stage` holds their nodes.
fn ended_motions(scene: &Scene, stage: usize, times: &StageTimes, all: &mut Vec<Jump>) {
    let this = &scene.stages[stage];
    let Some(k) = stage.checked_sub(1).filter(|k| scene.stages[*k].in_time()) else { return };
    let rigid = !this.kind.roles().contains(&Role::Structure);
    for b in &scene.stages[k].motions {
        let held = rigid || b.nodes.as_deref() == Some("held");
        let Ok(of) = b.in_stage(scene, k, times) else { continue };
        let (v, rate) = rates(b, &of, times.of(k), false);
        let (speed, unit) = if rate == 0.0 { (length(v), "m/s") } else { (rate.abs(), "rad/s") };
        if held && speed > ROUND_OFF && !this.motions.iter().any(|m| same_nodes(m, b)) {
            all.push(Jump {
                stage,
                key: "motion",
                size: speed,
                unit,
                what: format!(
                    "{} move at the end of stage `{}` and are held from the start of stage `{}`",
                    selection(&b.nodes, b.at_m),
                    scene.stages[k].name,
                    this.name
                ),
                remedy:
                    "let the table of the stage before end with intervals in which the velocity falls to \
                         zero"
                        .into(),
            });
        }
    }
}

/// Share of the largest speed of a body below which a change of its velocity counts as none.
const BODY_SHARE: f64 = 1e-3;

/// Velocities of rigid bodies at the start of a stage that follows one with the flow.
fn bodies(scene: &Scene, stage: usize, all: &mut Vec<Jump>) {
    let this = &scene.stages[stage];
    let flows = |s: &&Stage| s.kind.roles().contains(&Role::Flow);
    let Some(before) = stage.checked_sub(1).map(|k| &scene.stages[k]).filter(flows) else { return };
    let velocity = |s: &Stage, m: &BodyMotion, from: f64, to: f64| -> Option<[f64; 4]> {
        let m = m.compiled().ok().filter(|_| s.in_time())?;
        let (a, b) = (m.at(from), m.at(to));
        let d = difference(b.displacement, a.displacement);
        Some([d[0], d[1], d[2], b.angle - a.angle].map(|d| d / (to - from)))
    };
    for m in &this.body_motions {
        let short = 1e-4 * this.window_s;
        let Some(after) = velocity(this, m, 0.0, short) else { continue };
        let earlier = before.body_motions.iter().find(|b| b.patches == m.patches);
        let end = before.planned_s();
        let old = earlier.and_then(|b| velocity(before, b, end - short, end)).unwrap_or_default();
        let change = |range: std::ops::Range<usize>| {
            let square = |v: [f64; 4]| range.clone().map(|i| v[i] * v[i]).sum::<f64>();
            let by = [0, 1, 2, 3].map(|i| after[i] - old[i]);
            // The motion itself changes the velocity during the short time.
            let fastest = m.compiled().map_or(0.0, |c| c.largest_speed(1.0, this.windows(), this.window_s));
            Some(square(by).sqrt()).filter(|size| *size > BODY_SHARE * fastest)
        };
        for (size, unit, what) in
            [(change(0..3), "m/s", "velocity"), (change(3..4), "rad/s", "angular velocity")]
        {
            let Some(size) = size else { continue };
            all.push(Jump {
                stage,
                key: "body_motion",
                size,
                unit,
                what: format!(
                    "the {what} of the body \"{}\" changes between the end of stage `{}` and the start of stage `{}`",
                    m.patches.join("\", \""),
                    before.name,
                    this.name
                ),
                remedy: "choose formulas whose rate at t = 0 is that at the end of the stage before, as \"0.1*(1 - cos(t))\" \
                         after rest"
                    .into(),
            });
        }
    }
}

/// Forces on nodes, where the structure moves in time before and after.
fn forces(scene: &Scene, stage: usize, all: &mut Vec<Jump>) {
    let structure = |s: &Stage| s.kind.roles().contains(&Role::Structure);
    let this = &scene.stages[stage];
    let Some(k) = scene.source_stage(stage, Role::Structure).filter(|_| structure(this) && this.in_time())
    else {
        return;
    };
    let of = |stage: usize, nodes: &Option<String>, at_m: Option<[f64; 3]>| {
        let chosen = scene.stages[stage].forces.iter().filter(|f| &f.nodes == nodes && f.at_m == at_m);
        chosen.fold([0.0; 3], |sum, f| std::array::from_fn(|i| sum[i] + f.force_n[i]))
    };
    let mut seen: Vec<(&Option<String>, Option<[f64; 3]>)> = Vec::new();
    for f in scene.stages[k].forces.iter().chain(&this.forces) {
        if seen.contains(&(&f.nodes, f.at_m)) {
            continue;
        }
        seen.push((&f.nodes, f.at_m));
        let (before, after) = (of(k, &f.nodes, f.at_m), of(stage, &f.nodes, f.at_m));
        if before != after {
            all.push(Jump {
                stage,
                key: "force",
                size: length(difference(after, before)),
                unit: "N",
                what: format!(
                    "the force on each of {} changes from {} N in stage `{}` to {} N in stage `{}`",
                    selection(&f.nodes, f.at_m),
                    shown(before),
                    scene.stages[k].name,
                    shown(after),
                    this.name
                ),
                remedy: "give both stages the same [[stage.force]], or damp what it excites by \
                         mass_damping_per_s"
                    .into(),
            });
        }
    }
}

impl Scene {
    /// Stages with the flow that is at rest when the canopy meets it: no earlier stage has developed it. The
    /// speed of the canopy through the air at the start of each, m/s.
    pub fn impulsive_starts(&self, times: &StageTimes) -> Vec<(usize, f64)> {
        let frame = self.resolved().initial_velocity_m_s;
        let starts = |k: &usize| {
            let kind = self.stages[*k].kind;
            matches!(kind, StageKind::Coupled | StageKind::Prescribed)
                && self.source_stage(*k, Role::Flow).is_none()
        };
        let speed = |k: usize| length(difference(self.wind(k, times).at(0.0), frame));
        (0..self.stages.len()).filter(starts).map(|k| (k, speed(k))).filter(|(_, v)| *v > 0.0).collect()
    }
}
