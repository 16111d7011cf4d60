//! The session of one stage: launch of the programs, windows, end of the programs.

use std::ops::Range;
use std::path::Path;

use case::{Role, Scene};
use coupling::error::RunError;
use coupling::schemes::InterfaceState;
use effects::effects;
use results::checkpoint;
use results::program::program_folder;
use results::summary::StageSummary;

use super::folder;
use super::options::RunOptions;
use super::prepare::Prepared;
use super::recording::exchange;
use super::without_programs::WithoutPrograms;
use crate::hub::{HubPartners, SessionOptions};
use crate::launch::{LaunchPlan, Program, Session};
use crate::stages::StageContext;

/// Refuses to start if a program of any of the `stages` is missing, before the first stage runs.
pub(super) fn require_programs(
    options: &RunOptions,
    prepared: &Prepared,
    stages: Range<usize>,
) -> Result<(), RunError> {
    let programs = &program_folder()?;
    for stage in stages {
        let plan = LaunchPlan {
            scene: &prepared.scene,
            scene_file: &prepared.file,
            stage,
            session: "",
            out: &prepared.out,
            programs,
            scratch: Path::new(""),
            mpirun: &options.mpirun,
            resume: None,
        };
        plan.programs()?;
    }
    Ok(())
}

/// Runs a stage of the scene in `file` from `state`, which is updated to the end of the stage.
pub(super) fn run_stage(
    context: &StageContext<'_>,
    file: &Path,
    options: &RunOptions,
    state: &mut InterfaceState,
    summary: &mut StageSummary,
) -> Result<(), RunError> {
    open_folder(context)?;
    if context.scene.roles(&context.scene.stages[context.stage]).is_empty() {
        return without_programs(context, options, state, summary);
    }
    let session = Session::create(context.scene, context.stage)?;
    let programs = programs(context, file, options, &session)?;
    let ended = launch(context, options, &session, programs)
        .and_then(|partners| exchange(context, options, partners, state, summary))
        .and_then(|(partners, interrupted)| {
            summary.used(&partners.finish(context.console)?);
            interrupted.map_or(Ok(()), Err)
        });
    clean_up(context, &session);
    ended
}

/// As [`run_stage`], where the coupler computes the stage by itself.
fn without_programs(
    context: &StageContext<'_>,
    options: &RunOptions,
    state: &mut InterfaceState,
    summary: &mut StageSummary,
) -> Result<(), RunError> {
    let name = &context.scene.stages[context.stage].name;
    context.console.line(&format!("stage `{name}`: no program runs"));
    *state = context.run(&mut WithoutPrograms, state.clone(), summary)?;
    if let Some(record) = &options.record {
        results::state::copy_states(context.scene, context.stage + 1, context.out, &record.folder)?;
    }
    Ok(())
}

/// Prepares the folder of the stage: empty, or with the results before the checkpoint that the stage restarts from.
fn open_folder(context: &StageContext<'_>) -> Result<(), RunError> {
    let folder = case::stage_folder(context.out, context.scene, context.stage);
    results::timings::clear(&folder);
    match context.resumed {
        // Results after the checkpoint are computed again.
        Some(p) => checkpoint::trim(&folder, p.windows, p.time_s),
        None => folder::clear(&folder),
    }
}

/// The programs of the stage with their ranks.
fn programs(
    context: &StageContext<'_>,
    file: &Path,
    options: &RunOptions,
    session: &Session,
) -> Result<Vec<(Program, u32)>, RunError> {
    let scene = context.scene;
    let state = context.resumed.map(|_| case::state_folder(context.out, scene, context.stage));
    let plan = LaunchPlan {
        scene,
        scene_file: file,
        stage: context.stage,
        session: &session.name,
        out: context.out,
        programs: &program_folder()?,
        scratch: session.scratch(),
        mpirun: &options.mpirun,
        resume: state.as_deref(),
    };
    let mut programs = plan.programs()?;
    // No deadline for programs that may run under a debugger.
    if let Some(deadline) = options.deadline.filter(|_| options.attach.is_empty()) {
        let passed = (channel::DEADLINE, deadline.as_secs_f64().to_string().into());
        programs.iter_mut().for_each(|p| p.environment.push(passed.clone()));
    }
    let folder = case::stage_folder(context.out, scene, context.stage);
    for p in &mut programs {
        if let Some(level) = options.log_level {
            p.environment.push((channel::LOG_VARIABLE, level.name().into()));
        }
        p.environment.push((timing::FILE_VARIABLE, results::timings::file(&folder, p.role).into()));
    }
    Ok(programs.into_iter().map(|p| (scene.ranks.of(p.role), p)).map(|(n, p)| (p, n)).collect())
}

