//! The coupler's part of the handshake: arrival of the participants, and consistency of their announcements.

use std::time::Duration;

use case::Role;

use crate::deadline::Deadline;
use crate::header::{Kind, Unit, unpack_text};
use crate::hub::{Hub, OnWait};
use crate::hub_options::{Arrivals, HubOptions, Interface, RoleOptions};
use crate::session::LockMonitor;
use crate::wire::{Hello, Welcome, decode_rows, to_json};
use crate::{Abort, Announcement, CANOPY_MOTION, CONTRACT_VERSION, HubError, OWN_SURFACE, RankId, Window};

/// Rows by which a total may exceed the received layouts.
const ROW_MARGIN: u64 = 1 << 20;
/// Time between two calls of the caller while participants arrive.
const POLL_INTERVAL: Duration = Duration::from_millis(100);

impl Hub {
    pub(crate) fn handshake(
        &mut self,
        on_wait: &mut dyn FnMut(&Arrivals) -> Result<(), Abort>,
    ) -> Result<(), HubError> {
        let wait = Deadline::after(self.options.arrival_deadline);
        self.arrivals(wait, on_wait)?;
        if let Err(message) = self.check_announcements() {
            let roles: Vec<Role> = self.programs.iter().map(|p| p.role).collect();
            // The end of the session informs them if this message does not.
            let _ = self.send_command(&roles, Kind::Refuse, &Window::default(), &message);
            return Err(HubError::Refused { message });
        }
        let all = self.arrived(wait);
        self.welcome(&mut || on_wait(&all))
    }

    fn arrived(&self, wait: Deadline) -> Arrivals {
        let mut arrivals = Arrivals { seconds: wait.elapsed().as_secs_f64(), ..Arrivals::default() };
        for rank in self.programs.iter().flat_map(|p| &p.ranks) {
            match &rank.hello {
                Some(hello) => {
                    let a = &hello.announcement;
                    arrivals.arrived.push((rank.who, format!("{} {}", a.program, a.version)));
                }
                None => arrivals.missing.push(rank.who),
            }
        }
        arrivals
    }

    /// Waits for the announcements of all ranks.
    fn arrivals(
        &mut self,
        wait: Deadline,
        on_wait: &mut dyn FnMut(&Arrivals) -> Result<(), Abort>,
    ) -> Result<(), HubError> {
        loop {
            let dead = self.dead();
            self.receive_announcements()?;
            let arrivals = self.arrived(wait);
            on_wait(&arrivals)?;
            let Some(&missing) = arrivals.missing.first() else { return Ok(()) };
            if let Some(who) = dead {
                return Err(HubError::Died { who, during: "the handshake".into() });
            }
            if wait.is_over() {
                let (who, during, seconds) = (missing, "the handshake".into(), wait.limit_s());
                return Err(HubError::Deadline { who, during, seconds, state: "" });
            }
            self.sleep(POLL_INTERVAL)?;
        }
    }

    /// Receives the announcements that have arrived since the last call.
    fn receive_announcements(&mut self) -> Result<(), HubError> {
        self.drain()?;
        for rank in self.programs.iter_mut().flat_map(|p| &mut p.ranks) {
            if let Some(message) = rank.answer.take() {
                let hello = rank
                    .check(&message, self.id, Kind::Announce, Unit::Text, None, 0)
                    .or_else(|| rank.hello.is_some().then(|| "announced itself twice".to_string()));
                let text = unpack_text(message.payload(), message.header().bytes).unwrap_or_default();
                match (hello, serde_json::from_str::<Hello>(&text)) {
                    (None, Ok(hello)) => rank.hello = Some(hello),
                    (problem, parsed) => {
                        let problem = problem.unwrap_or_else(|| {
                            format!(
                                "its announcement cannot be read: {}",
                                parsed.err().map_or("?".into(), |e| e.to_string())
                            )
                        });
                        return Err(rank.broken(Kind::Announce, &Window::default(), problem));
                    }
                }
                let RankId { role, rank: number } = rank.who;
                rank.watch = LockMonitor::on(&self.place.lock_file(&format!("{}.{number}", role.name())));
            }
        }
        Ok(())
    }

