//! A program of C functions as a participant.

use std::path::Path;
use std::ptr;

use ripstop_participant::{
    Announcement, CANOPY_MOTION, Fault, Input, Participant, Role, Run, StageData, Stats, Window, role_code,
    save_state,
};

use crate::data::{Data, c_path};
use crate::interface::{Advance, CInput, CProgram, Rows};
use crate::message::{clear, of_program};
use crate::pointers::{slice, text};

/// The program, its stage and its rows.
pub struct Program {
    c: CProgram,
    advance: Advance,
    /// At a fixed address: the program keeps a pointer.
    data: Box<Data>,
    announcement: Announcement,
    output_rows: Vec<u64>,
    grid_rows: Vec<u64>,
    /// Rows of the moved grid, gathered from the ranks of the mesh-mover.
    grid: Vec<f64>,
}

/// The role with the code of the header.
///
/// # Errors
/// No role has it.
pub fn role_of(code: i32) -> Result<Role, Fault> {
    let role = Role::ALL.into_iter().find(|role| i64::from(role_code(*role)) == i64::from(code));
    role.ok_or_else(|| {
        Fault::new(format!(
            "`role` of the ripstop_program is {code}: write RIPSTOP_ROLE_STRUCTURE, RIPSTOP_ROLE_FLOW or RIPSTOP_ROLE_MESH"
        ))
    })
}

/// Refuses a program of another header, or without the functions that it needs.
fn check(c: &CProgram) -> Result<Advance, Fault> {
    let missing = |name: &str| {
        Fault::new(format!("the ripstop_program has no function `{name}`, which every program needs"))
    };
    c.start.ok_or_else(|| missing("start"))?;
    let state = [c.accept.is_some(), c.save.is_some(), c.restore.is_some()];
    if state.contains(&true) && state.contains(&false) {
        let [accept, save, restore] = state.map(|is| if is { "given" } else { "missing" });
        return Err(Fault::new(format!(
            "a program with a state has the functions accept ({accept}), save ({save}) and restore ({restore}); one without has none of \
             them"
        )));
    }
    c.advance.ok_or_else(|| missing("advance"))
}

impl Program {
    /// Reads the stage and starts the program.
    ///
    /// # Errors
    /// Those of [`Run::data`] and [`Program::start`].
    pub fn new(run: &Run, c: CProgram) -> Result<Self, Fault> {
        check(&c)?;
        let with_grid = c.needs_grid != 0 || run.role == Role::Mesh || c.grid_rows.is_some();
        Self::start(run, c, run.data(with_grid)?)
    }

    /// Calls `start` and `restore` of the program and reads its rows.
    ///
    /// # Errors
    /// A program that is not complete, the error of one of its functions, rows that do not exist.
    pub fn start(run: &Run, c: CProgram, stage: StageData) -> Result<Self, Fault> {
        let advance = check(&c)?;
        let name = text(c.name, "name")?;
        let effects = if c.effects.is_null() { "" } else { text(c.effects, "effects")? };
        let effects: Vec<&str> = effects.split_whitespace().collect();
        let data = Box::new(Data::new(run, stage)?);
        clear();
        let start = c.start.map_or(0, |start| start(c.user, &data));
        of_program("start", start)?;
        if let (Some(restore), Some(file)) = (c.restore, data.state_file(run.role)) {
            clear();
            of_program("restore", restore(c.user, file))?;
        }
        let stage = &data.stage;
        let grid_nodes = stage.grid.as_ref().map_or(0, |grid| grid.coords.len());
        let (rows, of) = match run.role {
            Role::Structure => (stage.structure.n_canopy, "canopy nodes"),
            Role::Flow => (stage.structure.faces.len(), "canopy faces"),
            Role::Mesh => (grid_nodes, "grid nodes"),
        };
        let share = || run.share(rows).map(|row| row as u64).collect();
        let output_rows = match c.output_rows {
            Some(own) => rows_of(&c, own, "output_rows", rows, of)?,
            None => share(),
        };
        // Where nothing moves there is no grid to read, and an immersed canopy moves through the flow's own grid.
        let moves = run.role == Role::Flow && stage.is_coupled() && !effects.contains(&CANOPY_MOTION);
        let grid_rows = match c.grid_rows.filter(|_| moves) {
            Some(own) => rows_of(&c, own, "grid_rows", grid_nodes, "grid nodes")?,
            None => Vec::new(),
        };
        let announced = if run.role == Role::Mesh || !grid_rows.is_empty() { grid_nodes } else { 0 };
        let announcement = run.announcement(stage, name, announced, &effects);
        Ok(Self { c, advance, data, announcement, output_rows, grid_rows, grid: Vec::new() })
    }