/// Starts the programs and waits until all have joined the session.
fn launch<'a>(
    context: &StageContext<'a>,
    options: &RunOptions,
    session: &Session,
    programs: Vec<(Program, u32)>,
) -> Result<HubPartners<'a>, RunError> {
    let (scene, stage) = (context.scene, &context.scene.stages[context.stage]);
    let names: Vec<String> = programs.iter().map(|(p, n)| format!("{} x {n}", p.name)).collect();
    context.console.line(&format!("stage `{}`: {}", stage.name, names.join(", ")));
    let recorded = options.record.as_ref().is_some_and(|r| !r.without_grid);
    let moving = scene.roles(stage).contains(&Role::Mesh);
    let mut effects = required_effects(scene);
    if stage.kind.roles().contains(&Role::Mesh) && !moving {
        effects.push((Role::Flow, channel::CANOPY_MOTION.to_owned()));
    }
    if context.resumed.is_some() {
        effects.extend(Role::ALL.map(|role| (role, channel::RESUME.to_owned())));
    }
    let session_options = SessionOptions {
        session: &session.name,
        stage: (&stage.name, context.stage),
        programs,
        effects,
        deadline: options.deadline,
        attached: options.attach.clone(),
        watch_grid: moving && (recorded || options.baseline.is_some()),
        folder: case::stage_folder(context.out, scene, context.stage),
    };
    let mut partners = HubPartners::start(session_options, context.interface, context.stop, context.console)?;
    if let Some(now) = &options.now {
        partners.complete_windows_on_stop(now.clone());
    }
    Ok(partners)
}

/// Removes temporary files and shared memory of an ended session, also after an error.
fn clean_up(context: &StageContext<'_>, session: &Session) {
    // A remaining draft of a state is incomplete.
    let state = case::state_folder(context.out, context.scene, context.stage);
    if state.exists()
        && let Err(error) = checkpoint::remove(&checkpoint::draft(&state))
    {
        context.console.warning(&error.to_string());
    }
    session.clean_up(context.console);
}