    /// The layout that a rank published.
    fn layout(&mut self, role: Role, rank: usize) -> Result<Vec<f64>, HubError> {
        let id = self.id;
        let rank = &mut self.program(role)?.ranks[rank];
        let (_, receiver) = rank.layout.as_ref().expect("opened with the session");
        let Some(message) = receiver.receive()? else {
            return Err(rank.broken(Kind::Layout, &Window::default(), "it published no layout".into()));
        };
        let hello = rank.hello.as_ref().expect("it has arrived");
        let length = hello.output_rows.saturating_add(hello.grid_rows) as usize;
        match rank.check(&message, id, Kind::Layout, Unit::Rows, Some(length), message.header().sequence) {
            Some(problem) => Err(rank.broken(Kind::Layout, &Window::default(), problem)),
            None => Ok(message.payload().to_vec()),
        }
    }

    /// Checks the announcements against the session and each other.
    fn check_announcements(&mut self) -> Result<(), String> {
        let hellos = |role: Role| {
            let program = self.programs.iter().find(|p| p.role == role);
            program.into_iter().flat_map(|p| &p.ranks).filter_map(|r| Some((r.who, r.hello.clone()?)))
        };
        let all: Vec<(RankId, Hello)> = Role::ALL.into_iter().flat_map(hellos).collect();
        self.interface = check(&self.options, &all)?;
        for program in &mut self.programs {
            let unit = Unit::of_input(program.role);
            // The same for all but a structure with a surface of its own.
            let reported = program.ranks[0].hello.as_ref().map(|h| &h.announcement);
            let rows = match unit {
                Unit::LoadPair => reported.map_or(0, |a| a.canopy_faces),
                Unit::Displacement if program.role == Role::Flow => {
                    let moves = |a: &&Announcement| a.effects.iter().any(|e| e == CANOPY_MOTION);
                    reported.filter(moves).map_or(0, |a| a.canopy_nodes)
                }
                Unit::Displacement => reported.map_or(0, |a| a.canopy_nodes),
                _ => 0,
            };
            program.input_length = rows as usize * unit.width();
        }
        Ok(())
    }

    /// Informs each participant of its partners, and requests the layouts.
    fn welcome(&mut self, on_wait: OnWait<'_>) -> Result<(), HubError> {
        let roles: Vec<Role> = self.programs.iter().map(|p| p.role).collect();
        let mesh = self.programs.iter().find(|p| p.role == Role::Mesh);
        let linked = mesh.is_some() && roles.contains(&Role::Flow);
        let mesh_rows: Vec<u64> = match mesh {
            Some(mesh) if linked => {
                mesh.ranks.iter().filter_map(|r| Some(r.hello.as_ref()?.output_rows)).collect()
            }
            _ => Vec::new(),
        };
        let grid_readers = if linked { self.rank_counts.ranks(Role::Flow) } else { 0 };
        for &role in &roles {
            let input_length = self.program(role)?.input_length as u64;
            let coupler_reads_grid = self.options.watch_grid;
            let mesh_rows = mesh_rows.clone();
            let text = to_json(&Welcome { input_length, mesh_rows, grid_readers, coupler_reads_grid })?;
            self.send_command(&[role], Kind::Welcome, &Window::default(), &text)?;
        }
        self.finish(&roles, on_wait)?;
        self.request(&roles, Kind::SendLayout, &Window::default(), "", on_wait)?;
        self.layouts()
    }

