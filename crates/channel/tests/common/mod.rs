//! Test participants and a scripted coupler, for tests in one process or in several.
#![allow(dead_code, reason = "each test file uses a part")]

#[path = "../../../../tests/src/load.rs"]
mod load;

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use case::Role;
use channel::{
    Abort, Announcement, Fault, Hub, HubError, HubOptions, Input, Participant, RoleOptions, ServeEnd,
    ServeError, ServeOptions, Stats, Window, serve, surface_hash,
};
#[allow(unused_imports, reason = "each test file uses a part")]
pub use load::{Available, Limit, deadline};

/// Nodes and faces of the test canopy, nodes of the test grid.
pub const NODES: usize = 35;
pub const FACES: usize = 24;
pub const GRID: usize = 101;
/// Every program works as long on the acceptance of a window.
pub const ACCEPTANCE: Duration = Duration::from_millis(2);

/// Injected error in a given call of `advance` (counted from 0).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trouble {
    None,
    Fault(u32),
    Panic(u32),
    Nan(u32),
    Unwritten(u32),
    Stall(u32),
    Exit(u32),
}

/// A participant with arithmetic instead of physics: each response depends on all inputs, so a stale or lost message
/// changes the numbers.
pub struct Fake {
    pub role: Role,
    pub rank: usize,
    pub ranks: usize,
    pub announcement: Announcement,
    pub trouble: Trouble,
    calls: u32,
    /// The accepted state, and the last answer.
    state: f64,
    last: f64,
}

impl Fake {
    pub fn new(role: Role, rank: usize, ranks: usize) -> Self {
        let announcement = Announcement {
            role: role.name().into(),
            program: format!("fake-{}", role.name()),
            version: "0.0.1".into(),
            canopy_nodes: NODES as u64,
            canopy_faces: FACES as u64,
            surface_hash: surface_hash(&[[0, 1, 2, 3]]),
            grid_nodes: if role == Role::Structure { 0 } else { GRID as u64 },
            output_width: width(role) as u64,
            effects: vec!["fabric.wrinkling".into()],
        };
        Self { role, rank, ranks, announcement, trouble: Trouble::None, calls: 0, state: 0.0, last: 0.0 }
    }

    pub fn with(mut self, trouble: Trouble) -> Self {
        self.trouble = trouble;
        self
    }
}

pub fn width(role: Role) -> usize {
    match role {
        Role::Structure => 3,
        Role::Flow => 4,
        Role::Mesh => 6,
    }
}

/// Rows are assigned in turn, in reverse order, so that no order is trivial.
pub fn rows(role: Role, rank: usize, ranks: usize) -> Vec<u64> {
    let total = match role {
        Role::Structure => NODES,
        Role::Flow => FACES,
        Role::Mesh => GRID,
    };
    (0..total as u64).rev().filter(|row| *row as usize % ranks == rank).collect()
}

/// Value of node `row` of the test grid, given the mean displacement.
pub fn grid_value(row: u64, component: usize, mean: f64, w: &Window) -> f64 {
    row as f64 + 0.1 * component as f64 + mean + 1e3 * w.index as f64 + 1e5 * w.iteration as f64
}

pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

impl Participant for Fake {
    fn announce(&self) -> Announcement {
        self.announcement.clone()
    }

    fn output_rows(&self) -> Vec<u64> {
        rows(self.role, self.rank, self.ranks)
    }

    fn grid_rows(&self) -> Vec<u64> {
        // Overlapping parts, like ghost cells.
        let is_read = |row: &u64| (row % self.ranks as u64) as usize == self.rank || row.is_multiple_of(5);
        if self.role == Role::Flow { (0..GRID as u64).filter(is_read).collect() } else { Vec::new() }
    }

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let call = self.calls;
        self.calls += 1;
        match self.trouble {
            Trouble::Fault(n) if n == call => return Err(Fault::new("injected fault")),
            Trouble::Panic(n) if n == call => panic!("injected panic"),
            Trouble::Stall(n) if n == call => {
                println!("stalled");
                thread::sleep(Duration::from_secs(3600));
            }
            Trouble::Exit(n) if n == call => std::process::exit(0),
            _ => {}
        }
        let rows = self.output_rows();
        let width = width(self.role);
        self.last = self.state + mean(input.canopy) + w.time;
        for (row, out) in rows.iter().zip(output.chunks_exact_mut(width)) {
            for (component, x) in out.iter_mut().enumerate() {
                *x = match self.role {
                    Role::Structure => self.last + *row as f64 + 0.1 * component as f64,
                    Role::Mesh => grid_value(*row, component, mean(input.canopy), w),
                    Role::Flow => *row as f64 + 0.01 * component as f64,
                };
            }
        }
        if self.role == Role::Flow && !input.grid.is_empty() {
            let read: Vec<f64> = (0..self.grid_rows().len()).flat_map(|i| *input.grid.row(i)).collect();
            output.iter_mut().for_each(|x| *x += 1e-3 * mean(&read));
        }
        match self.trouble {
            Trouble::Nan(n) if n == call => output[width + 1] = f64::NAN,
            Trouble::Unwritten(n) if n == call => output[0] = f64::from_bits(0x7ff8_0000_0000_0000),
            _ => {}
        }
        let mut stats = Stats::default();
        stats.values[0] = f64::from(self.calls);
        Ok(stats)
    }

    fn accept(&mut self, _: &Window) -> Result<(), Fault> {
        std::thread::sleep(ACCEPTANCE);
        self.state = self.last;
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        let file = folder.join(format!("{}.{}.txt", self.role.name(), self.rank));
        std::fs::write(&file, format!("{}", self.state))
            .map_err(|e| Fault::new(format!("{}: {e}", file.display())))
    }

    fn snapshot(&mut self, time: f64, folder: &Path) -> Result<(), Fault> {
        let file = folder.join(format!("{}.{}.vtu", self.role.name(), self.rank));
        std::fs::write(file, format!("{time}")).map_err(Fault::new)
    }
}

