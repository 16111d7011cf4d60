//! The tables of `docs/reference/contract.md` and of the Python kit are generated from the code; tests compare them.
//!
//! After a change: `RIPSTOP_WRITE_DOCS=1 cargo test -p channel contract_doc`.

mod participants;

use std::fmt::Write as _;
use std::mem::{offset_of, size_of};

use case::Role;

use crate::header::{COUPLER, Header, Kind, MAGIC, Unit, role_code};
use crate::membership::LIVENESS_INTERVAL;
use crate::serve::TEXT_WORDS;
use crate::session::{KEY_DIGITS, LOCK, MEMORY};
use crate::transport::{ALIGNMENT, BUFFER, ChannelSpec, HEADER_TYPE};
use crate::watchdog::Watchdog;
use crate::wire::RankCounts;
use crate::{CONTRACT_VERSION, LOAD_WIDTH, STATS, Stats, Window};

const PYTHON: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../python/ripstop/table.py");
const DOCUMENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/reference/contract.md");

/// Rows of a struct: offset, bytes, type, name.
macro_rules! fields {
    ($base:expr, $prefix:expr, $of:ident { $($name:ident: $type:ty),* $(,)? }) => {{
        let mut rows = Vec::new();
        $(rows.push((
            $base + offset_of!($of, $name),
            size_of::<$type>(),
            stringify!($type).to_string(),
            format!("{}{}", $prefix, stringify!($name)),
        ));)*
        // Names each field: a new field of the struct breaks this line.
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
    let rank_counts = RankCounts(vec![(Role::Structure, 1), (Role::Flow, 2), (Role::Mesh, 2)]);
    let mut text =
        String::from("| service | pattern | from | receivers | full buffer |\n|---|---|---|---:|---|\n");
    let mut row = |(name, spec): (String, ChannelSpec), from: &str| {
        let full = if spec.newest_wins { "newest replaces oldest" } else { "refused, an error" };
        let _ = writeln!(text, "| `{name}` | publish-subscribe | {from} | {} | {full} |", spec.receivers);
    };
    for (role, ranks) in rank_counts.0.clone() {
        row(rank_counts.command(role), "coupler");
        for rank in 0..ranks {
            row(rank_counts.answer(role, rank), &format!("{} {rank}", role.name()));
            row(rank_counts.layout(role, rank), &format!("{} {rank}", role.name()));
            if role == Role::Mesh {
                row(rank_counts.grid(rank), &format!("{} {rank}", role.name()));
            }
        }
    }
    let (name, listeners, notifiers) = rank_counts.coupler_event();
    let _ = writeln!(text, "| `{name}` | event | {notifiers} notifiers | {listeners} | |");
    for role in Role::ALL {
        let (name, listeners, notifiers) = rank_counts.wake_event(role);
        let _ = writeln!(text, "| `{name}` | event | {notifiers} notifiers | {listeners} | |");
    }
    text
}

/// The statistics of a role, from the doc comments of `message.rs`: index, name, meaning.
fn stats_of(role: &str) -> Vec<(usize, String, String)> {
    let source = include_str!("message.rs");
    let start = source.find(&format!("pub mod {role}_stats {{")).expect("the module");
    let module = &source[start..];
    let module = &module[..module.find("\n}").expect("its end")];
    let mut rows = Vec::new();
    let mut doc = String::new();
    for line in module.lines().map(str::trim) {
        if let Some(more) = line.strip_prefix("///") {
            doc += more;
        } else if let Some(item) = line.strip_prefix("pub const ") {
            let (name, rest) = item.split_once(": usize = ").expect("an index");
            let index = rest.trim_end_matches(';').parse().expect("a number");
            rows.push((index, name.to_string(), doc.trim().to_string()));
            doc.clear();
        }
    }
    rows
}

fn stats(role: &str) -> String {
    let mut text = String::from("| index | name | meaning |\n|---:|---|---|\n");
    for (index, name, meaning) in stats_of(role) {
        let _ = writeln!(text, "| {index} | `{name}` | {meaning} |");
    }
    text
}

/// Statistics of three numbers, with the suffixes `_x`, `_y` and `_z` in Python.
const VECTORS: [&str; 5] = ["FORCE", "MOMENT", "SUPPORT_FORCE", "MOMENTUM", "AIR_FORCE"];

/// `SendLayout` as `SEND_LAYOUT`.
fn screaming_snake_case(name: &str) -> String {
    let mut text = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push('_');
        }
        text.extend(letter.to_uppercase());
    }
    text
}