/// Effects of the scene, each with the role that must implement it.
pub(crate) fn required_effects(scene: &Scene) -> Vec<(Role, String)> {
    let mut all: Vec<_> =
        effects(scene).into_iter().filter(|e| e.on).map(|e| (e.role, e.key.to_owned())).collect();
    let air = [
        (scene.has_stage_wind(), channel::STAGE_WIND),
        (scene.has_general_gust(), channel::GUST_SHAPE),
        (scene.has_turbulent_gust(), channel::GUST_TURBULENCE),
        (scene.has_perturbation(), channel::PERTURBATION),
        (scene.stages.iter().any(|s| s.altitude_m.is_some()), channel::STAGE_ALTITUDE),
        (scene.shear().is_some_and(|s| s.turbulence.is_some()), channel::LAYERED_TURBULENCE),
    ];
    for (_, effect) in air.into_iter().filter(|(needed, _)| *needed) {
        // The table of effects may ask the flow for it already.
        if !all.contains(&(Role::Flow, effect.to_owned())) {
            all.push((Role::Flow, effect.to_owned()));
        }
        if scene.structure_meets_wind() {
            all.push((Role::Structure, effect.to_owned()));
        }
    }
    if scene.flow.as_ref().is_some_and(case::Flow::has_boundary_values) {
        all.push((Role::Flow, channel::BOUNDARY_VALUES.to_owned()));
    }
    if scene.flow.as_ref().is_some_and(case::Flow::is_periodic) {
        all.push((Role::Flow, channel::PERIODIC.to_owned()));
        all.push((Role::Mesh, channel::PERIODIC.to_owned()));
    }
    if scene.flow.as_ref().is_some_and(|f| f.body_force() > 0.0) {
        all.push((Role::Flow, channel::BODY_FORCE.to_owned()));
    }
    if scene.shear().is_some() && scene.structure_meets_wind() {
        all.push((Role::Structure, channel::WIND_BY_HEIGHT.to_owned()));
    }
    if scene.payload_body().is_some_and(case::PayloadBody::is_released_turned) {
        all.push((Role::Structure, channel::PAYLOAD_ATTITUDE.to_owned()));
    }
    if !scene.output.reactions.is_empty() {
        all.push((Role::Structure, channel::REACTIONS.to_owned()));
    }
    if matches!(scene.canopy, case::Canopy::Pattern(_)) {
        all.push((Role::Structure, channel::FLAT_SHAPES.to_owned()));
    }
    if scene.stages.iter().flat_map(|s| &s.body_motions).any(|m| scene.moves_patches(m)) {
        all.push((Role::Mesh, channel::BODY_MOTION.to_owned()));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The small descent with `stage` in its stage with the flow and `more` before its coupling.
    fn scene(stage: &str, more: &str) -> Scene {
        let text = include_str!("../../../cases/square-drop/scene.toml");
        let text = text.replace("[coupling]", &format!("{more}[coupling]"));
        let plain = "duration_s = 0.2\nwindow_s = 2e-2\n";
        let text = text.replace(plain, &format!("duration_s = 1.0\nwindow_s = 2e-2\n{stage}\n"));
        case::parse(std::path::Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
    }

    /// A flow that does not know the pulse or the turbulence is refused by name; so is a structure whose lines meet the air. Each is asked once.
    #[test]
    fn winds_are_asked_of_the_programs_that_evaluate_them() {
        let asked = |scene: &Scene, role: Role, effect: &str| {
            required_effects(scene).into_iter().filter(|(r, e)| *r == role && e == effect).count()
        };
        let gust = "[stage.gust]\nshape = \"dryden\"\nvelocity_m_s = [1, 1, 1]\nduration_s = 0.5\nlength_m = [9, 9, 9]\nspeed_m_s = 4.0";
        for (stage, effects) in [
            ("[stage.perturbation]", vec![channel::STAGE_WIND, channel::PERTURBATION]),
            (gust, vec![channel::STAGE_WIND, channel::GUST_SHAPE, channel::GUST_TURBULENCE]),
        ] {
            let (bare, drag) = (scene(stage, ""), scene(stage, "[lines.drag]\n"));
            for effect in effects {
                assert_eq!((asked(&bare, Role::Flow, effect), asked(&bare, Role::Structure, effect)), (1, 0));
                assert_eq!((asked(&drag, Role::Flow, effect), asked(&drag, Role::Structure, effect)), (1, 1));
            }
        }
        assert_eq!(asked(&scene("[stage.perturbation]", ""), Role::Flow, channel::GUST_TURBULENCE), 0);
    }

    /// A structure that ignores the height, the attitude or reactions is refused by name, where the scene has them.
    #[test]
    fn height_attitude_and_reactions_are_asked_of_the_structure() {
        let asked = |more: &str, effect: &str| {
            let scene = scene("", more);
            required_effects(&scene).into_iter().filter(|(r, e)| *r == Role::Structure && e == effect).count()
        };
        let shear = "[flow.shear]\nstart_height_m = 10.0\nprofile = \"table\"\nheight_m = [0, 9]\ntable_m_s = [[1, 0, 0], [2, 0, 0]]\n";
        assert_eq!(asked(shear, channel::WIND_BY_HEIGHT), 0);
        assert_eq!(asked(&format!("{shear}[lines.drag]\n"), channel::WIND_BY_HEIGHT), 1);
        let turbulent = "turbulence = { rms_m_s = [1, 1], length_m = [9, 9] }\n";
        let turbulent = [shear, turbulent, "[lines.drag]\n"].concat();
        assert_eq!(asked(&turbulent, channel::LAYERED_TURBULENCE), 1);
        let body = |turn: f64| {
            format!(
                "[fabric_gravity]\n[descent.body]\ninertia_kg_m2 = [1, 1, 1]\nattachments_m = [[0, 0, 0.2]]\n\
                 initial_rotation_deg = [0, {turn}, 0]\n"
            )
        };
        assert_eq!([0.0, 5.0].map(|turn| asked(&body(turn), channel::PAYLOAD_ATTITUDE)), [0, 1]);
        let reaction = "[[output.reaction]]\nname = \"clamp\"\nnodes = \"held\"\n";
        assert_eq!(["", reaction].map(|more| asked(more, channel::REACTIONS)), [0, 1]);
    }
}
