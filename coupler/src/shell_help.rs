//! `ripstop completions` and `ripstop man`: what a shell and `man` know about the command line.

use std::fs;
use std::path::Path;

use clap_complete::Shell;
use coupling::error::RunError;

use crate::cli;

/// The completion script of `shell`.
pub fn completions(shell: Shell) -> String {
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut cli::command(), "ripstop", &mut script);
    String::from_utf8_lossy(&script).into_owned()
}

/// Writes a manual page in troff for `ripstop` and one for each command to `folder`, such as `ripstop-run.1`.
///
/// # Errors
/// The folder or a page cannot be written.
pub fn write_manual_pages(folder: &Path) -> Result<(), RunError> {
    fs::create_dir_all(folder).map_err(RunError::file("create", folder))?;
    clap_mangen::generate_to(cli::command(), folder).map_err(RunError::file("write", folder))
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;

    use super::*;

    fn visible_commands() -> Vec<String> {
        let command = cli::command();
        command.get_subcommands().filter(|c| !c.is_hide_set()).map(|c| c.get_name().to_owned()).collect()
    }

    #[test]
    fn completions_contain_every_command_for_every_shell() {
        for shell in Shell::value_variants() {
            let script = completions(*shell);
            for name in visible_commands() {
                assert!(script.contains(&name), "{shell}: {name}");
            }
            assert!(script.contains("checkpoint-every"), "{shell}");
        }
    }

    #[test]
    fn every_command_has_a_manual_page() {
        let folder = tempfile::tempdir().unwrap();
        write_manual_pages(folder.path()).unwrap();
        let page = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap_or_default();
        assert!(page("ripstop.1").contains(".TH ripstop 1"));
        for name in visible_commands() {
            assert!(page(&format!("ripstop-{name}.1")).contains(".SH SYNOPSIS"), "{name}");
        }
        assert!(page("ripstop-run.1").contains("checkpoint"));
    }
}