    /// The rows of the moved grid one after the other; null on a grid at rest.
    fn gather(&mut self, input: &Input<'_>) -> (*const f64, usize) {
        if input.grid.is_empty() || self.grid_rows.is_empty() {
            return (ptr::null(), 0);
        }
        self.grid.clear();
        (0..self.grid_rows.len()).for_each(|row| self.grid.extend_from_slice(input.grid.row(row)));
        (self.grid.as_ptr(), self.grid_rows.len())
    }
}

/// The rows that a function of the program returns.
fn rows_of(c: &CProgram, own: Rows, name: &str, rows: usize, of: &str) -> Result<Vec<u64>, Fault> {
    clear();
    let mut count = 0;
    let pointer = own(c.user, &mut count);
    if pointer.is_null() && count == 0 {
        // An error, or an empty share.
        let message = crate::message::kept();
        return if message.is_empty() { Ok(Vec::new()) } else { Err(Fault::new(message)) };
    }
    let found = slice(pointer, count, name)?;
    match found.iter().find(|row| **row >= rows as u64) {
        Some(row) => Err(Fault::new(format!(
            "`{name}` of the program has row {row}, but there are {rows} {of}: rows start at 0"
        ))),
        None => Ok(found.to_vec()),
    }
}

/// A path for C.
fn folder_of(folder: &Path) -> Result<std::ffi::CString, Fault> {
    c_path(folder).ok_or_else(|| Fault::new(format!("the path {} contains a zero", folder.display())))
}

impl Participant for Program {
    fn announce(&self) -> Announcement {
        self.announcement.clone()
    }

    fn output_rows(&self) -> Vec<u64> {
        self.output_rows.clone()
    }

    fn grid_rows(&self) -> Vec<u64> {
        self.grid_rows.clone()
    }

    fn advance(&mut self, window: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let (grid, grid_rows) = self.gather(input);
        let canopy = if input.canopy.is_empty() { ptr::null() } else { input.canopy.as_ptr() };
        let given = CInput { canopy, canopy_length: input.canopy.len(), grid, grid_rows };
        let mut stats = Stats::default();
        clear();
        let code = (self.advance)(
            self.c.user,
            window,
            &given,
            output.as_mut_ptr(),
            output.len(),
            stats.values.as_mut_ptr(),
        );
        of_program("advance", code)?;
        Ok(stats)
    }

    fn accept(&mut self, window: &Window) -> Result<(), Fault> {
        clear();
        self.c.accept.map_or(Ok(()), |accept| of_program("accept", accept(self.c.user, window)))
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        let run = &self.data.run;
        let Some(save) = self.c.save else {
            // A program without a state: the file says that it ran.
            return if run.rank == 0 { save_state(folder, run.role, &()) } else { Ok(()) };
        };
        let folder = folder_of(folder)?;
        clear();
        of_program("save", save(self.c.user, folder.as_ptr()))
    }

    fn snapshot(&mut self, time: f64, folder: &Path) -> Result<(), Fault> {
        let Some(snapshot) = self.c.snapshot else { return Ok(()) };
        let folder = folder_of(folder)?;
        clear();
        of_program("snapshot", snapshot(self.c.user, time, folder.as_ptr()))
    }
}
