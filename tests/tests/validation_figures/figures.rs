//! One figure for each case, from the tables of the page.

use ::figures::chart::{Axis, Figure, Mark, Panel, Panels, Reference, Series, WIDTH};
use ::figures::colour::{GREY, series};

use crate::page::{Page, Table, value, values};

/// Points, and the half widths of their intervals.
type Points = (Vec<[f64; 2]>, Vec<f64>);

/// Figures with their names.
pub fn all(page: &Page) -> Vec<(&'static str, Figure)> {
    vec![
        ("overview", overview(page)),
        ("ring-in-fluid", ring(page)),
        ("tube-pulse", tube(page)),
        ("inverted-flag", flag(page)),
        ("drag-by-type", drag(page)),
        ("opening-at-40", opening_at_40(page)),
        ("openings-at-20", openings_at_20(page)),
        ("compliant-disk", disk(page)),
        ("disk-gap-band", disk_gap_band(page)),
        ("extended-skirt", extended_skirt(page)),
        ("t-10", personnel(page)),
    ]
}

/// Points with their intervals.
fn measured(name: &str, number: usize, (points, bands): Points) -> Series {
    Series { bands, ..Series::dots(name, series(number), points) }
}

/// Published ranges at values of x.
fn ranges(name: &str, number: usize, ranges: &[(f64, [f64; 2])]) -> Series {
    let gap = [f64::NAN; 2];
    let points = ranges.iter().flat_map(|(x, [low, high])| [[*x, *low], [*x, *high], gap]).collect();
    Series { line: 3.0, ..Series::curve(name, series(number), points) }
}

/// Values of cells over 0.5, 1.5 ...
fn across<'a>(cells: impl Iterator<Item = &'a String>) -> Points {
    let of = |(i, cell): (usize, &String)| value(cell).map(|v| ([i as f64 + 0.5, v.mean], v.half));
    cells.enumerate().filter_map(of).unzip()
}

/// Axis around all points with their intervals.
fn around(label: &str, all: &[Series]) -> Axis {
    let of = |s: &Series| -> Vec<f64> {
        let half = |i: usize| s.bands.get(i).copied().unwrap_or(0.0);
        s.points.iter().enumerate().flat_map(|(i, p)| [p[1] - half(i), p[1] + half(i)]).collect()
    };
    Axis::around(label, false, all.iter().flat_map(of))
}

fn panel(title: &str, x: Axis, y: &str, series: Vec<Series>) -> Panel {
    with_references(title, x, y, series, &[])
}

/// A panel with dashed lines.
fn with_references(title: &str, x: Axis, y: &str, series: Vec<Series>, lines: &[(f64, &str)]) -> Panel {
    let ends = Series::dots("", GREY, lines.iter().map(|(value, _)| [0.0, *value]).collect());
    let all: Vec<Series> = series.iter().chain([&ends]).cloned().collect();
    let references = lines.iter().map(|(value, label)| Reference::dashed(*value, (*label).into())).collect();
    Panel { title: title.into(), x, y: around(y, &all), series, band: None, references }
}

/// Panels next to each other, two or three in a row.
fn beside(panels: Vec<Panel>) -> Figure {
    let (columns, size) = match panels.len() {
        1 => (1, [WIDTH, 340.0]),
        3 => (3, [WIDTH / 3.0, 300.0]),
        _ => (2, [WIDTH / 2.0, 320.0]),
    };
    Figure::Panels(Panels { columns, size, panels })
}

fn categories(label: &str, names: impl IntoIterator<Item = impl Into<String>>) -> Axis {
    Axis::categories(label, names.into_iter().map(Into::into).collect())
}

/// Error of each case that has one, with its uncertainty, per cent.
fn overview(page: &Page) -> Figure {
    let table = page.table("Overview", 0);
    let [number, error, uncertainty] = ["no.", "error", "uncertainty"].map(|name| table.column(name));
    let of =
        |row: &Vec<String>| Some((row[number].clone(), value(&row[error])?.mean, value(&row[uncertainty])));
    let rows: Vec<_> = table.rows.iter().filter_map(of).collect();
    let points = rows.iter().enumerate().map(|(i, row)| [i as f64 + 0.5, row.1]).collect();
    let bands = rows.iter().map(|row| row.2.map_or(0.0, |v| v.mean)).collect();
    let errors = measured("error, with the uncertainty of the computed value", 0, (points, bands));
    let x = categories("number in the table", rows.iter().map(|row| row.0.clone()));
    beside(vec![with_references("", x, "error, %", vec![errors], &[(0.0, "reference")])])
}