    /// Reads the layouts: each row must be on exactly one rank.
    fn layouts(&mut self) -> Result<(), HubError> {
        for p in 0..self.programs.len() {
            let role = self.programs[p].role;
            let total = match role {
                Role::Structure => {
                    self.programs[p].ranks[0].hello.as_ref().map_or(0, |h| h.announcement.canopy_nodes)
                }
                Role::Flow => self.interface.faces,
                Role::Mesh => {
                    self.programs[p].ranks[0].hello.as_ref().map_or(0, |h| h.announcement.grid_nodes)
                }
            };
            let all = 0..self.programs[p].ranks.len();
            let layouts: Vec<Vec<f64>> = all.map(|r| self.layout(role, r)).collect::<Result<_, _>>()?;
            // Layouts are already in memory; a total is only a claim for which memory would be allocated.
            let came: u64 = layouts.iter().map(|l| l.len() as u64).sum();
            if !is_plausible(total, came) {
                let problem = format!("its ranks laid out {came} rows, but announced {total}");
                return Err(self.programs[p].ranks[0].broken(Kind::Layout, &Window::default(), problem));
            }
            let mut owner = RowOwners::new(total);
            for (r, layout) in layouts.into_iter().enumerate() {
                let rank = &mut self.programs[p].ranks[r];
                let count = rank.hello.as_ref().map_or(0, |h| h.output_rows as usize);
                let result = decode_rows(&layout)
                    .ok_or_else(|| "its layout holds a number that is not a row index".to_string())
                    .and_then(|rows| owner.claim(r, &rows[..count]).map(|()| rows));
                match result {
                    Ok(mut rows) => {
                        rows.truncate(count);
                        rank.rows = rows;
                    }
                    Err(problem) => return Err(rank.broken(Kind::Layout, &Window::default(), problem)),
                }
            }
            if let Err(problem) = owner.complete() {
                return Err(self.programs[p].ranks[0].broken(Kind::Layout, &Window::default(), problem));
            }
        }
        for rank in self.programs.iter_mut().flat_map(|p| &mut p.ranks) {
            rank.drop_handshake_channels();
        }
        Ok(())
    }
}

/// Whether a total of `total` rows is plausible for layouts of `came` rows: memory is allocated for it.
fn is_plausible(total: u64, came: u64) -> bool {
    total <= 2 * came + ROW_MARGIN
}

/// The rank of each row.
struct RowOwners(Vec<u32>);

const UNOWNED: u32 = u32::MAX;

impl RowOwners {
    fn new(rows: u64) -> Self {
        Self(vec![UNOWNED; rows as usize])
    }

    fn claim(&mut self, rank: usize, rows: &[u64]) -> Result<(), String> {
        let total = self.0.len();
        for &row in rows {
            let Some(owner) = self.0.get_mut(row as usize) else {
                return Err(format!("output row {row} is beyond the {total} rows of the interface"));
            };
            if *owner != UNOWNED {
                return Err(format!("output row {row} is on rank {rank} and on rank {owner}"));
            }
            *owner = rank as u32;
        }
        Ok(())
    }

    fn complete(&self) -> Result<(), String> {
        match self.0.iter().position(|&owner| owner == UNOWNED) {
            None => Ok(()),
            Some(row) => Err(format!("output row {row} is on no rank")),
        }
    }
}

/// Checks the announcements of the ranks against the session and each other. Returns the interface that they share,
/// or a message that names both sides.
fn check(options: &HubOptions, hellos: &[(RankId, Hello)]) -> Result<Interface, String> {
    for (who, hello) in hellos {
        let spec = options.roles.iter().find(|r| r.role == who.role);
        check_alone(options, spec.ok_or("a program without a role")?, *who, hello)?;
    }
    let interface = one_canopy(options, hellos)?;
    one_own_surface(hellos)?;
    if options.roles.iter().any(|r| r.role == Role::Mesh) {
        one_grid(hellos)?;
    }
    hellos.iter().try_for_each(|(who, hello)| check_rows(*who, hello))?;
    interface.ok_or_else(|| "nobody has arrived".into())
}

/// Whether a structure couples on a surface of its own, unrelated to the scene's canopy.
fn has_own_surface(who: RankId, hello: &Hello) -> bool {
    who.role == Role::Structure && hello.announcement.effects.iter().any(|e| e == OWN_SURFACE)
}

fn announced(hello: &Hello) -> Interface {
    let a = &hello.announcement;
    Interface { nodes: a.canopy_nodes, faces: a.canopy_faces, surface_hash: a.surface_hash }
}

/// The canopy of the scene and of all programs, except structures with a surface of their own.
fn one_canopy(options: &HubOptions, hellos: &[(RankId, Hello)]) -> Result<Option<Interface>, String> {
    let mut known = options.interface.map(|i| ("the coupler (from the scene)".to_string(), i));
    for (who, hello) in hellos.iter().filter(|(who, hello)| !has_own_surface(*who, hello)) {
        let here = announced(hello);
        let (other, expected) = known.get_or_insert_with(|| (who.to_string(), here));
        if *expected != here {
            return Err(format!(
                "the canopies differ: {other} has {}, {who} has {}: give all programs the same scene \
                 and version",
                canopy(expected),
                canopy(&here)
            ));
        }
    }
    Ok(known.map(|(_, interface)| interface))
}

