//! What a solver program of any language needs, from one table: `docs/reference/participants.md`, the constants of C and Fortran, and the
//! texts about roles in `ripstop.h`, `ripstop.f90` and the crate `ripstop-participant`.

use std::fmt::Write as _;

use case::Role;

use super::{VECTORS, stats_of};
use crate::header::{Unit, role_code};
use crate::{CANOPY_MOTION, CONTRACT_VERSION, LOAD_WIDTH, STATS};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../");
const PAGE: &str = "docs/reference/participants.md";

/// Prefix of the names in C and Fortran.
const PREFIX: &str = "RIPSTOP";

/// Input and output of a role.
struct Convention {
    role: Role,
    input: String,
    output: String,
    sign: &'static str,
    empty: String,
}

/// The rows of the table, with widths from the code.
fn conventions() -> [Convention; 3] {
    let (input, output) = (|r| Unit::of_input(r).width(), |r| Unit::of_output(r).width());
    assert_eq!([input(Role::Structure), output(Role::Flow)], [2 * LOAD_WIDTH, LOAD_WIDTH]);
    [
        Convention {
            role: Role::Structure,
            input: format!(
                "`[faces][{}]`: pressure jump and shear traction x, y, z at the start of the window, then at its end, Pa; linear in between",
                input(Role::Structure)
            ),
            output: format!(
                "`[canopy nodes][{}]`: displacement from the unstressed shape, m",
                output(Role::Structure)
            ),
            sign: "a positive jump (inside minus outside) pushes along the area vector of the face",
            empty: "never: in a stage without a flow the load is that of the scene".into(),
        },
        Convention {
            role: Role::Flow,
            input: format!(
                "empty; with the effect `{CANOPY_MOTION}` `[canopy nodes][{}]`, as the mesh",
                input(Role::Flow)
            ),
            output: format!(
                "`[faces][{}]`: pressure jump (inside minus outside) and shear traction x, y, z summed over both sides, at the end of the \
                 window, Pa",
                output(Role::Flow)
            ),
            sign: "the force on the canopy is jump times area vector plus traction times area",
            empty: format!(
                "the moved grid is empty where no mesh-mover runs: the canopy is held still, or the effect `{CANOPY_MOTION}` moves it through \
                 the flow's own grid"
            ),
        },
        Convention {
            role: Role::Mesh,
            input: format!(
                "`[canopy nodes][{}]`: displacement from the unstressed shape at the end of the window, m",
                input(Role::Mesh)
            ),
            output: format!(
                "`[grid nodes][{}]`: position, m, and velocity, m/s, in the falling frame at the end of the window",
                output(Role::Mesh)
            ),
            sign: "the velocity is the second-order backward difference of the positions, first order in the first window",
            empty: "never: a mesh-mover runs only where the canopy moves".into(),
        },
    ]
}

const AREA_VECTOR: &str = "The area vector of a face with the corners a, b, c, d is half of (c - a) x (d - b); triangles repeat their third \
    corner. z points up, and the frame falls with the payload: air at rest comes with minus the velocity of the frame. Rows are numbered \
    over the whole canopy or grid, from 0; each rank has some of the output's rows and the whole input. No number may be NaN or infinite.";

/// The table of roles, in Markdown.
fn roles_markdown() -> String {
    let mut text =
        String::from("| role | input `canopy` | output | sign | when it is empty |\n|---|---|---|---|---|\n");
    for c in conventions() {
        let _ =
            writeln!(text, "| {} | {} | {} | {} | {} |", c.role.name(), c.input, c.output, c.sign, c.empty);
    }
    text + "\n" + AREA_VECTOR + "\n"
}

/// Words in lines of at most 132 characters, each with `prefix`.
fn wrapped(prefix: &str, words: &str) -> String {
    let mut text = String::new();
    let mut line = prefix.to_owned();
    for word in words.split_whitespace() {
        if line.len() + 1 + word.len() > 132 {
            let _ = writeln!(text, "{line}");
            line = prefix.to_owned();
        }
        line = line + " " + word;
    }
    text + &line + "\n"
}

/// The table of roles in comments of a language.
fn roles_comment(prefix: &str) -> String {
    let mut text = String::new();
    for c in conventions() {
        let words = format!(
            "{}: input {}. Output {}. Sign: {}. Empty: {}.",
            c.role.name(),
            c.input,
            c.output,
            c.sign,
            c.empty
        );
        text += &wrapped(prefix, &words.replace('`', ""));
    }
    text + &wrapped(prefix, AREA_VECTOR)
}

