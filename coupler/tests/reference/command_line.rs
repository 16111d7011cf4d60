//! `docs/reference/command-line.md`: commands and options, exit codes, environment variables.

use clap::{Arg, Command, CommandFactory};
use coupler::exit_codes;

use super::environment;
use super::markdown::{compare_or_write, head, inline, number, table};
use super::source::{members, read};

const INTRODUCTION: &str = "\
`ripstop COMMAND --help` prints the same. A value in brackets is optional; `...` can be repeated. `ripstop completions SHELL` \
prints the completion script of a shell, `ripstop man DIR` writes manual pages.";

const SOLVERS: &str = "\
`structure-solver`, `flow-solver` and `mesh-mover` take the same options. `ripstop run` passes them; `ripstop attach` prints \
the command to start them by hand. A program that replaces one of them takes them too ([contract](contract.md)).";

/// Developer commands of the solver programs: program, struct of its arguments, file.
const ALONE: &[(&str, &str, &str)] = &[
    ("structure-solver alone", "struct AloneArgs", "structure-solver/src/main.rs"),
    ("flow-solver alone", "struct Alone", "flow-solver/src/main.rs"),
    ("mesh-mover alone", "pub struct StandaloneArgs", "mesh-mover/src/standalone.rs"),
];

fn text_of(help: Option<&clap::builder::StyledStr>) -> String {
    help.map(|h| inline(&h.to_string())).unwrap_or_default()
}

fn name_of(arg: &Arg) -> String {
    let values = arg.get_value_names().map(|names| names.join(" ")).unwrap_or_default();
    let takes_value = arg.get_action().takes_values();
    let many = if arg.get_num_args().is_some_and(|n| n.max_values() > 1) { "..." } else { "" };
    match arg.get_long() {
        None => format!("`{values}{many}`"),
        Some(long) => {
            let short = arg.get_short().map(|s| format!("-{s}, ")).unwrap_or_default();
            let value = if takes_value { format!(" {values}{many}") } else { String::new() };
            format!("`{short}--{long}{value}`").replace('|', "\\|")
        }
    }
}

fn row(arg: &Arg) -> Vec<String> {
    let shown = |text: String| text.parse().map_or(text, number);
    let defaults = arg.get_default_values().iter().map(|v| shown(v.to_string_lossy().into_owned()));
    let defaults: Vec<String> = defaults.collect();
    let default = match (arg.get_action().takes_values(), defaults.is_empty()) {
        (_, _) if arg.is_required_set() => "required".into(),
        (true, false) => format!("`{}`", defaults.join(" ")),
        _ => String::new(),
    };
    let mut meaning = text_of(arg.get_long_help().or(arg.get_help()));
    let possible: Vec<_> = arg
        .get_possible_values()
        .iter()
        .filter(|_| arg.get_action().takes_values())
        .map(|v| format!("`{}`", v.get_name()))
        .collect();
    if !possible.is_empty() {
        meaning += &format!(". Values: {}", possible.join(", "));
    }
    vec![name_of(arg), default, meaning]
}

/// Arguments of a command, those by position first.
fn arguments(command: &Command) -> String {
    let shown = |arg: &&Arg| !arg.is_hide_set() && !["help", "version"].contains(&arg.get_id().as_str());
    let mut all: Vec<&Arg> = command.get_arguments().filter(shown).collect();
    all.sort_by_key(|a| !a.is_positional());
    let rows: Vec<_> = all.into_iter().map(row).collect();
    if rows.is_empty() { "No options.\n".into() } else { table(&["argument", "default", "meaning"], &rows) }
}

fn command_text(command: &Command) -> String {
    let about = command.get_long_about().or(command.get_about());
    format!("{}.\n\n{}", text_of(about).trim_end_matches('.'), arguments(command))
}

fn ripstop() -> Command {
    let mut command = coupler::cli::command();
    command.build();
    command
}

fn visible(command: &Command) -> impl Iterator<Item = &Command> {
    command.get_subcommands().filter(|c| !c.is_hide_set() && c.get_name() != "help")
}

fn alone(item: &str, path: &str) -> String {
    let rows: Vec<_> = members(&read(path), item)
        .iter()
        .map(|m| {
            let option = format!("`--{}`", m.name.replace('_', "-"));
            let of = m.of.strip_prefix("Option<").and_then(|t| t.strip_suffix('>'));
            let default = m.attributes.split("default_value_t = ").nth(1);
            let default = default.map(|d| d.split([')', ',']).next().unwrap_or_default());
            let default = match (default, m.of.as_str()) {
                (Some(value), _) => format!("`{value}`"),
                (None, "bool") => String::new(),
                (None, _) if of.is_some() || m.of.starts_with("Vec<") => String::new(),
                _ => "required".into(),
            };
            vec![option, default, inline(&m.text)]
        })
        .collect();
    table(&["argument", "default", "meaning"], &rows)
}

fn page() -> String {
    let mut text = head("Command line", INTRODUCTION);
    let command = ripstop();
    text += "\n## Commands of `ripstop`\n\n";
    let overview = visible(&command).map(|c| {
        let name = c.get_name();
        vec![format!("[`{name}`](#ripstop-{name})"), text_of(c.get_about())]
    });
    text += &table(&["command", "what it does"], &overview.collect::<Vec<_>>());
    for c in visible(&command) {
        text += &format!("\n### `ripstop {}`\n\n{}", c.get_name(), command_text(c));
        for inner in visible(c) {
            text +=
                &format!("\n#### `ripstop {} {}`\n\n{}", c.get_name(), inner.get_name(), command_text(inner));
        }
    }
    let mut program = channel::ProgramArgs::command();
    program.build();
    text += &format!("\n## The solver programs\n\n{SOLVERS}\n\n{}", arguments(&program));
    text += "\nFor developers, `alone` runs one program without a coupler:\n";
    for (name, item, path) in ALONE {
        text += &format!("\n### `{name}`\n\n{}", alone(item, path));
    }
    let codes: Vec<_> = exit_codes::TABLE
        .iter()
        .map(|(code, meaning)| vec![code.to_string(), (*meaning).to_owned()])
        .collect();
    text += &format!(
        "\n## Exit codes of `ripstop`\n\n{}\nA solver program exits with 0, with 1 after an error, or with 2 where its \
         arguments are wrong.\n",
        table(&["code", "meaning"], &codes)
    );
    text + &environment::section()
}

#[test]
fn page_of_the_command_line_is_generated_from_the_code() {
    compare_or_write("command-line.md", &page());
}

#[test]
fn every_visible_argument_has_a_text() {
    let command = ripstop();
    for c in visible(&command).flat_map(|c| std::iter::once(c).chain(visible(c))) {
        assert!(c.get_about().is_some(), "{}", c.get_name());
        for arg in c.get_arguments().filter(|a| !a.is_hide_set()) {
            assert!(!text_of(arg.get_help()).is_empty(), "{} {}", c.get_name(), arg.get_id());
        }
    }
}