/// A session name unique to a test.
pub fn name(test: &str) -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    format!("{test}-{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed))
}

/// A deadline that no test reaches, whatever the load of the machine.
pub const LATE: Duration = Duration::from_secs(300);

pub fn at(session: &str, role: Role, rank: usize, ranks: usize) -> ServeOptions {
    let deadline = Some(LATE);
    ServeOptions { session: session.into(), role, rank, ranks, stage: 0, deadline, exit_when_orphaned: false }
}

pub fn options(session: &str, roles: &[(Role, usize)]) -> HubOptions {
    let role = |&(role, ranks): &(Role, usize)| RoleOptions {
        role,
        ranks,
        deadline: Some(LATE),
        effects: Vec::new(),
    };
    HubOptions {
        session: session.into(),
        roles: roles.iter().map(role).collect(),
        stage: 0,
        interface: None,
        arrival_deadline: Some(LATE),
        watch_grid: false,
    }
}

pub type Served = JoinHandle<Result<ServeEnd, ServeError>>;

/// Serves a test participant in a thread, as one rank.
pub fn spawn(session: &str, fake: Fake) -> Served {
    let at = at(session, fake.role, fake.rank, fake.ranks);
    spawn_at(at, fake)
}

pub fn spawn_at(at: ServeOptions, mut fake: Fake) -> Served {
    thread::spawn(move || serve(&mut fake, &at))
}

/// All ranks of all roles.
pub fn spawn_all(session: &str, roles: &[(Role, usize)]) -> Vec<Served> {
    let ranks = roles.iter().flat_map(|&(role, n)| (0..n).map(move |rank| (role, rank, n)));
    ranks.map(|(role, rank, n)| spawn(session, Fake::new(role, rank, n))).collect()
}

/// A time limit on waits, so that no test hangs.
pub fn time_limit() -> impl FnMut() -> Result<(), Abort> {
    let limit = Limit::new(Duration::from_secs(30));
    move || if limit.passed() { Err(Abort::new("the test hangs")) } else { Ok(()) }
}

pub fn window(index: u64, iteration: u64) -> Window {
    Window { index, iteration, substeps: 10, time: 0.005 * index as f64, dt: 0.005, ..Window::default() }
}

/// Gathers a role's output by global row.
pub fn gather(hub: &mut Hub, role: Role) -> Result<Vec<f64>, HubError> {
    let w = width(role);
    let total = rows(role, 0, 1).len();
    let mut all = vec![f64::NAN; total * w];
    hub.collect(
        role,
        &mut |rows, data| {
            for (row, values) in rows.iter().zip(data.chunks_exact(w)) {
                all[*row as usize * w..][..w].copy_from_slice(values);
            }
        },
        &mut time_limit(),
    )?;
    Ok(all)
}

/// Opens a session and waits for all participants.
pub fn open(options: HubOptions) -> Result<Hub, HubError> {
    let mut hub = Hub::create(options)?;
    let mut time_limit = time_limit();
    hub.await_participants(&mut |_| time_limit())?;
    Ok(hub)
}

/// Names of the remaining files of a session in shared memory.
pub fn leftovers(session: &str) -> Vec<String> {
    channel::session_files(session).expect("a valid name").iter().map(|p| p.display().to_string()).collect()
}

/// Every participant ends by `stop`.
pub fn end_well(threads: Vec<Served>) {
    for thread in threads {
        thread.join().expect("no panic").expect("a good end");
    }
}
