//! A report as sections of texts, tables, charts and pictures, before it is a page or Markdown.

use case::StageKind;
use coupling::error::RunError;
use figures::picture::{canopy_png, flow_png};
use figures::snapshots::Kind;

use super::bars::Bars;
use super::chart::Chart;
use super::data::{Run, StageData, text};
use super::frames::{self, StageFrames};
use super::pack::{Packed, pack};
use super::{coupling_quality, facts, origin, stage, times};

/// Width of pictures, pixels.
const PICTURE: u32 = 800;
/// Most frames of a stage in the page: some seconds of playing.
const MOST_FRAMES: usize = 200;

/// A table; without a head its first column names the rows.
pub(super) struct Table {
    pub(super) head: Vec<String>,
    pub(super) rows: Vec<Vec<String>>,
}

/// A picture in pixels.
pub(super) struct Picture {
    pub(super) id: String,
    pub(super) caption: String,
    pub(super) png: Vec<u8>,
}

/// The canopy in three dimensions, and a picture for readers that cannot show it.
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
    /// Bars.
    Bars(Bars),
    /// Pictures beside each other.
    Pictures(Vec<Picture>),
    /// The canopy.
    Canopy(Box<Canopy>),
    /// One line each.
    List(Vec<String>),
    /// Text as it is, folded away.
    Code {
        /// What it is.
        title: String,
        /// The text.
        text: String,
    },
}

/// A section.
pub(super) struct Section {
    /// For links.
    pub(super) id: String,
    pub(super) title: String,
    /// One sentence on what it is.
    pub(super) lead: String,
    pub(super) blocks: Vec<Block>,
}

/// A number at the top.
pub(super) struct Card {
    pub(super) label: String,
    pub(super) value: String,
    pub(super) notes: Vec<String>,
    pub(super) warn: bool,
}

/// A report.
pub(super) struct Document {
    pub(super) title: String,
    /// What the run is, in a sentence.
    pub(super) status: String,
    pub(super) cards: Vec<Card>,
    pub(super) sections: Vec<Section>,
    /// What is not there and what would write it.
    pub(super) missing: Vec<String>,
}

/// Describes a run; the canopy's shapes take at most `canopy_bytes` before compression.
pub(super) fn document(run: &Run, canopy_bytes: usize) -> Result<Document, RunError> {
    let scene = run.scene();
    let frames = read_frames(run, canopy_bytes)?;
    let warnings = origin::warnings(run);
    let mut missing = run.missing.clone();
    let mut sections = Vec::new();
    let of_stage = |s: &StageData| frames.iter().find(|f| f.stage == run.stage(s).name);
    let main = run.main();
    sections.push(stage::section(run, main, of_stage(main)));
    if let Some(canopy) = canopy(run, &frames)? {
        sections.push(canopy);
    }
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
            "Neither the coupler nor a program warned, and no window was rejected.".into()
        } else {
            "What the coupler and the programs said, and windows that were rejected or did not converge."
                .into()
        },
        blocks: vec![Block::List(shortened(&warnings))],
    });
    sections.push(origin::section(run));
    if !missing.is_empty() {
        sections.push(Section {
            id: "missing".into(),
            title: "What is not here".into(),
            lead: "What the run did not write, and what would write it.".into(),
            blocks: vec![Block::List(missing.clone())],
        });
    }
    sections.retain(|s| !s.blocks.is_empty());
    let ended = text(run.summary.as_ref(), "ended");
    let how = match ended {
        "" => "The run is not finished, or was killed".to_owned(),
        "complete" => "The run is complete".to_owned(),
        other => format!("The run ended early: {other}"),
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

/// The first fifty, and how many there are.
fn shortened(all: &[String]) -> Vec<String> {
    let mut list: Vec<String> = all.iter().take(50).cloned().collect();
    if all.len() > list.len() {
        list.push(format!("and {} more", all.len() - list.len()));
    }
    list
}

/// Reads the canopy of all stages, thinned in time so that all together stay below `bytes`.
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
        // The last stage of several gets what it needs first only by its share: all are worth a look.
        let most = if total <= room { count } else { (count * room / total.max(1)).max(2) };
        found.extend(frames::read(run, stage, most.min(MOST_FRAMES))?);
    }
    Ok(found)
}

fn canopy(run: &Run, frames: &[StageFrames]) -> Result<Option<Section>, RunError> {
    let Some(packed) = pack(frames) else { return Ok(None) };
    let last = frames.last().map(|f| f.stage.as_str()).unwrap_or_default();
    let stage = run.stages.iter().find(|s| run.stage(s).name == last);
    let picture = match stage {
        Some(stage) => canopy_png(&run.results, stage.index, PICTURE)?,
        None => None,
    };
    let picture = picture.map(|(time, png)| Picture {
        id: "canopy".into(),
        caption: format!("The canopy in stage {last} at {time:.3} s."),
        png,
    });
    let lead = "Drag to turn, scroll to come nearer; the slider goes through time.";
    Ok(Some(Section {
        id: "canopy-section".into(),
        title: "The canopy over time".into(),
        lead: lead.into(),
        blocks: vec![Block::Canopy(Box::new(Canopy { packed, picture }))],
    }))
}

/// The flow at the start, in the middle and at the end of the last stage that wrote some.
fn slices(run: &Run, missing: &mut Vec<String>) -> Result<Option<Section>, RunError> {
    for stage in run.stages.iter().rev() {
        let Some(times) = run.results.times(stage.index, Kind::Flow)? else { continue };
        let all = times.all();
        let name = &run.stage(stage).name;
        let mut pictures = Vec::new();
        let mut wanted: Vec<(f64, bool)> =
            frames::evenly(all.len(), 3).into_iter().map(|i| (all[i].time, false)).collect();
        wanted.extend(all.last().map(|s| (s.time, true)));
        for (time, diagonal) in wanted {
            let made = match flow_png(&run.results, stage.index, Some(time), diagonal, PICTURE) {
                // A slice that cannot be drawn is no reason to withhold the rest.
                Err(error) => {
                    missing.push(format!("a slice of the flow at {time:.3} s: {error}"));
                    continue;
                }
                Ok(made) => made,
            };
            let Some((time, png)) = made else { continue };
            let plane = if diagonal { "from corner to corner" } else { "across" };
            pictures.push(Picture {
                id: format!("flow-{}", pictures.len()),
                caption: format!("{time:.2} s, cut {plane}."),
                png,
            });
        }
        return Ok(Some(Section {
            id: "flow".into(),
            title: "The flow around it".into(),
            lead: format!(
                "Speed of the air relative to the canopy in vertical cuts, stage {name}; arrows show its direction."
            ),
            blocks: vec![Block::Pictures(pictures)],
        }));
    }
    Ok(None)
}

/// Whether a stage has a flow that moves with a canopy.
pub(super) fn coupled(kind: StageKind) -> bool {
    kind == StageKind::Coupled
}