/// A dictionary in Python, one entry per line.
fn dictionary(name: &str, entries: impl IntoIterator<Item = (String, String)>) -> String {
    let mut text = format!("{name} = {{\n");
    for (key, value) in entries {
        let _ = writeln!(text, "    \"{key}\": {value},");
    }
    text + "}\n"
}

/// Fields of a struct for Python: offset, name, type of a number, count.
fn python_fields(name: &str, prefix: &str) -> String {
    let mut text = format!("{name} = [\n");
    for (offset, bytes, kind, field) in header_fields() {
        let at = field.strip_prefix(prefix).filter(|rest| !rest.contains('.'));
        let Some(field) = at else { continue };
        let number = kind.trim_start_matches('[').split(';').next().expect("a type");
        let count = bytes / if number == "u32" { 4 } else { 8 };
        let _ = writeln!(text, "    ({offset}, \"{field}\", \"{number}\", {count}),");
    }
    text + "]\n"
}

fn python_services() -> String {
    let rank_counts = RankCounts(vec![(Role::Flow, 9)]);
    let (role, rank) = (Role::Flow, 7);
    let names = [
        ("command", rank_counts.command(role).0),
        ("answer", rank_counts.answer(role, rank).0),
        ("layout", rank_counts.layout(role, rank).0),
        ("grid", rank_counts.grid(rank).0),
        ("bell", rank_counts.wake_event(role).0),
        ("coupler_bell", rank_counts.coupler_event().0.to_string()),
    ];
    let place = |name: String| name.replace(role.name(), "{role}").replace('7', "{rank}");
    dictionary("SERVICES", names.map(|(key, name)| (key.to_string(), format!("\"{}\"", place(name)))))
}

fn python_statistics() -> String {
    let mut text = String::from("STATISTICS = {\n");
    for role in Role::ALL {
        let _ = writeln!(text, "    \"{}\": {{", role.name());
        for (index, name, _) in stats_of(role.name()) {
            let key = name.to_lowercase();
            if VECTORS.contains(&name.as_str()) {
                for (k, axis) in ["x", "y", "z"].into_iter().enumerate() {
                    let _ = writeln!(text, "        \"{key}_{axis}\": {},", index + k);
                }
            } else {
                let _ = writeln!(text, "        \"{key}\": {index},");
            }
        }
        text += "    },\n";
    }
    text + "}\n"
}

