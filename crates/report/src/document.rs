//! The report as a list of sections, independent of the output format (HTML or Markdown).

use case::StageKind;
use coupling::error::RunError;
use figures::picture::{canopy_png, flow_png};
use figures::snapshots::Kind;
use results::run_state::RunState;

use super::bars::Bars;
use super::chart::Chart;
use super::data::{Run, StageData};
use super::frames::{self, StageFrames};
use super::pack::{Packed, pack};
use super::{coupling_quality, facts, origin, payload, stage, times};

/// Width of pictures, pixels.
const PICTURE: u32 = 800;
/// Maximum number of animation frames of a stage in the page.
const MAX_FRAMES: usize = 200;

/// A table. Without a head, the first column names the rows.
pub(super) struct Table {
    /// Content and units, in one sentence.
    pub(super) caption: String,
    pub(super) head: Vec<String>,
    pub(super) rows: Vec<Vec<String>>,
}

/// A raster picture.
pub(super) struct Picture {
    pub(super) id: String,
    pub(super) caption: String,
    pub(super) png: Vec<u8>,
}

/// The canopy for the interactive 3-D viewer, and a still picture for output without it.
pub(super) struct Canopy {
    pub(super) packed: Packed,
    pub(super) picture: Option<Picture>,
}

/// A part of a section.
pub(super) enum Block {
    /// A paragraph.
    Text(String),
    /// Rows and columns.
    Table(Table),
    /// Curves.
    Charts(Vec<Chart>),
    /// A bar chart.
    Bars(Bars),
    /// Pictures in a row.
    Pictures(Vec<Picture>),
    /// The canopy.
    Canopy(Box<Canopy>),
    /// A list of lines.
    List(Vec<String>),
    /// Verbatim text, collapsed.
    Code {
        /// Heading.
        title: String,
        /// The text.
        text: String,
    },
}

/// A section.
pub(super) struct Section {
    /// Anchor of links.
    pub(super) id: String,
    pub(super) title: String,
    /// Introduction, in one sentence.
    pub(super) lead: String,
    pub(super) blocks: Vec<Block>,
}

/// A key figure at the top of the report.
pub(super) struct Card {
    pub(super) label: String,
    pub(super) value: String,
    pub(super) notes: Vec<String>,
    pub(super) warn: bool,
}

/// A report.
pub(super) struct Document {
    pub(super) title: String,
    /// State of the run, in one sentence.
    pub(super) status: String,
    pub(super) cards: Vec<Card>,
    pub(super) sections: Vec<Section>,
    /// Data that the run did not write, and what writes them.
    pub(super) missing: Vec<String>,
}

/// The report of a run. The canopy shapes have at most `canopy_bytes` bytes before compression.
pub(super) fn document(run: &Run, canopy_bytes: usize) -> Result<Document, RunError> {
    let scene = run.scene();
    let frames = read_frames(run, canopy_bytes)?;
    let warnings = origin::warnings(run);
    let mut missing = run.missing.clone();
    let mut sections = Vec::new();
    let of_stage = |s: &StageData| frames.iter().find(|f| f.stage == run.stage(s).name);
    let main = run.main();
    if let Some(canopy) = canopy(run, &frames)? {
        sections.push(canopy);
    }
    sections.push(stage::section(run, main, of_stage(main)));
    if let Some(slices) = slices(run, &mut missing)? {
        sections.push(slices);
    }
    sections.extend(coupling_quality::section(run, main));
    for earlier in run.stages.iter().filter(|s| s.index != main.index) {
        sections.push(stage::section(run, earlier, of_stage(earlier)));
    }
    sections.push(times::section(run));
    sections.push(stage::solvers(run, main));
    sections.push(Section {
        id: "warnings".into(),
        title: "Warnings".into(),
        lead: if warnings.is_empty() {
            "No warnings, and no rejected window.".into()
        } else {
            "Warnings of the coupler and the programs, and windows that were rejected or did not converge."
                .into()
        },
        blocks: vec![Block::List(shortened(&warnings))],
    });
    sections.push(origin::section(run));
    if !missing.is_empty() {
        sections.push(Section {
            id: "missing".into(),
            title: "Missing data".into(),
            lead: "Data that the run did not write, and the key of the scene that writes them.".into(),
            blocks: vec![Block::List(missing.clone())],
        });
    }
    sections.retain(|s| !s.blocks.is_empty());
    let how = match &run.state {
        RunState::Running => "The run continues".to_owned(),
        RunState::Complete => "The run is complete".into(),
        RunState::Interrupted(how) | RunState::Failed(how) => format!("The run ended early: {how}"),
        RunState::Killed => "The run has not finished: it was killed, or its summary is missing".into(),
    };
    Ok(Document {
        title: scene.heading().to_owned(),
        status: format!(
            "{how}. Stage {}: {}, {}.",
            run.stage(main).name,
            origin::kind(run.stage(main).kind),
            facts::progress(run, main)
        ),
        cards: facts::cards(run, warnings.len()),
        sections,
        missing,
    })
}

