//! Parsers of option values.

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
        _ => Err(format!("`{count}` is not a valid number of ranks (1 or more); {help}")),
    }
}

/// Options of `mpirun` for one program or for all, as `[ROLE=]OPTIONS`.
pub(crate) fn mpirun(text: &str) -> Result<(Option<Role>, String), String> {
    let of = |role: &Role| Some((*role, text.strip_prefix(role.name())?.strip_prefix('=')?));
    let (role, options) = match Role::ALL.iter().find_map(of) {
        Some((role, options)) => (Some(role), options),
        None => (None, text),
    };
    match terminal::shell::split_words(options) {
        Some(words) if words.first().is_some_and(|w| w.starts_with('-')) => Ok((role, options.to_owned())),
        Some(_) => Err("write options of mpirun, the first with its dash, such as `--map-by node`".into()),
        None => Err("a quote is not closed".into()),
    }
}

/// A positive number of seconds.
pub(crate) fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if s > 0.0 && s < 1e9 => Ok(s),
        _ => Err("write a number of seconds greater than 0".into()),
    }
}

/// A ratio from 0 (included) to 1 (excluded).
pub(crate) fn ratio(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if (0.0..1.0).contains(&s) => Ok(s),
        _ => {
            Err("write a number from 0 (bitwise identical, above the floor of each field) to less than 1"
                .into())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mpirun_options_apply_to_one_program_or_all() {
        assert_eq!(mpirun("--map-by node"), Ok((None, "--map-by node".into())));
        assert_eq!(mpirun("flow=--host a,b"), Ok((Some(Role::Flow), "--host a,b".into())));
        assert!(mpirun("flow=a,b").is_err() && mpirun("--host 'a").is_err());
    }

    #[test]
    fn invalid_ranks_are_refused_with_help() {
        assert_eq!(ranks("flow=4"), Ok((Role::Flow, 4)));
        for wrong in ["flow", "flow=0", "wing=2", "mesh=x"] {
            assert!(ranks(wrong).unwrap_err().contains("write ROLE=N"), "{wrong}");
        }
    }
}
