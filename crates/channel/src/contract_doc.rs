//! The tables of `docs/contract.md` are made from the code: a test compares them.
//!
//! After a change: `RIPSTOP_WRITE_DOCS=1 cargo test -p channel contract_doc`.

use std::fmt::Write as _;
use std::mem::{offset_of, size_of};

use case::Role;

use crate::header::{Header, Kind, MAGIC, Unit, role_code};
use crate::transport::{ChannelSpec, HEADER_TYPE};
use crate::wire::Roster;
use crate::{CONTRACT_VERSION, LOAD_WIDTH, STATS, Stats, Window};

const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/contract.md");

/// Rows of a struct: offset, bytes, type, name; and the sum of its bytes.
macro_rules! fields {
    ($base:expr, $prefix:expr, $of:ident { $($name:ident: $type:ty),* $(,)? }) => {{
        let mut rows = Vec::new();
        $(rows.push((
            $base + offset_of!($of, $name),
            size_of::<$type>(),
            stringify!($type).to_string(),
            format!("{}{}", $prefix, stringify!($name)),
        ));)*
        // Names each field: a field that is added to the code breaks this line.
        let _ = |x: $of| { let $of { $($name: _),* } = x; };
        rows
    }};
}

fn header_fields() -> Vec<(usize, usize, String, String)> {
    let mut rows = fields!(
        0,
        "",
        Header {
            magic: u64,
            contract: u32,
            kind: u32,
            session: u64,
            role: u32,
            rank: u32,
            sequence: u64,
            unit: u32,
            reserved: u32,
            length: u64,
            bytes: u64,
            window: Window,
            stats: Stats,
        }
    );
    rows.retain(|row| row.3 != "window" && row.3 != "stats");
    rows.extend(fields!(
        offset_of!(Header, window),
        "window.",
        Window {
            index: u64,
            iteration: u64,
            substeps: u64,
            time: f64,
            dt: f64,
            frame_velocity: [f64; 3],
            frame_acceleration: [f64; 3],
        }
    ));
    rows.extend(fields!(offset_of!(Header, stats), "stats.", Stats { busy_s: f64, values: [f64; STATS] }));
    rows
}

fn header_table() -> String {
    let mut text = String::from("| offset | bytes | type | field |\n|---:|---:|---|---|\n");
    for (offset, bytes, kind, name) in header_fields() {
        let _ = writeln!(text, "| {offset} | {bytes} | `{kind}` | `{name}` |");
    }
    let _ = writeln!(text, "| {} | | | end |", size_of::<Header>());
    text
}

fn constants() -> String {
    let mut text = String::from("| name | value |\n|---|---|\n");
    let _ = writeln!(text, "| contract version | {CONTRACT_VERSION} |");
    let _ = writeln!(text, "| `magic` | `{MAGIC:#018x}` (the bytes `RIPSTOP` and a zero) |");
    let _ = writeln!(text, "| type name of the header | `{HEADER_TYPE}` |");
    let _ = writeln!(text, "| numbers in `stats.values` | {STATS} |");
    let _ = writeln!(text, "| numbers for the load on a face | {LOAD_WIDTH} |");
    let _ = writeln!(text, "| `role` of the coupler | 0 |");
    for role in Role::ALL {
        let _ = writeln!(text, "| `role` of `{}` | {} |", role.name(), role_code(role));
    }
    text
}

fn kinds() -> String {
    let mut text = String::from("| code | kind |\n|---:|---|\n");
    for kind in Kind::ALL {
        let _ = writeln!(text, "| {} | `{kind:?}` |", kind as u32);
    }
    text
}

fn units() -> String {
    let mut text =
        String::from("| code | unit | numbers in a row | input of | output of |\n|---:|---|---:|---|---|\n");
    let names = |of: fn(Role) -> Unit, unit| {
        let roles = Role::ALL.into_iter().filter(|&r| of(r) == unit).map(Role::name);
        roles.collect::<Vec<_>>().join(", ")
    };
    for unit in Unit::ALL {
        let (input, output) = (names(Unit::of_input, unit), names(Unit::of_output, unit));
        let _ = writeln!(text, "| {} | `{unit:?}` | {} | {input} | {output} |", unit as u32, unit.width());
    }
    text
}