/// All ranks of a structure with a surface of its own must have the same.
fn one_own_surface(hellos: &[(RankId, Hello)]) -> Result<(), String> {
    let mut own = hellos.iter().filter(|(who, hello)| has_own_surface(*who, hello));
    let Some((other, first)) = own.next() else { return Ok(()) };
    let expected = announced(first);
    match own.find(|(_, hello)| announced(hello) != expected) {
        None => Ok(()),
        Some((who, hello)) => Err(format!(
            "the structure's own surfaces differ: {other} has {}, {who} has {}",
            canopy(&expected),
            canopy(&announced(hello))
        )),
    }
}

/// Flow and mesh must have the same grid; a structure has none.
fn one_grid(hellos: &[(RankId, Hello)]) -> Result<(), String> {
    let mut grids = hellos.iter().filter(|(who, _)| who.role != Role::Structure);
    let Some((other, first)) = grids.next() else { return Ok(()) };
    let nodes = first.announcement.grid_nodes;
    match grids.find(|(_, hello)| hello.announcement.grid_nodes != nodes) {
        None => Ok(()),
        Some((who, hello)) => Err(format!(
            "the flow grids differ: {other} has {nodes} nodes, {who} has {}: give both programs \
             the same scene and version",
            hello.announcement.grid_nodes
        )),
    }
}

fn check_rows(who: RankId, hello: &Hello) -> Result<(), String> {
    let a = &hello.announcement;
    let rows = match who.role {
        Role::Structure => a.canopy_nodes,
        Role::Flow => a.canopy_faces,
        Role::Mesh => a.grid_nodes,
    };
    if hello.output_rows <= rows && hello.grid_rows <= a.grid_nodes {
        return Ok(());
    }
    Err(format!(
        "{who} announces {} output rows of {rows} and {} grid rows of {}: a rank cannot have more rows than there are",
        hello.output_rows, hello.grid_rows, a.grid_nodes
    ))
}

fn canopy(i: &Interface) -> String {
    format!("{} nodes and {} faces (hash {:016x})", i.nodes, i.faces, i.surface_hash)
}

