//! The figures of the page of validation show the numbers of its tables, and the drawings of the cases their structures.
//!
//! After a change: `RIPSTOP_WRITE_DOCS=1 cargo test --release -p ripstop-tests --test validation_figures`.

mod drawings;
mod figures;
mod page;

use std::fs;
use std::path::Path;

// The crate; the module of this name draws with it.
use ::figures::chart::Figure;
use page::{Page, Value, root, values};

#[test]
fn numbers_of_cells_have_thousands_signs_and_intervals() {
    let value = |mean, half| Value { mean, half };
    assert_eq!(values("**0.668 ± 0.002**"), [value(0.668, 0.002)]);
    assert_eq!(values("(-0.001)"), [value(-0.001, 0.0)]);
    assert_eq!(values("5 598; 0.300; 0.137"), [value(5598.0, 0.0), value(0.3, 0.0), value(0.137, 0.0)]);
    assert_eq!(values("0.75 to 0.80"), [value(0.75, 0.0), value(0.8, 0.0)]);
}

/// Whether two drawings differ by at most a step of their coordinates: mathematical functions of other systems round differently.
fn are_same(a: &str, b: &str) -> bool {
    let digits = |c: char| c.is_ascii_digit();
    let words = |text: &str| -> Vec<String> {
        text.split(digits).filter(|w| !w.is_empty()).map(Into::into).collect()
    };
    let numbers = |text: &str| -> Vec<i64> {
        text.split(|c| !digits(c)).filter(|n| !n.is_empty()).map(|n| n.parse().unwrap_or(i64::MAX)).collect()
    };
    let (of_a, of_b) = (numbers(a), numbers(b));
    words(a) == words(b)
        && of_a.len() == of_b.len()
        && of_a.iter().zip(&of_b).all(|(a, b)| (a - b).abs() <= 1)
}

/// Compares a figure with the committed file, or writes it where `RIPSTOP_WRITE_DOCS` is set.
fn compare_or_write(figure: &Figure, file: &Path) {
    let drawn = figure.svg().file();
    if std::env::var_os("RIPSTOP_WRITE_DOCS").is_some() {
        fs::create_dir_all(file.parent().expect("a folder")).expect("a folder");
        fs::write(file, &drawn).expect("written");
    }
    assert!(
        are_same(&fs::read_to_string(file).unwrap_or_default(), &drawn),
        "{} is out of date: RIPSTOP_WRITE_DOCS=1 cargo test --release -p ripstop-tests --test validation_figures",
        file.display()
    );
}

#[test]
fn drawings_are_compared_to_a_step() {
    assert!(are_same("<line x1=\"100\" y1=\"-20\"/>", "<line x1=\"101\" y1=\"-20\"/>"));
    assert!(!are_same("<line x1=\"100\"/>", "<line x1=\"102\"/>"));
    assert!(!are_same("<line x1=\"100\"/>", "<line y1=\"100\"/>") && !are_same("a 1 2", "a 1"));
}

/// Every section has a figure, and each figure is what the tables say.
#[test]
fn figures_show_the_tables() {
    let page = Page::read();
    for (name, figure) in figures::all(&page) {
        assert!(page.shows(&format!("../pictures/validation/{name}.svg")), "the page does not show {name}");
        compare_or_write(&figure, &root().join("docs/pictures/validation").join(format!("{name}.svg")));
    }
    let without = page.sections_without_a_picture();
    assert!(without.is_empty(), "no figure in {without:?}");
}

#[test]
fn cases_have_drawings() {
    for entry in fs::read_dir(root().join("cases/validation")).expect("the cases") {
        let folder = entry.expect("a case").path();
        let page = fs::read_to_string(folder.join("README.md")).expect("a page");
        assert!(page.contains("](drawing.svg)"), "{} shows no drawing", folder.display());
        compare_or_write(&drawings::of_case(&folder), &folder.join("drawing.svg"));
    }
}