fn services() -> String {
    let roster = Roster(vec![(Role::Structure, 1), (Role::Flow, 2), (Role::Mesh, 2)]);
    let mut text =
        String::from("| service | pattern | from | receivers | full buffer |\n|---|---|---|---:|---|\n");
    let mut row = |(name, spec): (String, ChannelSpec), from: &str| {
        let full = if spec.newest_wins { "newest replaces oldest" } else { "refused, an error" };
        let _ = writeln!(text, "| `{name}` | publish-subscribe | {from} | {} | {full} |", spec.receivers);
    };
    for (role, ranks) in roster.0.clone() {
        row(roster.command(role), "coupler");
        for rank in 0..ranks {
            row(roster.answer(role, rank), &format!("{} {rank}", role.name()));
            row(roster.layout(role, rank), &format!("{} {rank}", role.name()));
            if role == Role::Mesh {
                row(roster.grid(rank), &format!("{} {rank}", role.name()));
            }
        }
    }
    let (name, sleepers, ringers) = roster.coupler_bell();
    let _ = writeln!(text, "| `{name}` | event | {ringers} notifiers | {sleepers} | |");
    for role in Role::ALL {
        let (name, sleepers, ringers) = roster.bell(role);
        let _ = writeln!(text, "| `{name}` | event | {ringers} notifiers | {sleepers} | |");
    }
    text
}

/// The statistics of a role, from the doc comments of `message.rs`.
fn stats(role: &str) -> String {
    let source = include_str!("message.rs");
    let start = source.find(&format!("pub mod {role}_stats {{")).expect("the module");
    let module = &source[start..];
    let module = &module[..module.find("\n}").expect("its end")];
    let mut text = String::from("| index | name | meaning |\n|---:|---|---|\n");
    let mut doc = String::new();
    for line in module.lines().map(str::trim) {
        if let Some(more) = line.strip_prefix("///") {
            doc += more;
        } else if let Some(item) = line.strip_prefix("pub const ") {
            let (name, rest) = item.split_once(": usize = ").expect("an index");
            let index = rest.trim_end_matches(';');
            let _ = writeln!(text, "| {index} | `{name}` | {} |", doc.trim());
            doc.clear();
        }
    }
    text
}

#[test]
fn the_contract_document_says_what_the_code_does() {
    let mut document = std::fs::read_to_string(DOCUMENT).expect("docs/contract.md");
    let old = document.clone();
    let tables = [
        ("constants", constants()),
        ("header", header_table()),
        ("kinds", kinds()),
        ("units", units()),
        ("services", services()),
        ("structure-stats", stats("structure")),
        ("flow-stats", stats("flow")),
        ("mesh-stats", stats("mesh")),
    ];
    for (name, table) in tables {
        let (begin, end) = (format!("<!-- {name}: from the code -->\n"), format!("<!-- end of {name} -->"));
        let from = document.find(&begin).unwrap_or_else(|| panic!("{begin} is missing")) + begin.len();
        let to = from + document[from..].find(&end).unwrap_or_else(|| panic!("{end} is missing"));
        document.replace_range(from..to, &table);
    }
    if std::env::var_os("RIPSTOP_WRITE_DOCS").is_some() {
        std::fs::write(DOCUMENT, &document).expect("written");
    } else if old != document {
        let line = old.lines().zip(document.lines()).find(|(a, b)| a != b);
        panic!(
            "docs/contract.md differs from the code (document, code): {line:?}\n\
             a change of the contract needs a new version; then RIPSTOP_WRITE_DOCS=1 cargo test -p channel"
        );
    }
}

#[test]
fn headers_have_no_gaps() {
    let mut end = 0;
    for (offset, bytes, _, name) in header_fields() {
        assert_eq!(offset, end, "a gap before {name}");
        end += bytes;
    }
    assert_eq!((end, size_of::<Header>(), align_of::<Header>()), (288, 288, 8));
}

/// The layout of version 1, written out: a change of it must change the version.
#[test]
fn version_1_is_what_it_was() {
    assert_eq!(CONTRACT_VERSION, 1);
    let offsets: Vec<usize> = header_fields().iter().map(|f| f.0).collect();
    let expected = [0, 8, 12, 16, 24, 28, 32, 40, 44, 48, 56, 64, 72, 80, 88, 96, 104, 128, 152, 160];
    assert_eq!(offsets, expected);
    assert_eq!(Kind::ALL.map(|k| k as u32), std::array::from_fn(|i| i as u32 + 1));
}
