//! Values of the command line that are more than a word or a number.

use case::Role;

/// A role by its name.
pub(crate) fn role(text: &str) -> Result<Role, String> {
    Role::ALL
        .into_iter()
        .find(|r| r.name() == text.trim())
        .ok_or_else(|| format!("there is no role `{text}`; roles: structure, flow, mesh"))
}

/// Ranks of a role, as `flow=4`.
pub(crate) fn ranks(text: &str) -> Result<(Role, u32), String> {
    let help = "write ROLE=N, such as flow=4; roles: structure, flow, mesh";
    let (name, count) = text.split_once('=').ok_or(help)?;
    let role = Role::ALL
        .into_iter()
        .find(|r| r.name() == name.trim())
        .ok_or_else(|| format!("there is no role `{name}`; {help}"))?;
    match count.trim().parse() {
        Ok(n) if n >= 1 => Ok((role, n)),
        _ => Err(format!("`{count}` is no number of ranks (1 or more); {help}")),
    }
}

/// Options for `mpirun` of one program or of all, as `[ROLE=]OPTIONS`.
pub(crate) fn mpirun(text: &str) -> Result<(Option<Role>, String), String> {
    let of = |role: &Role| Some((*role, text.strip_prefix(role.name())?.strip_prefix('=')?));
    let (role, options) = match Role::ALL.iter().find_map(of) {
        Some((role, options)) => (Some(role), options),
        None => (None, text),
    };
    match terminal::shell::split_words(options) {
        Some(words) if words.first().is_some_and(|w| w.starts_with('-')) => Ok((role, options.to_owned())),
        Some(_) => Err("options of mpirun, the first with its dash, such as `--map-by node`".into()),
        None => Err("a quote is not closed".into()),
    }
}

/// A number of seconds above 0.
pub(crate) fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if s > 0.0 && s < 1e9 => Ok(s),
        _ => Err("a number of seconds above 0".into()),
    }
}

/// A share from 0 to 1, for the command line.
pub(crate) fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if (0.0..1.0).contains(&s) => Ok(s),
        _ => Err("a share from 0 (the same to the bit, above each field's floor) to 1".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_of_mpirun_are_of_one_program_or_all() {
        assert_eq!(mpirun("--map-by node"), Ok((None, "--map-by node".into())));
        assert_eq!(mpirun("flow=--host a,b"), Ok((Some(Role::Flow), "--host a,b".into())));
        assert!(mpirun("flow=a,b").is_err() && mpirun("--host 'a").is_err());
    }

    #[test]
    fn ranks_are_read_or_refused_with_help() {
        assert_eq!(ranks("flow=4"), Ok((Role::Flow, 4)));
        for wrong in ["flow", "flow=0", "wing=2", "mesh=x"] {
            assert!(ranks(wrong).unwrap_err().contains("write ROLE=N"), "{wrong}");
        }
    }
}
