//! The process of a program: its arguments, its rank, its start and end.

use std::ops::Range;
use std::path::PathBuf;
use std::process::{Command, ExitCode};

use channel::ProgramArgs;

use crate::{Announcement, Fault, Participant, Role, StageData, surface_hash};

/// Variables in which launchers number the processes of a program.
const RANK: [&str; 3] = ["OMPI_COMM_WORLD_RANK", "PMI_RANK", "SLURM_PROCID"];

/// One rank of a program.
#[derive(Clone, Debug)]
pub struct Run {
    /// Role of the program.
    pub role: Role,
    /// Arguments that the coupler passed.
    pub args: ProgramArgs,
    /// This rank, from 0.
    pub rank: usize,
}

/// Runs a program: reads the arguments, makes the participant and serves it to the coupler. The exit code is that of the process.
///
/// An error of `new` becomes the message with which the run ends.
pub fn main<P: Participant>(role: Role, new: impl FnOnce(&Run) -> Result<P, Fault>) -> ExitCode {
    match serve(role, ProgramArgs::parse_or_exit(), new) {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

/// As [`main`], with the arguments of the coupler, for programs whose own `main` function is in another language.
///
/// # Errors
/// The message with which the run ended.
pub fn serve<P: Participant>(
    role: Role,
    args: ProgramArgs,
    new: impl FnOnce(&Run) -> Result<P, Fault>,
) -> Result<(), String> {
    let rank = RANK.iter().find_map(|name| std::env::var(name).ok()?.parse().ok()).unwrap_or(0);
    let run = Run { role, args, rank };
    let at = run.args.serve_options(role, rank);
    match new(&run) {
        Ok(mut participant) => channel::serve(&mut participant, &at).map(drop).map_err(|e| e.to_string()),
        Err(fault) => {
            channel::report(&at, &fault);
            Err(fault.message)
        }
    }
}

impl Run {
    /// Ranks of the program.
    pub fn ranks(&self) -> usize {
        self.args.ranks as usize
    }

    /// The share of `n` rows that this rank computes: all ranks have nearly equal ones, in order.
    pub fn share(&self, n: usize) -> Range<usize> {
        let start = |rank: usize| n * rank / self.ranks();
        start(self.rank)..start(self.rank + 1)
    }

    /// The data of the stage, from `ripstop mesh`: the program that the variable `RIPSTOP` names, or the one on `PATH`.
    ///
    /// # Errors
    /// `ripstop` cannot be started, or refuses the stage.
    pub fn data(&self, with_grid: bool) -> Result<StageData, Fault> {
        let ripstop = std::env::var_os("RIPSTOP").unwrap_or_else(|| "ripstop".into());
        let mut command = Command::new(&ripstop);
        command.arg("mesh").arg(&self.args.scene).args(["--stage", &self.args.stage.to_string()]);
        command.arg("--out").arg(&self.args.out).args(with_grid.then_some("--grid"));
        let output = command.output().map_err(|e| {
            Fault::new(format!(
                "`{}` cannot be started ({e}): name the program `ripstop` in the variable RIPSTOP, or put its folder on PATH",
                ripstop.display()
            ))
        })?;
        if !output.status.success() {
            let why = String::from_utf8_lossy(&output.stderr);
            return Err(Fault::new(format!("{command:?} failed: {}", why.trim())));
        }
        serde_json::from_slice(&output.stdout)
            .map_err(|e| Fault::new(format!("{command:?} printed what this version cannot read: {e}")))
    }

    /// File of the state to start from: the one within this stage where a run is resumed, else that of an earlier stage.
    pub fn state(&self, data: &StageData) -> Option<PathBuf> {
        let within = self.args.resume.as_ref().map(|folder| folder.join(format!("{}.bin", self.role.name())));
        within.or_else(|| data.states.get(self.role.name()).cloned())
    }

    /// What a program announces that has the canopy of the scene. `grid_nodes`: those of the whole flow grid, 0 where it neither
    /// moves nor reads one.
    pub fn announcement(
        &self,
        data: &StageData,
        program: &str,
        grid_nodes: usize,
        effects: &[&str],
    ) -> Announcement {
        let faces = &data.structure.faces;
        let output_width = match self.role {
            Role::Structure => 3,
            Role::Flow => crate::LOAD_WIDTH,
            Role::Mesh => 6,
        };
        Announcement {
            role: self.role.name().into(),
            program: program.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            canopy_nodes: data.structure.n_canopy as u64,
            canopy_faces: faces.len() as u64,
            surface_hash: surface_hash(faces),
            grid_nodes: grid_nodes as u64,
            output_width: output_width as u64,
            effects: effects.iter().map(|e| (*e).to_owned()).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(rank: usize, ranks: u32) -> Run {
        let words = ["my-flow", "--scene", "s", "--stage", "0", "--session", "x", "--out", "o", "--ranks"];
        let words = words.iter().map(|w| (*w).to_owned()).chain([ranks.to_string()]);
        Run { role: Role::Flow, args: ProgramArgs::from_words(words).expect("arguments"), rank }
    }

    #[test]
    fn shares_cover_all_rows_once() {
        for (n, ranks) in [(144, 1), (145, 2), (7, 3), (2, 3), (0, 2)] {
            let rows: Vec<usize> = (0..ranks).flat_map(|rank| run(rank as usize, ranks).share(n)).collect();
            assert_eq!(rows, (0..n).collect::<Vec<_>>(), "{n} rows on {ranks} ranks");
        }
    }

    #[test]
    fn a_state_within_the_stage_comes_first() {
        let text = r#"{"scene": {}, "stage": 0, "structure": {"coords": [], "n_canopy": 0, "faces": [], "cables": [], "point_masses": [],
            "fixed": []}, "states": {"flow": "/before/flow.bin"}, "clocks": {}}"#;
        let data: StageData = serde_json::from_str(text).expect("data");
        let mut run = run(0, 1);
        assert_eq!(run.state(&data), Some("/before/flow.bin".into()));
        run.args.resume = Some("/within".into());
        assert_eq!(run.state(&data), Some("/within/flow.bin".into()));
    }
}