/// Unit of a statistic, as its meaning has it.
fn unit(meaning: &str) -> &'static str {
    const UNITS: [(&str, &str); 11] = [
        ("N for each metre", "N/m"),
        ("N/m", "N/m"),
        ("N m", "N m"),
        ("N s", "N s"),
        ("kg/s", "kg/s"),
        ("Pa", "Pa"),
        ("m2", "m2"),
        ("m3", "m3"),
        ("J", "J"),
        ("N", "N"),
        ("s", "s"),
    ];
    let stands = |word: &str| {
        meaning.match_indices(&format!(", {word}")).any(|(at, found)| {
            !meaning[at + found.len()..].starts_with(|c: char| c.is_alphanumeric() || c == '/')
        })
    };
    UNITS.into_iter().find(|(word, _)| stands(word)).map_or("1", |(_, unit)| unit)
}

fn constant(role: Role, name: &str) -> String {
    format!("{PREFIX}_{}_{name}", role.name().to_uppercase())
}

fn statistics() -> String {
    let mut text = String::new();
    for role in Role::ALL {
        let _ = writeln!(
            text,
            "\n### {}\n\n| index | Rust: `{}_stats::` | Python | C, C++, Fortran | unit | meaning |\n|---:|---|---|---|---|---|",
            role.name(),
            role.name()
        );
        for (index, name, meaning) in stats_of(role.name()) {
            let python = name.to_lowercase();
            let python = match VECTORS.contains(&name.as_str()) {
                true => ["x", "y", "z"].map(|axis| format!("`{python}_{axis}`")).join(", "),
                false => format!("`{python}`"),
            };
            let (c, unit) = (constant(role, &name), unit(&meaning));
            let _ = writeln!(text, "| {index} | `{name}` | {python} | `{c}` | {unit} | {meaning} |");
        }
    }
    text
}

const CALLS: &str = "\
| call | Rust: `Participant` | Python: `Participant` | C: `ripstop_program` | C++: `ripstop::Participant` |
|---|---|---|---|---|
| start | constructor, given to `main` | `__init__(run)` | `start` | constructor |
| scene, meshes | `Run::data` | `run.case()` | `ripstop_get_structure`, `ripstop_get_grid`, `ripstop_number` | `Data` |
| rows of the output | `output_rows` | `output_rows` | `output_rows` | `output_rows` |
| rows of the moved grid | `grid_rows` | `grid_rows` | `grid_rows` | `grid_rows` |
| one window | `advance` | `advance` | `advance` | `advance` |
| window accepted | `accept` | `accept` | `accept` | `accept` |
| save the state | `save` | `save` | `save` | `save` |
| saved state to start from | `Run::state` | `run.state(case, role)` | `restore` | `restore` |
| pictures | `snapshot` | `snapshot` | `snapshot` | `snapshot` |
| an error | `Fault` | `raise ripstop.Fault` | `return ripstop_fault(...)` | `throw ripstop::Fault` |
";

fn page() -> String {
    format!(
        "# Solver programs in any language\n\n<!-- Generated. After a change of the code: RIPSTOP_WRITE_DOCS=1 cargo test --release -p channel \
         contract_doc -->\n\nWhat a program that replaces a solver is given, what it returns, and the statistics it may report: the same in each \
         language. [How to replace a solver](../how-to/replace-a-solver.md) has the steps, the [contract](contract.md) the messages.\n\n\
         ## Input and output\n\n{}\n## Calls\n\nFortran has the functions of C: the components of `ripstop_program` are `c_funptr`. A window that is not \
         accepted has no call: the next `advance` starts from the last accepted state.\n\n{CALLS}\n## Statistics\n\nA program reports those it \
         knows; all others are 0. The constants of C count from 0, those of Fortran from 1. The numbers of a vector follow each other: x, y, z. \
         Unit 1: a count, a ratio or a code.\n{}",
        roles_markdown(),
        statistics()
    )
}

