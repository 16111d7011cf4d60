//! Every file of a folder of results: the table of `docs/reference/results.md`.

/// A file, or a family of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ResultFile {
    /// Path below the folder of results. Braces stand for any name without a slash.
    pub path: &'static str,
    /// Program that writes it.
    pub writer: &'static str,
    /// When, and which key or option asks for it.
    pub when: &'static str,
    /// Content and format.
    pub content: &'static str,
}

const fn file(
    path: &'static str,
    writer: &'static str,
    when: &'static str,
    content: &'static str,
) -> ResultFile {
    ResultFile { path, writer, when, content }
}

const COUPLER: &str = "ripstop";
const STRUCTURE: &str = "structure-solver";
const FLOW: &str = "flow-solver";
const MESH: &str = "mesh-mover";
const CHECKPOINT: &str =
    "at each checkpoint (`output.checkpoint_every_windows`), at the end of a stage, at Ctrl-C";

/// Files of `ripstop run`.
pub const RUN: &[ResultFile] = &[
    file("scene.toml", COUPLER, "start of the run", "The scene as it runs, with the values of `--set`."),
    file(
        "summary.json",
        COUPLER,
        "end of each stage and of the run",
        "Summary of the run, JSON; fields below.",
    ),
    file(
        "progress.json",
        COUPLER,
        "start of each stage, then at most twice a second",
        "Stage, window, time, ETA, JSON; fields below. `ripstop watch` reads it.",
    ),
    file(
        "ripstop.log",
        COUPLER,
        "during the run",
        "All lines on the terminal with time and level (`info`, `warning`, `error`) of each, text.",
    ),
    file(
        "resume.json",
        COUPLER,
        "start of the run",
        "Identity of the run, its scene with defaults and checksums of the files that the scene names, JSON; \
         `--resume` compares it.",
    ),
    file(".lock", COUPLER, "start of the run", "Lock against a second run in the same folder; empty."),
    file(
        "{stage}/history.csv",
        COUPLER,
        "each accepted window",
        "A row for each window, CSV; columns below.",
    ),
    file(
        "{stage}/iterations.csv",
        COUPLER,
        "each accepted window of a coupled stage",
        "A row for each coupling iteration, CSV; columns below.",
    ),
    file(
        "{stage}/points.csv",
        COUPLER,
        "each accepted window of a stage with the structure, with `[[output.point]]`",
        "Displacement of points of the canopy, CSV.",
    ),
    file("{stage}/descent.svg", COUPLER, "end of a coupled stage", "Descent speed and drag over time, SVG."),
    file(
        "{stage}/logs/{role}.log",
        COUPLER,
        "during the stage",
        "Output of a program with its log: seconds since its start, level (`info`, `debug`), message; text.",
    ),
    file(
        "{stage}/canopy.pvd",
        STRUCTURE,
        "`output.surface_every_windows`",
        "Time series of the canopy, ParaView.",
    ),
    file(
        "{stage}/canopy_{number}.vtu",
        STRUCTURE,
        "`output.surface_every_windows`",
        "Canopy: displacement and velocity of nodes; principal second Piola-Kirchhoff stresses, direction of the larger one \
         in the present shape, principal Green strains, state (0 slack, 1 wrinkled, 2 taut), pressure jump and shear of the \
         air of elements. VTK XML.",
    ),
    file(
        "{stage}/lines.pvd",
        STRUCTURE,
        "`output.surface_every_windows`",
        "Time series of the lines, ParaView.",
    ),
    file(
        "{stage}/lines_{number}.vtu",
        STRUCTURE,
        "`output.surface_every_windows`",
        "Lines: tension, number of the line, kind (0 suspension line, 1 riser, 2 reinforcement; tapes: 3 hem, 4 seam, 5 vent, 6 grid). VTK XML.",
    ),
    file(
        "{stage}/payload.csv",
        STRUCTURE,
        "each accepted window, with `[descent.body]`",
        "Motion of the payload, CSV.",
    ),
    file(
        "{stage}/reactions.csv",
        STRUCTURE,
        "each accepted window, with `[[output.reaction]]`",
        "Forces and moments that hold groups of nodes or move them as prescribed, CSV.",
    ),
    file("{stage}/grid.txt", FLOW, "start of the stage", "Size and quality of the flow grid, text."),
    file("{stage}/flow.pvd", FLOW, "`output.volume_every_windows`", "Time series of the flow, ParaView."),
    file(
        "{stage}/flow/flow_{number}_{rank}.vtu",
        FLOW,
        "`output.volume_every_windows`",
        "Flow in the cells of a rank: pressure, velocities, Mach number, vorticity, Q criterion; with `[flow.statistics]` means and \
         fluctuations. VTK XML.",
    ),
    file(
        "{stage}/flow/flow_{number}_{part}.vtr",
        FLOW,
        "`output.volume_every_windows`, with `[flow.immersed]`",
        "The same fields in planes of the Cartesian grid. VTK XML, rectilinear.",
    ),
    file("{stage}/probes.csv", FLOW, "each accepted window, with `[[flow.probe]]`", "Values at points, CSV."),
    file(
        "{stage}/forces.csv",
        FLOW,
        "each accepted window, with `[flow.forces]`",
        "Forces and moments, CSV.",
    ),
    file(
        "{stage}/canopy_air.pvd",
        FLOW,
        "`[flow.surface_pressure]`",
        "Time series of the pressure on the canopy, ParaView.",
    ),
    file(
        "{stage}/canopy_air/canopy_air_{window}_{rank}.vtu",
        FLOW,
        "`[flow.surface_pressure]`",
        "Pressure on both sides of the canopy. VTK XML.",
    ),
    file("{stage}/{slice}.pvd", FLOW, "`[[flow.slice]]`", "Time series of a plane cut, ParaView."),
    file(
        "{stage}/{slice}/{slice}_{window}_{rank}.vtu",
        FLOW,
        "`[[flow.slice]]`",
        "Plane cut through the flow. VTK XML.",
    ),
    file(
        "{stage}/state/seal.bin",
        COUPLER,
        CHECKPOINT,
        "Files of the checkpoint with checksums, written last.",
    ),
    file("{stage}/state/progress.bin", COUPLER, CHECKPOINT, "Windows, sums and rows at the checkpoint."),
    file("{stage}/state/time.toml", COUPLER, CHECKPOINT, "Time since the start of the stage, TOML."),
    file(
        "{stage}/state/coupler.bin",
        COUPLER,
        CHECKPOINT,
        "State of the coupler: interface values and descent.",
    ),
    file("{stage}/state/structure.bin", STRUCTURE, CHECKPOINT, "State of the structure."),
    file("{stage}/state/energy.bin", STRUCTURE, CHECKPOINT, "Energy balance of the structure."),
    file("{stage}/state/payload.bin", STRUCTURE, CHECKPOINT, "State of a payload with `[descent.body]`."),
    file(
        "{stage}/state/canopy.bin",
        STRUCTURE,
        CHECKPOINT,
        "Shape of the canopy, which a later flow grid is built around.",
    ),
    file("{stage}/state/flow.bin", FLOW, CHECKPOINT, "State of the flow."),
    file("{stage}/state/flow-statistics.bin", FLOW, CHECKPOINT, "Time statistics, with `[flow.statistics]`."),
    file("{stage}/state/mesh.bin", MESH, CHECKPOINT, "State of the grid motion."),
    file(
        "{stage}/state/{role}-memory-{rank}-of-{ranks}.bin",
        "each program",
        CHECKPOINT,
        "Warm-start data of a rank. A restart on another number of ranks ignores it.",
    ),
];