/// The first fifty lines, and the number of the others.
pub(super) fn shortened(all: &[String]) -> Vec<String> {
    let mut list: Vec<String> = all.iter().take(50).cloned().collect();
    if all.len() > list.len() {
        list.push(format!("and {} more", all.len() - list.len()));
    }
    list
}

/// Reads the canopy of all stages, thinned in time so that their sum stays below `bytes`.
fn read_frames(run: &Run, bytes: usize) -> Result<Vec<StageFrames>, RunError> {
    let mut counts = Vec::new();
    let mut size = 0;
    for stage in &run.stages {
        counts.push(frames::count(run, stage)?);
        if let Some(shape) = frames::first_shape(run, stage)? {
            size = size.max(frames::frame_bytes(&shape));
        }
    }
    let total: usize = counts.iter().sum();
    let room = bytes / size.max(1);
    let mut found = Vec::new();
    for (stage, count) in run.stages.iter().zip(counts) {
        // Each stage gets a number of frames in proportion to its snapshots, at least two.
        let most = if total <= room { count } else { (count * room / total.max(1)).max(2) };
        found.extend(frames::read(run, stage, most.min(MAX_FRAMES))?);
    }
    Ok(found)
}

fn canopy(run: &Run, frames: &[StageFrames]) -> Result<Option<Section>, RunError> {
    let Some(packed) = pack(frames, payload::size(run.scene())) else { return Ok(None) };
    let last = frames.last().map(|f| f.stage.as_str()).unwrap_or_default();
    let stage = run.stages.iter().find(|s| run.stage(s).name == last);
    let picture = match stage {
        Some(stage) => canopy_png(&run.results, stage.index, PICTURE)?,
        None => None,
    };
    let picture = picture.map(|(time, png)| Picture {
        id: "canopy".into(),
        caption: format!(
            "Canopy in stage {last} at t = {time:.3} s. The legend gives the field and its unit."
        ),
        png,
    });
    let mut lead = String::from(
        "Canopy, lines and payload, with the selected field. Drag to rotate, scroll to zoom; the slider sets the time.",
    );
    lead.extend(payload::caption(run.scene()));
    Ok(Some(Section {
        id: "canopy-section".into(),
        title: "Canopy over time".into(),
        lead,
        blocks: vec![Block::Canopy(Box::new(Canopy { packed, picture }))],
    }))
}

/// Slices of the flow at the start, middle and end of the last stage with flow snapshots.
fn slices(run: &Run, missing: &mut Vec<String>) -> Result<Option<Section>, RunError> {
    for stage in run.stages.iter().rev() {
        let Some(times) = run.results.times(stage.index, Kind::Flow)? else { continue };
        let all = times.all();
        let name = &run.stage(stage).name;
        let body = if run.scene().has_canopy() { "canopy" } else { "body" };
        let mut pictures = Vec::new();
        let mut wanted: Vec<(f64, bool)> =
            frames::evenly(all.len(), 3).into_iter().map(|i| (all[i].time, false)).collect();
        wanted.extend(all.last().map(|s| (s.time, true)));
        for (time, diagonal) in wanted {
            let made = match flow_png(&run.results, stage.index, Some(time), diagonal, PICTURE) {
                // The report is written without a slice that cannot be drawn.
                Err(error) => {
                    missing.push(format!("slice of the flow at t = {time:.3} s: {error}"));
                    continue;
                }
                Ok(made) => made,
            };
            let Some((time, png)) = made else { continue };
            let plane = if diagonal { "y = x" } else { "y = 0" };
            pictures.push(Picture {
                id: format!("flow-{}", pictures.len()),
                caption: format!(
                    "Air speed relative to the {body}, m/s, in the plane {plane} at t = {time:.3} s."
                ),
                png,
            });
        }
        return Ok(Some(Section {
            id: "flow".into(),
            title: format!("Flow around the {body}"),
            lead: format!(
                "Speed of the air relative to the {body} in vertical planes, stage {name}. Arrows show the direction in \
                 the plane."
            ),
            blocks: vec![Block::Pictures(pictures)],
        }));
    }
    Ok(None)
}

/// Whether a stage couples structure and flow.
pub(super) fn coupled(kind: StageKind) -> bool {
    kind == StageKind::Coupled
}