fn ring(page: &Page) -> Figure {
    let table = page.table("Elastic ring in fluid", 0);
    let errors = |name: &str, number: usize, reference: &str, own: &str| {
        let [own, reference] = [own, reference].map(|name| table.column(name));
        let of =
            |row: &Vec<String>| Some((value(&row[own])?.mean / value(&row[reference])?.mean - 1.0) * 100.0);
        let found = table.rows.iter().enumerate().filter_map(|(i, row)| Some([i as f64 + 0.5, of(row)?]));
        Series::dots(name, series(number), found.collect())
    };
    let draw = |title: &str, series| {
        panel(
            title,
            categories("density of the fluid, kg/m³", table.rows.iter().map(|row| row[0].clone())),
            "error, %",
            series,
        )
    };
    beside(vec![
        draw(
            "Frequency of the oval mode",
            vec![
                errors("from theory", 0, "theory of this ring", "frequency"),
                errors("from the published value", 1, "published", "frequency"),
            ],
        ),
        draw(
            "Its ratio to that without fluid",
            vec![errors("", 0, "theory", "ratio"), errors("", 1, "its ratio", "ratio")],
        ),
    ])
}

fn tube(page: &Page) -> Figure {
    let table = page.table("Pressure pulse in a flexible tube", 0);
    let names = ["as published", "half windows", "pressure / 100", "BDF2", "Euler", "Moens, Korteweg"];
    let draw = |title: &str, y: &str, column: &str| {
        let (points, _) = across(table.rows.iter().map(|row| &row[table.column(column)]));
        let (own, published) = points.into_iter().partition(|p: &[f64; 2]| p[0] < 3.0);
        let series = vec![
            Series::dots("Ripstop", series(0), own),
            Series::dots("published, theory", series(1), published),
        ];
        panel(title, categories("", names), y, series)
    };
    let panels = vec![
        draw("Peak at mid-length", "displacement, mm", "peak"),
        draw("Speed of the pulse", "speed, m/s", "speed"),
    ];
    Figure::Panels(Panels { columns: 1, size: [WIDTH, 260.0], panels })
}

fn flag(page: &Page) -> Figure {
    let table = page.table("Inverted flag", 0);
    let kappa = "$`\\kappa`$";
    let mut own = measured("Ripstop", 0, table.points(kappa, "Ripstop"));
    let note = |row: &Vec<String>| format!("{} cells, box of {}", row[0], row[1]);
    own.notes = table.rows.iter().map(note).enumerate().collect();
    let series = vec![own, measured("thin-airfoil theory", 1, table.points(kappa, "thin-airfoil"))];
    let x = Axis::around("stiffness κ", false, [0.0, 1.1].into_iter());
    beside(vec![panel("", x, "deflection of the leading edge, m", series)])
}

fn drag(page: &Page) -> Figure {
    let table = page.table("Drag coefficients of canopy types", 0);
    let short = |row: &Vec<String>| {
        let name = row[0].split([',', '(']).next().unwrap_or_default().trim();
        name.replace("hemispherical", "hemisph.")
            .replace("disk-gap-band", "disk-gap")
            .replace("extended", "ext.")
    };
    let of = |column: &str| across(table.rows.iter().map(|row| &row[table.column(column)]));
    let range = |(i, row): (usize, &Vec<String>)| match values(&row[table.column("handbook")])[..] {
        [low, high] => Some((i as f64 + 0.65, [low.mean, high.mean])),
        _ => None,
    };
    let handbook: Vec<_> = table.rows.iter().enumerate().filter_map(range).collect();
    let series = vec![
        measured("cells of D0/30", 5, of("D0/30")),
        measured("D0/45", 2, of("D0/45")),
        measured("D0/60", 0, of("D0/60")),
        ranges("handbook", 1, &handbook),
    ];
    beside(vec![panel("", categories("", table.rows.iter().map(short)), "drag coefficient on S0", series)])
}

fn opening_at_40(page: &Page) -> Figure {
    let heading = "Opening of a flat circular canopy at 40 m/s";
    let (factors, history) = (page.table(heading, 0), page.table(heading, 1));
    let factor = with_references(
        "Inflation factor",
        categories("mass ratio; infinite: on two grids", ["0.10", "0.50", "2.50", "inf.", "inf., fine"]),
        "force coefficient over the settled one",
        vec![measured("", 0, across(factors.row("**over the settled drag")[1..].iter()))],
        &[(1.5, "tunnel"), (1.54, "predicted"), (1.6, "predicted")],
    );
    let (force, _) = history.points("time", "force");
    let time = Axis::spanning("time, s", force.iter().map(|p| p[0]));
    let force = vec![Series::curve("", series(0), force)];
    beside(vec![factor, panel("Force of the risers at a mass ratio of 0.5", time, "force, N", force)])
}

