//! Tables of a page of the documentation.

use std::path::PathBuf;

use regex::Regex;

/// A number with the half width of its interval, if it has one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Value {
    pub mean: f64,
    pub half: f64,
}

/// A table: names of its columns, and rows.
#[derive(Clone, Debug, Default)]
pub struct Table {
    pub names: Vec<String>,
    pub rows: Vec<Vec<String>>,
}

/// The page of validation.
pub struct Page {
    text: String,
}

/// The repository.
pub fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// Numbers of a cell in order: "0.647 ± 0.010", "8 376", "(0.601)", "-0.25 %".
pub fn values(cell: &str) -> Vec<Value> {
    let number = r"-?\d+(?: \d{3})*(?:\.\d+)?";
    let pattern = Regex::new(&format!(r"({number})(?: ± ({number}))?")).expect("a pattern");
    let parse = |text: &str| text.replace(' ', "").parse().expect("digits");
    // "T-10" is a name.
    let names = Regex::new(r"[A-Za-z]-\d+").expect("a pattern");
    let cell = names.replace_all(cell, "");
    let found = pattern.captures_iter(&cell);
    found.map(|c| Value { mean: parse(&c[1]), half: c.get(2).map_or(0.0, |m| parse(m.as_str())) }).collect()
}

/// The first number of a cell.
pub fn value(cell: &str) -> Option<Value> {
    values(cell).first().copied()
}

impl Page {
    pub fn read() -> Self {
        let path = root().join("docs/records/validation.md");
        Self { text: std::fs::read_to_string(path).expect("the page of validation") }
    }

    /// Whether it shows the picture at this place.
    pub fn shows(&self, picture: &str) -> bool {
        self.text.contains(&format!("]({picture})"))
    }

    /// Headings of the sections that show no picture.
    pub fn sections_without_a_picture(&self) -> Vec<&str> {
        let sections = self.text.split("\n## ").skip(1);
        let without = sections.filter(|text| !text.contains("](../pictures/"));
        without.filter_map(|text| text.lines().next()).collect()
    }

    /// The `index`-th table of the section with this heading.
    pub fn table(&self, heading: &str, index: usize) -> Table {
        let after = self.text.split_once(&format!("\n## {heading}\n")).map(|(_, rest)| rest);
        let section = after.unwrap_or_else(|| panic!("a section {heading}"));
        let section = section.split("\n## ").next().unwrap_or_default();
        let lines: Vec<&str> = section.lines().map(str::trim).collect();
        let tables = lines.split(|line| !line.starts_with('|')).filter(|lines| lines.len() > 2);
        let lines = tables.into_iter().nth(index).unwrap_or_else(|| panic!("{heading}: no table {index}"));
        let cells = |line: &str| -> Vec<String> {
            line.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()
        };
        Table { names: cells(lines[0]), rows: lines[2..].iter().map(|line| cells(line)).collect() }
    }
}

impl Table {
    /// Number of the column whose name is `name`, or starts with it.
    pub fn column(&self, name: &str) -> usize {
        let same = self.names.iter().position(|n| n == name);
        let found = same.or_else(|| self.names.iter().position(|n| n.starts_with(name)));
        found.unwrap_or_else(|| panic!("no column {name} in {:?}", self.names))
    }

    /// Points of two columns and the half widths of the intervals of the second, of the rows that have both.
    pub fn points(&self, x: &str, y: &str) -> (Vec<[f64; 2]>, Vec<f64>) {
        self.at(self.column(x), self.column(y))
    }

    /// [`Self::points`] of columns by number.
    pub fn at(&self, x: usize, y: usize) -> (Vec<[f64; 2]>, Vec<f64>) {
        let of_row = |row: &Vec<String>| {
            let (x, y) = (value(row.get(x)?)?, value(row.get(y)?)?);
            Some(([x.mean, y.mean], y.half))
        };
        self.rows.iter().filter_map(of_row).unzip()
    }

    /// The row whose first cell starts with `name`.
    pub fn row(&self, name: &str) -> &[String] {
        let found = self.rows.iter().find(|row| row[0].starts_with(name));
        found.unwrap_or_else(|| panic!("no row {name}"))
    }
}