/// Folders next to `{stage}/state`, with the same files.
pub const STATE_FOLDERS: &[(&str, &str)] = &[
    ("{stage}/state.new", "A checkpoint while it is written."),
    ("{stage}/state.old", "The checkpoint before the last one."),
];

/// Files of a recording (`ripstop run --record`), next to copies of the files in `{stage}/state`.
pub const RECORDING: &[ResultFile] = &[
    file("scene.toml", COUPLER, "start of the run", "The scene as it runs."),
    file(
        "{stage}/exchange.rec",
        COUPLER,
        "during the stage",
        "All exchanges of the stage; format in [Recordings](recordings.md).",
    ),
];

/// Files that commands other than `run` write by default.
pub const OTHER: &[ResultFile] = &[
    file("report.html", "ripstop report", "`ripstop report RUN`", "Report of a run, one HTML page."),
    file(
        "report.md",
        "ripstop report",
        "`ripstop report RUN --markdown`",
        "The same as Markdown, with figures.",
    ),
    file(
        "comparison.html",
        "ripstop report",
        "`ripstop report RUN1 RUN2 ...`",
        "Comparison of runs, one HTML page, in the first of them.",
    ),
    file(
        "comparison.md",
        "ripstop report",
        "`ripstop report RUN1 RUN2 ... --markdown`",
        "The same as Markdown, with figures.",
    ),
    file("pictures/canopy.png", "ripstop picture", "`ripstop picture RUN`", "Canopy, PNG."),
    file("pictures/flow.png", "ripstop picture", "`ripstop picture RUN`", "Canopy and flow in a plane, PNG."),
    file(
        "pictures/pre-inflation.png",
        "ripstop picture",
        "`ripstop picture RUN`",
        "Shapes of the pre-inflation, PNG.",
    ),
    file(
        "export/{stage}-{what}.vtkhdf",
        "ripstop export",
        "`ripstop export vtkhdf RUN`",
        "All snapshots of a stage in one file; `{what}` is `canopy`, `lines` or `flow`. VTKHDF 2.0.",
    ),
    file(
        "export/{stage}-canopy.gif",
        "ripstop export",
        "`ripstop export animation RUN`",
        "Canopy over time, animated GIF.",
    ),
    file(
        "export/{stage}-canopy/frame_{number}.png",
        "ripstop export",
        "`ripstop export animation RUN --format png`",
        "Canopy over time, a PNG file for each snapshot.",
    ),
    file(
        "{stage}-difference.csv",
        "ripstop",
        "`diff --out`, `replay`, `run --baseline`",
        "Differences by window, CSV; columns below.",
    ),
    file(
        "{stage}-difference.svg",
        "ripstop",
        "`diff --out`, `replay`, `run --baseline`",
        "Differences over time, SVG.",
    ),
];