/// Constants of the contract and the statistics, for C.
fn constants_of_c() -> String {
    let mut text = format!(
        "enum {{\n    {PREFIX}_CONTRACT = {CONTRACT_VERSION}, /* version of the contract */\n    {PREFIX}_STATS = {STATS} /* numbers in \
         `statistics` */\n}};\n\n/* Roles. */\nenum {{\n"
    );
    for role in Role::ALL {
        let _ = writeln!(text, "    {PREFIX}_ROLE_{} = {},", role.name().to_uppercase(), role_code(role));
    }
    text = text.trim_end_matches(",\n").to_owned() + "\n};\n";
    for role in Role::ALL {
        let _ = writeln!(
            text,
            "\n/* Indices into `statistics` of the {}. The numbers of a vector follow each other: x, y, z. */\nenum {{",
            role.name()
        );
        let all = stats_of(role.name());
        for (at, (index, name, meaning)) in all.iter().enumerate() {
            let comma = if at + 1 < all.len() { "," } else { "" };
            let meaning = meaning.replace('`', "");
            let _ = writeln!(text, "    {} = {index}{comma} /* {meaning} */", constant(role, name));
        }
        text += "};\n";
    }
    text
}

/// The same for Fortran, whose arrays start at 1.
fn constants_of_fortran() -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: usize, unit: &str| {
        let _ = writeln!(text, "  integer(c_int), parameter :: {name} = {value}{unit}");
    };
    line(&format!("{PREFIX}_CONTRACT"), CONTRACT_VERSION as usize, "");
    line(&format!("{PREFIX}_STATS"), STATS, "");
    for role in Role::ALL {
        line(&format!("{PREFIX}_ROLE_{}", role.name().to_uppercase()), role_code(role) as usize, "");
    }
    for role in Role::ALL {
        for (index, name, meaning) in stats_of(role.name()) {
            line(&constant(role, &name), index + 1, &format!("  ! {}", unit(&meaning)));
        }
    }
    text
}

/// The lines between those that contain `{name}: from the code` and `end of {name}` become `text`.
fn replace(document: &mut String, name: &str, text: &str) {
    let place = |words: &str| document.find(words).unwrap_or_else(|| panic!("no `{words}`"));
    let begin = place(&format!("{name}: from the code"));
    let begin = begin + document[begin..].find('\n').expect("a line") + 1;
    let end = document[..place(&format!("end of {name}"))].rfind('\n').expect("a line before") + 1;
    document.replace_range(begin..end, text);
}

/// The file with the texts of the code in it; `None` where that is what it has.
fn changed(file: &str, parts: &[(&str, String)]) -> Option<String> {
    let kept = std::fs::read_to_string(format!("{ROOT}{file}")).unwrap_or_default();
    let mut made = kept.clone();
    parts.iter().for_each(|(name, text)| replace(&mut made, name, text));
    (made != kept).then_some(made)
}

/// As lines of a doc comment.
fn doc(text: &str) -> String {
    text.lines().map(|line| format!("//! {line}").trim_end().to_owned() + "\n").collect()
}

#[test]
fn texts_for_solver_programs_match_the_code() {
    let files = [
        (
            "crates/participant-c/include/ripstop.h",
            vec![("roles", roles_comment(" *")), ("constants", constants_of_c())],
        ),
        (
            "crates/participant-c/fortran/ripstop.f90",
            vec![("roles", roles_comment("!")), ("constants", constants_of_fortran())],
        ),
        ("crates/participant/src/lib.rs", vec![("roles", doc(&roles_markdown()))]),
    ];
    let mut all: Vec<(&str, Option<String>)> =
        files.iter().map(|(file, parts)| (*file, changed(file, parts))).collect();
    let page = page();
    let kept = std::fs::read_to_string(format!("{ROOT}{PAGE}")).unwrap_or_default();
    all.push((PAGE, (kept != page).then_some(page)));
    for (file, made) in all {
        let Some(made) = made else { continue };
        assert!(
            std::env::var_os("RIPSTOP_WRITE_DOCS").is_some(),
            "{file} differs from the code: RIPSTOP_WRITE_DOCS=1 cargo test --release -p channel contract_doc regenerates it"
        );
        std::fs::write(format!("{ROOT}{file}"), made).expect("written");
    }
}

#[test]
fn units_are_those_of_the_meanings() {
    assert_eq!(unit("Largest membrane force, N for each metre of width."), "N/m");
    assert_eq!(unit("Momentum at the end of the window, N s: 35, 36, 37"), "N s");
    assert_eq!(unit("Moment on the canopy, N m: 11, 12, 13."), "N m");
    assert_eq!(unit("Newton steps in the window."), "1");
    assert_eq!(unit("Work, less the dissipation, J."), "J");
}
