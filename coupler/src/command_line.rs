//! Command lines to paste into a shell.

use std::path::Path;

use case::Role;
use terminal::shell::quote;

use crate::run::RunOptions;

/// The command that resumes a run with `options` and the results folder `out`: all options that affect the results,
/// quoted for a POSIX shell.
pub fn resume(options: &RunOptions, out: &Path) -> String {
    let mut words = vec![program(), "run".into(), options.scene.display().to_string()];
    let mut option = |name: &str, value: String| words.extend([format!("--{name}"), value]);
    options.settings.iter().for_each(|s| option("set", s.to_string()));
    if !options.ranks.is_empty() {
        let ranks: Vec<String> =
            options.ranks.iter().map(|(role, n)| format!("{}={n}", role.name())).collect();
        option("ranks", ranks.join(","));
    }
    options.programs.iter().for_each(|(role, command)| option(role.name(), command.clone()));
    for (role, mpirun) in &options.mpirun {
        option("mpirun", role.as_ref().map_or_else(String::new, |r| format!("{}=", Role::name(*r))) + mpirun);
    }
    option("out", out.display().to_string());
    words.push("--resume".into());
    words.extend(options.accept_unconverged.then(|| "--accept-unconverged".into()));
    words.iter().map(|w| quote(w)).collect::<Vec<_>>().join(" ")
}

/// How this process was started: its path, or its name where the shell found it in `PATH`.
fn program() -> String {
    std::env::args().next().unwrap_or_else(|| "ripstop".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resume_command_repeats_all_options_of_the_run() {
        let options = RunOptions {
            scene: "my scenes/drop.toml".into(),
            settings: vec!["coupling.scheme=staggered".parse().expect("a setting")],
            ranks: vec![(Role::Flow, 4), (Role::Mesh, 2)],
            programs: vec![(Role::Structure, "python3 it's.py".into())],
            mpirun: vec![(Some(Role::Flow), "--map-by node".into()), (None, "--oversubscribe".into())],
            ..RunOptions::default()
        };
        let line = resume(&options, Path::new("/tmp/a b"));
        let expected = " run 'my scenes/drop.toml' --set coupling.scheme=staggered --ranks flow=4,mesh=2 \
                        --structure 'python3 it'\\''s.py' --mpirun 'flow=--map-by node' --mpirun --oversubscribe \
                        --out '/tmp/a b' --resume";
        assert!(line.ends_with(expected), "{line}");
    }
}