/// Whether `path` is one of the files that `pattern` stands for.
pub fn matches(pattern: &str, path: &str) -> bool {
    match pattern.split_once('{') {
        None => pattern == path,
        Some((start, rest)) => {
            let Some(tail) = path.strip_prefix(start) else { return false };
            let rest = rest.split_once('}').map_or("", |(_, rest)| rest);
            let end = tail.find('/').unwrap_or(tail.len());
            (1..=end).any(|n| tail.is_char_boundary(n) && matches(rest, &tail[n..]))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn braces_stand_for_names() {
        assert!(matches("{stage}/logs/{role}.log", "a/logs/flow.log"));
        assert!(matches("{stage}/flow/flow_{number}_{rank}.vtu", "b-1/flow/flow_00001_12.vtu"));
        for path in ["logs/flow.log", "a/b/logs/flow.log", "a/logs/.log", "a/logs/flow.txt"] {
            assert!(!matches("{stage}/logs/{role}.log", path), "{path}");
        }
    }

    #[test]
    fn every_file_is_described_once() {
        for (i, f) in RUN.iter().enumerate() {
            assert!(RUN[..i].iter().all(|o| o.path != f.path), "{}", f.path);
            assert!(
                [f.writer, f.when, f.content].iter().all(|t| !t.is_empty() && !t.contains('|')),
                "{}",
                f.path
            );
            assert!(f.content.ends_with('.'), "{}", f.path);
        }
    }
}
