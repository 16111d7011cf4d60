//! Table of a stage in which the canopy opens: line stretch, filling, largest force.

use coupling::interface::CanopyInterface;
use results::opening::{Opening, OpeningReference, drag_area};

use super::chart::digits;
use super::data::{Run, StageData};
use super::document::{Card, Table, coupled};
use super::facts;

pub(super) const OPENING: &str = "Opening. Line stretch: the riser force reaches 5 % of its largest value. Filled: the first maximum of the projected area of at \
    least nine tenths of the largest, not exceeded within a tenth of the time since line stretch. q is the dynamic pressure at line stretch, S0 the nominal area, D0 \
    the nominal diameter. Filling constants and opening force coefficients of handbooks count from the line stretch of a packed canopy.";

/// Of a canopy that is not filled.
const STILL: &str = "still filling at the end of the stage";
/// Where the stream is too slow for a force coefficient.
const STOPPED: &str = "none: the stream falls below a fifth of its speed at line stretch";

/// Where no mean of the force can be taken.
const LONG: &str = "none: a window is longer than that time";

/// The largest force of the opening, with its factor; `None` where no stage opens the canopy.
pub(super) fn card(run: &Run) -> Option<Card> {
    let stage = run.stages.iter().find(|s| table(run, s).is_some())?;
    let table = table(run, stage)?;
    let row = |start: &str| table.rows.iter().find(|row| row[0].starts_with(start)).map(|row| row[1].clone());
    let mut notes = vec![format!(
        "largest force of the risers {} N at {} s of stage {}",
        row("largest force of the risers")?,
        row("its time")?,
        run.stage(stage).name
    )];
    let (value, note) = match row("opening factor") {
        Some(factor) => {
            (factor, "over q at line stretch and CD S of the last half of the last coupled stage")
        }
        None => (
            row("the same over q S0")?,
            "over q at line stretch and the nominal area; no drag area to compare with",
        ),
    };
    notes.insert(0, note.into());
    let vibration = row("warning opening.vibrating-force");
    let vibrates = vibration.is_some();
    notes.extend(vibration);
    let filling = row("filling time")?;
    notes.push(if filling == STILL {
        format!("not final: {STILL}")
    } else {
        format!("filled in {filling} s")
    });
    if row("drag area").is_some_and(|area| area.contains("not settled")) {
        notes.push("the drag area is not settled".into());
    }
    Some(Card { label: "Opening factor".into(), value, notes, warn: vibrates })
}

/// Figures of the opening; `None` where the canopy does not open in the stage.
pub(super) fn table(run: &Run, stage: &StageData) -> Option<Table> {
    if !coupled(run.stage(stage).kind) {
        return None;
    }
    let interface = CanopyInterface::new(run.scene()).ok()?;
    // The air is that of the stage.
    let of = |stage: &StageData| OpeningReference::of(&run.scene().for_stage(stage.index), &interface);
    let reference = of(stage)?;
    let o = Opening::of_history(stage.columns.all(), &reference)?;
    let given = |value: Option<f64>, none: &str| value.map_or_else(|| none.to_owned(), digits);
    let open = STILL;
    let no_coefficient = if o.opened_s.is_some() { STOPPED } else { STILL };
    let mut rows = vec![
        ("nominal diameter D0, m", digits(o.nominal_diameter_m)),
        ("mass ratio m/(rho D0^3)", given(o.mass_ratio, "infinite: confluence point held")),
        ("line stretch, s", digits(o.line_stretch_s)),
        ("speed of the air then, m/s", digits(o.speed_m_s)),
        ("filling time, s", given(o.filling_time_s, open)),
        ("filling constant t v/D0", given(o.filling_constant, open)),
        ("projected area then, m2", given(o.opened_area_m2, open)),
        ("largest force of the risers, N", digits(o.largest_force_n)),
        ("its time, s", digits(o.largest_force_s)),
        ("the same over q S0", digits(o.largest_force_share)),
        ("largest mean over a tenth of D0/v, N", given(o.largest_mean_force_n, LONG)),
        ("a tenth of D0/v, s", digits(o.averaging_s)),
        (
            "largest force coefficient, force over q S0 of the same moment",
            given(o.largest_coefficient, no_coefficient),
        ),
        ("its time, s", given(o.largest_coefficient_s, no_coefficient)),
    ];
    rows.extend(o.vibration().map(|text| ("warning opening.vibrating-force", text)));
    let last = run.stages.iter().rev().find(|s| coupled(run.stage(s).kind))?;
    if let Some(area) = drag_area(last.columns.all(), of(last)?.density_kg_m3) {
        let coefficient = area / reference.nominal_area_m2;
        let state = match facts::not_comparable(last) {
            None => String::new(),
            Some(why) => format!(" (not settled: {why})"),
        };
        let open_drag = if state.is_empty() { "" } else { " (its drag is not settled)" };
        rows.push(("drag area CD S in the last half of the last coupled stage, m2", digits(area) + &state));
        rows.push(("drag coefficient on S0 there", digits(coefficient)));
        rows.push((
            "opening factor (opening force coefficient), largest force over q CD S",
            digits(o.largest_force_share / coefficient) + open_drag,
        ));
        rows.push((
            "inflation factor, largest force coefficient over that drag coefficient",
            given(o.largest_coefficient.map(|c| c / coefficient), no_coefficient) + open_drag,
        ));
        if let Some(mass) = reference.mass_kg {
            rows.push(("ballistic coefficient m/(CD S), kg/m2", digits(mass / area)));
        }
    }
    let rows = rows.into_iter().map(|(name, value)| vec![name.to_owned(), value]).collect();
    Some(Table {
        caption: "Opening of the canopy; units in the first column.".into(),
        head: Vec::new(),
        rows,
    })
}