fn check_alone(options: &HubOptions, spec: &RoleOptions, who: RankId, hello: &Hello) -> Result<(), String> {
    let a = &hello.announcement;
    let name = format!("{who} ({} {})", a.program, a.version);
    let differ = |what: &str, here: String, there: String, remedy: &str| {
        Err(format!("{name} announces {what} {there}, the coupler expects {here}: {remedy}"))
    };
    if hello.contract != CONTRACT_VERSION {
        return differ(
            "contract version",
            CONTRACT_VERSION.to_string(),
            hello.contract.to_string(),
            "build both from the same version",
        );
    }
    if a.role != who.role.name() {
        return differ("role", who.role.name().into(), a.role.clone(), "start the program of that role");
    }
    if hello.ranks != spec.ranks {
        return differ(
            "rank count",
            spec.ranks.to_string(),
            hello.ranks.to_string(),
            "start it with the number of ranks in the scene or in `--ranks`",
        );
    }
    if hello.stage != options.stage {
        return differ("stage", options.stage.to_string(), hello.stage.to_string(), "pass the same --stage");
    }
    let width = Unit::of_output(who.role).width() as u64;
    if a.output_width != width {
        return differ(
            "output width",
            width.to_string(),
            a.output_width.to_string(),
            "see docs/reference/contract.md",
        );
    }
    let lacking: Vec<&str> =
        spec.effects.iter().filter(|e| !a.effects.contains(e)).map(String::as_str).collect();
    if !lacking.is_empty() {
        return Err(format!(
            "the scene requires `{}`, which {name} does not implement (it has: {}): remove the effect from \
             the scene or use another program",
            lacking.join("`, `"),
            if a.effects.is_empty() { "none".into() } else { a.effects.join(", ") }
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Announcement;

    const ROLES: [(Role, usize); 3] = [(Role::Structure, 1), (Role::Flow, 1), (Role::Mesh, 1)];
    const WIDTHS: [u64; 3] = [3, 4, 6];

    fn options() -> HubOptions {
        let role =
            |&(role, ranks): &(Role, usize)| RoleOptions { role, ranks, deadline: None, effects: Vec::new() };
        HubOptions {
            session: "check".into(),
            roles: ROLES.iter().map(role).collect(),
            stage: 2,
            interface: None,
            arrival_deadline: None,
            watch_grid: false,
        }
    }

    /// Structure, flow and mesh of 7 nodes, 5 faces and 11 grid nodes, each rank with all rows.
    fn hellos() -> Vec<(RankId, Hello)> {
        let hello = |(role, width): (Role, u64)| {
            let announcement = Announcement {
                role: role.name().into(),
                program: "p".into(),
                version: "1".into(),
                canopy_nodes: 7,
                canopy_faces: 5,
                surface_hash: 9,
                grid_nodes: 11,
                output_width: width,
                effects: Vec::new(),
            };
            let output_rows = match role {
                Role::Structure => 7,
                Role::Flow => 5,
                Role::Mesh => 11,
            };
            let grid_rows = if role == Role::Flow { 11 } else { 0 };
            let (contract, stage, rank, ranks, pid) = (CONTRACT_VERSION, 2, 0, 1, 1);
            (
                RankId { role, rank },
                Hello { contract, stage, rank, ranks, pid, output_rows, grid_rows, announcement },
            )
        };
        ROLES.iter().map(|r| r.0).zip(WIDTHS).map(hello).collect()
    }

    #[test]
    fn rank_may_have_all_rows_but_not_more() {
        let all = Interface { nodes: 7, faces: 5, surface_hash: 9 };
        assert_eq!(check(&options(), &hellos()), Ok(all));
        for i in 0..3 {
            let mut more = hellos();
            more[i].1.output_rows += 1;
            let text = check(&options(), &more).expect_err("one row too many");
            let reported =
                format!("announces {} output rows of {}", more[i].1.output_rows, more[i].1.output_rows - 1);
            assert!(text.contains(&reported), "{text}");
            let mut more = hellos();
            more[i].1.grid_rows = 12;
            assert!(
                check(&options(), &more).expect_err("a grid row too many").contains("12 grid rows of 11")
            );
        }
    }

    #[test]
    fn each_value_of_an_announcement_is_checked() {
        type Change = fn(&mut Hello);
        let changes: [(Change, &str); 8] = [
            (|h| h.contract -= 1, "contract version"),
            (|h| h.ranks += 1, "rank count 2"),
            (|h| h.stage = 1, "stage 1"),
            (|h| h.announcement.output_width += 1, "output width"),
            (|h| h.announcement.canopy_nodes -= 1, "canopies differ"),
            (|h| h.announcement.canopy_faces += 1, "canopies differ"),
            (|h| h.announcement.surface_hash += 1, "canopies differ"),
            (|h| h.announcement.role = "nothing".into(), "role nothing"),
        ];
        for (change, expected) in changes {
            for i in 0..3 {
                let mut all = hellos();
                change(&mut all[i].1);
                let text = check(&options(), &all).expect_err(expected);
                assert!(text.contains(expected), "{text} lacks {expected}");
            }
        }
        // Flow and mesh must have the same grid; a structure has none.
        for (i, fits) in [(0, true), (1, false), (2, false)] {
            let mut all = hellos();
            all[i].1.announcement.grid_nodes = 12;
            assert_eq!(check(&options(), &all).is_ok(), fits, "{i}");
        }
    }

    #[test]
    fn totals_beyond_the_layouts_are_rejected() {
        for came in [0, 1, 35] {
            assert!(
                is_plausible(2 * came + ROW_MARGIN, came) && !is_plausible(2 * came + ROW_MARGIN + 1, came)
            );
        }
    }

    #[test]
    fn each_row_belongs_to_one_rank() {
        let mut owner = RowOwners::new(3);
        assert_eq!(owner.claim(0, &[2, 0]), Ok(()));
        assert_eq!(owner.complete(), Err("output row 1 is on no rank".into()));
        assert_eq!(owner.claim(1, &[3]), Err("output row 3 is beyond the 3 rows of the interface".into()));
        assert_eq!(owner.claim(1, &[0]), Err("output row 0 is on rank 1 and on rank 0".into()));
        assert_eq!(owner.claim(1, &[1]), Ok(()));
        assert_eq!(owner.complete(), Ok(()));
        assert_eq!(owner.0, [0, 1, 0]);
    }
}