fn openings_at_20(page: &Page) -> Figure {
    let heading = "Openings at 20 m/s";
    let (histories, table) = (page.table(heading, 0), page.table(heading, 1));
    let types = ["ringsail", "flat circular", "conical", "ringslot"];
    let draw = |y: &str, column: usize| {
        let curves = types.iter().enumerate().map(|(k, name)| {
            let (points, _) = histories.at(0, 3 * k + column);
            // One legend for all panels.
            let name = if column == 1 { name } else { "" };
            Series { mark: Mark::Dot, ..Series::curve(name, series(k), points) }
        });
        panel("", Axis::around("time, s", false, [0.0, 7.0].into_iter()), y, curves.collect())
    };
    // "filled in, s; filling constant (handbook)".
    let constants = |index: usize| {
        let of = |(i, cell): (usize, &String)| Some([i as f64 + 0.5, values(cell).get(index)?.mean]);
        table.row("filled in")[1..].iter().enumerate().filter_map(of).collect()
    };
    let filling = vec![
        Series::dots("filling constant", series(5), constants(1)),
        Series::dots("of the handbook", GREY, constants(2)),
    ];
    let names = table.names[1..].iter().map(|name| name.replace("flat circular", "flat"));
    beside(vec![
        draw("speed, m/s", 1),
        draw("force of the risers, N", 2),
        draw("projected area, m²", 3),
        panel("", categories("", names), "filling constant", filling),
    ])
}

fn disk(page: &Page) -> Figure {
    let mut table = page.table("Membrane disk across a stream", 0);
    let load = "q D/(E h)";
    let x = || Axis::around(load, false, [0.0, 0.42].into_iter());
    let height = vec![
        measured("in the stream", 0, table.points(load, "w/a in the stream")),
        measured("under a uniform pressure", 1, table.points(load, "w/a under")),
    ];
    table.rows.retain(|row| !row[0].contains("shape"));
    let drag = with_references(
        "Drag coefficient",
        x(),
        "drag coefficient on the flat area",
        vec![measured("", 0, table.points(load, "drag"))],
        &[(1.17, "rigid disk"), (1.42, "cup")],
    );
    beside(vec![panel("Height of the middle over the radius", x(), "w/a", height), drag])
}

fn disk_gap_band(page: &Page) -> Figure {
    let table = page.table("Stability of a disk-gap-band canopy", 0);
    let draw = |title: &str, [first, second]: [usize; 2], [a, b]: [&str; 2]| {
        let x = Axis::around("angle of attack, degrees", false, [0.0, 30.0].into_iter());
        panel(
            title,
            x,
            "coefficient",
            vec![measured(a, 0, table.at(0, first)), measured(b, 1, table.at(0, second))],
        )
    };
    beside(vec![
        draw("Normal force", [1, 4], ["MIL-C-7020 III", "F-111"]),
        draw("Moment", [3, 6], ["", ""]),
        draw("Tangential force", [2, 5], ["", ""]),
    ])
}

/// Curves of the normal force and the moment.
fn stability(table: &Table) -> Vec<Panel> {
    let draw = |title: &str, column: &str| {
        let x = Axis::around("angle of attack, degrees", false, [0.0, 40.0].into_iter());
        let curve = vec![measured("", 0, table.points("angle", column))];
        with_references(title, x, "coefficient", curve, &[(0.0, "")])
    };
    vec![draw("Normal force", "$C_N$"), draw("Moment", "$C_m$")]
}

fn extended_skirt(page: &Page) -> Figure {
    beside(stability(&page.table("Static stability of an extended-skirt canopy", 0)))
}

fn personnel(page: &Page) -> Figure {
    let heading = "Descent of a personnel parachute";
    let speeds = page.table(heading, 0);
    let row = speeds.row("descent speed");
    let settled = values(&row[1]).into_iter().find(|v| v.half > 0.0).expect("a speed with its interval");
    let published: Vec<f64> = values(&row[2]).iter().map(|v| v.mean).collect();
    let series = vec![
        measured("Ripstop, 2.2 to 21.2 s", 0, (vec![[0.5, settled.mean]], vec![settled.half])),
        Series::dots("maker", series(1), vec![[1.5, published[0]]]),
        ranges(
            "T-10D, T-10C",
            2,
            &[(2.5, [published[1], published[2]]), (3.5, [published[3], published[4]])],
        ),
    ];
    let names = ["Ripstop", "maker", "T-10D", "T-10C"];
    let mut panels = vec![panel("Speed of the descent", categories("", names), "speed, m/s", series)];
    panels.extend(stability(&page.table(heading, 1)));
    beside(panels)
}
