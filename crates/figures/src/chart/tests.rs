//! Every kind of figure, as SVG and as PNG.

use super::*;
use crate::colour::series;
use crate::pixels::decode;

/// Copies a picture to the folder `RIPSTOP_KEEP`, if set.
fn keep(figure: &Figure, name: &str) {
    if let Some(folder) = std::env::var_os("RIPSTOP_KEEP") {
        figure.save(Path::new(&folder), name).unwrap();
    }
}

fn panel() -> Panel {
    let points = vec![[1.0, 0.1], [2.0, 0.025], [4.0, f64::NAN]];
    let mut drag = Series::dots("drag", series(0), points);
    drag.bands = vec![0.02, 0.01, 0.0];
    drag.line = 1.0;
    drag.notes = vec![(0, "order 2".into())];
    let ring = Series { mark: Mark::Ring, ..Series::dots("base", series(1), vec![[2.0, 0.05]]) };
    Panel {
        title: "grid".into(),
        x: Axis::around("cost, s", true, [1.0, 4.0].into_iter()),
        y: Axis::around("error, %", true, [0.1, 0.025].into_iter()),
        series: vec![drag, ring],
        band: Some([0.03, 0.05]),
        references: vec![Reference::dashed(0.04, "paper <1>".into())],
    }
}

#[test]
fn panels_have_ticks_labels_references_and_one_legend() {
    let panels = Panels { panels: vec![panel(); 3], columns: 2, size: [470.0, 340.0] };
    let figure = Figure::Panels(panels.clone());
    let svg = figure.svg().file();
    // Three points and two marks in the legend; the one that is not finite has no place.
    assert_eq!(svg.matches("<circle").count(), 3 * 3 + 2, "{svg}");
    for (text, times) in [("order 2", 3), ("paper &lt;1&gt;", 3), ("cost, s", 3), ("drag", 1)] {
        assert_eq!(svg.matches(text).count(), times, "{text}");
    }
    let image = decode(&figure.png());
    assert_eq!([image.width, image.height], figure.size());
    assert_eq!(figure.size(), [940, 680 + panels.legend().height as u32]);
    let found = panels.data_box(3).is_none() && panels.data_box(1).is_some_and(|b| b.place[0] > 470.0 * 3.0);
    assert!(found, "{:?}", panels.data_box(1));
    keep(&figure, "panels");
}

#[test]
fn bars_have_tooltips_with_their_values() {
    let part = |name: &str, i, value| Part { name: name.into(), colour: series(i), value };
    for shares in [false, true] {
        let row = |label: &str, a, b| Bar {
            label: label.into(),
            parts: vec![part("flow", 0, a), part("structure", 1, b), part("none", 2, 0.0)],
        };
        let rows = vec![row("base", 3.0, 1.0), row("descent & more", 6.0, 0.5)];
        let label = if shares { "share of the wall time, percent" } else { "wall time, s" };
        let bars = Figure::Bars(Bars { label: label.into(), unit: "s".into(), rows, shares });
        let svg = bars.svg().file();
        for part in ["base, flow: 3 s (75.0 %)", "\n4 s\n", "descent &amp; more"] {
            assert!(svg.contains(part), "{part} is not in {svg}");
        }
        assert!(!svg.contains("none:") && !svg.contains("\nnone"));
        keep(&bars, if shares { "shares" } else { "bars" });
    }
    let columns = (1..=24).map(|i| (i.to_string(), 100.0 + 7.0 * f64::from(i % 5))).collect();
    let columns = Columns { label: "tension, N".into(), unit: "N".into(), across: "line".into(), columns };
    let figure = Figure::Columns(columns);
    assert!(figure.svg().file().contains("<title>line 3: 121 N</title>"));
    keep(&figure, "columns");
}

#[test]
fn heat_maps_have_a_marker_and_a_number_in_each_cell() {
    let names = |list: &[&str]| list.iter().map(|n| (*n).to_owned()).collect();
    let kinds = [FieldMark::Dot, FieldMark::Ring, FieldMark::Cross];
    let field = |i: usize| Field {
        at: [i % 3, i / 3],
        share: i as f64 / 5.0,
        mark: kinds[i % 3],
        text: format!("{i}.5"),
    };
    let map = HeatMap {
        title: "staggered".into(),
        x: Axis::categories("added mass / fabric mass", names(&["0.1", "10", "1000"])),
        y: Axis::categories("windows per period", names(&["8", "32", "128"])),
        fields: (0..6).map(field).collect(),
    };
    let figure = Figure::HeatMaps(HeatMaps {
        title: "a panel".into(),
        maps: vec![map; 2],
        columns: 2,
        marks: vec![(FieldMark::Dot, "stable".into()), (FieldMark::Cross, "unstable".into())],
        scale: "iterations in a window".into(),
        scale_marks: vec![(0.0, "1".into()), (1.0, "30".into())],
    });
    let svg = figure.svg().file();
    assert_eq!((svg.matches("added mass").count(), svg.matches("3.5").count()), (2, 2));
    assert_eq!(decode(&figure.png()).width, figure.size()[0]);
    keep(&figure, "maps");
}

#[test]
fn values_that_are_not_finite_are_accepted() {
    let points = [(0.0, 1e-9), (0.5, f64::NAN), (1.0, 0.0), (2.0, 1e-9), (3.0, f64::INFINITY)];
    let points: Vec<[f64; 2]> = points.iter().map(|p| [p.0, p.1]).collect();
    for logarithmic in [false, true] {
        let panel = Panel {
            title: String::new(),
            x: Axis::spanning("time, s", points.iter().map(|p| p[0])),
            y: Axis::around("a < b", logarithmic, points.iter().map(|p| p[1])),
            series: vec![Series::curve("", series(0), points.clone())],
            band: None,
            references: Vec::new(),
        };
        let svg = Figure::Panels(Panels::single(panel, [640.0, 260.0])).svg().file();
        assert!(!svg.contains("NaN") && !svg.contains("inf") && !svg.contains("a < b"), "{svg}");
    }
    let none = Bars { label: String::new(), unit: "s".into(), rows: Vec::new(), shares: true };
    assert!(!Figure::Bars(none).svg().file().contains("NaN"));
}

#[test]
fn columns_show_all_values_or_none() {
    let texts = |values: &[f64]| {
        let columns = values.iter().enumerate().map(|(i, v)| (i.to_string(), *v)).collect();
        let (label, unit, across) = ("tension, N".into(), "N".into(), "line".into());
        let figure = Figure::Columns(Columns { label, unit, across, columns });
        let svg = figure.svg().file();
        let shown = |v: &f64| svg.split(['<', '>']).any(|text| text.trim() == format!("{v:.2}"));
        values.iter().map(shown).collect::<Vec<_>>()
    };
    assert_eq!(texts(&[1.5634, 0.9791, 0.0081, 1.2912]), [true; 4]);
    // Too narrow for four characters.
    assert_eq!(texts(&[1.5634; 90]), [false; 90]);
}