/// All numbers and names of the contract that the Python kit needs.
fn python() -> String {
    let mut text = String::from(
        "\"\"\"Numbers and names of the contract. Written from the code of crates/channel:\n\
         RIPSTOP_WRITE_DOCS=1 cargo test -p channel contract_doc. Not to be edited.\"\"\"\n\n",
    );
    for (name, value) in [
        ("VERSION", CONTRACT_VERSION.to_string()),
        ("MAGIC", format!("{MAGIC:#018X}").replace("0X", "0x")),
        ("HEADER_TYPE", format!("{HEADER_TYPE:?}")),
        ("HEADER_BYTES", size_of::<Header>().to_string()),
        ("STATS", STATS.to_string()),
        ("COUPLER", COUPLER.to_string()),
        ("TEXT_WORDS", TEXT_WORDS.to_string()),
        ("BUFFER", BUFFER.to_string()),
        ("ALIGNMENT", ALIGNMENT.to_string()),
        ("LOOK_S", format!("{:?}", LIVENESS_INTERVAL.as_secs_f64())),
        ("GUARDIAN_INTERVAL_S", format!("{:?}", Watchdog::INTERVAL.as_secs_f64())),
        ("GUARDIAN_LOOKS", Watchdog::MAX_MISSED_POLLS.to_string()),
        ("ORPHAN", Watchdog::ORPHAN.to_string()),
        ("MEMORY", format!("{MEMORY:?}")),
        ("LOCK", format!("{LOCK:?}")),
        ("KEY_DIGITS", KEY_DIGITS.to_string()),
    ] {
        let _ = writeln!(text, "{name} = {value}");
    }
    let number = |n: usize| n.to_string();
    let quoted = |unit: Unit| format!("\"{}\"", screaming_snake_case(&format!("{unit:?}")));
    let roles = |of: fn(Role) -> Unit| Role::ALL.map(|r| (r.name().to_string(), quoted(of(r))));
    let unit_name = |u: Unit| screaming_snake_case(&format!("{u:?}"));
    text += &dictionary("ROLES", Role::ALL.map(|r| (r.name().to_string(), role_code(r).to_string())));
    text += &dictionary(
        "KINDS",
        Kind::ALL.map(|k| (screaming_snake_case(&format!("{k:?}")), number(k as usize))),
    );
    text += &dictionary("UNITS", Unit::ALL.map(|u| (unit_name(u), number(u as usize))));
    text += &dictionary("WIDTHS", Unit::ALL.map(|u| (unit_name(u), number(u.width()))));
    text += &dictionary("INPUTS", roles(Unit::of_input));
    text += &dictionary("OUTPUTS", roles(Unit::of_output));
    text += &python_services();
    text += "# Offset in the header, name, type of a number, how many of them.\n";
    text += &python_fields("HEADER", "");
    text += &python_fields("WINDOW", "window.");
    text += &python_fields("ANSWER", "stats.");
    text + &python_statistics()
}

/// The Python kit has all its numbers and names from this file.
#[test]
fn python_table_matches_the_code() {
    let made = python();
    if std::env::var_os("RIPSTOP_WRITE_DOCS").is_some() {
        std::fs::write(PYTHON, made).expect("written");
        return;
    }
    let kept = std::fs::read_to_string(PYTHON).expect("python/ripstop/table.py");
    if kept != made {
        let line = kept.lines().zip(made.lines()).find(|(a, b)| a != b);
        panic!(
            "python/ripstop/table.py differs from the code (Python, code): {line:?}\n\
              RIPSTOP_WRITE_DOCS=1 cargo test -p channel contract_doc regenerates it"
        );
    }
}

#[test]
fn contract_document_matches_the_code() {
    let mut document = std::fs::read_to_string(DOCUMENT).expect("docs/reference/contract.md");
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
            "docs/reference/contract.md differs from the code (document, code): {line:?}\n\
              a change of the contract requires a new version; then run RIPSTOP_WRITE_DOCS=1 cargo test -p channel"
        );
    }
}

#[test]
fn headers_have_no_padding() {
    let mut end = 0;
    for (offset, bytes, _, name) in header_fields() {
        assert_eq!(offset, end, "a gap before {name}");
        end += bytes;
    }
    assert_eq!((end, size_of::<Header>(), align_of::<Header>()), (544, 544, 8));
}

/// The layout of version 5, written out: any change requires a new version.
#[test]
fn layout_of_version_5_is_unchanged() {
    use crate::structure_stats::{AIR_FORCE, LINEAR_S, MOMENTUM, SUPPORT_FORCE};
    assert_eq!((CONTRACT_VERSION, STATS), (5, 48));
    // Up to version 4 the vertical parts of these three vectors were at 24, 25 and 13.
    assert_eq!([LINEAR_S, SUPPORT_FORCE, MOMENTUM, AIR_FORCE], [12, 32, 35, 38]);
    let offsets: Vec<usize> = header_fields().iter().map(|f| f.0).collect();
    let expected = [0, 8, 12, 16, 24, 28, 32, 40, 44, 48, 56, 64, 72, 80, 88, 96, 104, 128, 152, 160];
    assert_eq!(offsets, expected);
    assert_eq!(Kind::ALL.map(|k| k as u32), std::array::from_fn(|i| i as u32 + 1));
}
