//! Comparison of two series of exchanges: first deviation and growth of the differences.
//!
//! Differences are relative to the largest magnitude of the field in the reference at the same exchange: pressures and
//! tractions relative to the largest pressure, positions to the largest displacement or coordinate, velocities to the
//! largest velocity. Round-off in a vanishing traction is therefore no deviation. Differences below an absolute floor of
//! the field ([`FIELDS`]) are ignored.
//!
//! A solver can reach the same solution with more iterations, for example with an inconsistent tangent. The iteration
//! counts of each solve ([`COUNTS`]) are therefore compared too. They count as deviation only with an iteration
//! tolerance.

use case::Role;
use channel::{STATS, flow_stats, mesh_stats, structure_stats};
use terminal::counted;

use super::{Channel, Event, Moment};

/// An iteration count of a solver.
pub struct Count {
    /// Program.
    pub role: Role,
    /// Index among the statistics.
    index: usize,
    /// Name in messages.
    pub name: &'static str,
}

impl Count {
    /// The count among the statistics of a solve.
    pub fn of(&self, stats: &[f64; STATS]) -> f64 {
        stats[self.index]
    }
}

/// All counts, in the order in which they are compared.
pub const COUNTS: [Count; 8] = [
    Count { role: Role::Structure, index: structure_stats::STEP_CUTS, name: "time-step reductions" },
    Count { role: Role::Structure, index: structure_stats::NEWTON_STEPS, name: "Newton iterations" },
    Count { role: Role::Structure, index: structure_stats::GMRES_ITERATIONS, name: "GMRES iterations" },
    Count { role: Role::Structure, index: structure_stats::FACTORISATIONS, name: "factorisations" },
    Count { role: Role::Mesh, index: mesh_stats::INCREMENTS, name: "increments" },
    Count { role: Role::Mesh, index: mesh_stats::ITERATIONS, name: "Krylov iterations" },
    Count { role: Role::Flow, index: flow_stats::ITERATIONS, name: "nonlinear iterations" },
    Count { role: Role::Flow, index: flow_stats::LINEAR_ITERATIONS, name: "linear iterations" },
];

/// A count that differs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherCount {
    /// Window and iteration.
    pub at: Moment,
    /// Index in [`COUNTS`].
    pub count: usize,
    /// Values of the reference and of the other run.
    pub values: [f64; 2],
}

impl std::fmt::Display for OtherCount {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (count, [a, b]) = (&COUNTS[self.count], self.values);
        write!(
            f,
            "window {}, iteration {}, {} of the {}: {a} in the reference, {b} now",
            self.at.index,
            self.at.iteration,
            count.name,
            count.role.program()
        )
    }
}

/// A physical field in the rows of a channel.
pub struct Field {
    /// Channel.
    pub channel: Channel,
    /// Name in messages.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Its columns.
    columns: &'static [usize],
    /// Columns whose largest number is the scale.
    scale: &'static [usize],
    /// Absolute floor of differences, in the unit of the field.
    floor: f64,
}

impl Field {
    /// A field with the unit and floor of its channel; the floor is negligible in that unit.
    const fn new(
        channel: Channel,
        name: &'static str,
        columns: &'static [usize],
        scale: &'static [usize],
    ) -> Self {
        let (unit, floor) = match channel {
            Channel::StructureLoad | Channel::FlowLoad => ("Pa", 1e-9),
            Channel::StructureDisplacement | Channel::MeshDisplacement => ("m", 1e-12),
            // Positions, then velocities.
            Channel::Grid if columns[0] < 3 => ("m", 1e-12),
            Channel::Grid => ("m/s", 1e-9),
        };
        Self { channel, name, unit, columns, scale, floor }
    }
}

/// All fields in the order of reports, with their columns and the columns of their scale.
pub const FIELDS: [Field; 8] = [
    Field::new(Channel::StructureLoad, "pressure jump to the structure", &[0, 4], &[0, 4]),
    Field::new(Channel::StructureLoad, "traction to the structure", &[1, 2, 3, 5, 6, 7], &[0, 4]),
    Field::new(Channel::StructureDisplacement, "displacement from the structure", &[0, 1, 2], &[0, 1, 2]),
    Field::new(Channel::MeshDisplacement, "displacement to the mesh", &[0, 1, 2], &[0, 1, 2]),
    Field::new(Channel::Grid, "grid positions", &[0, 1, 2], &[0, 1, 2]),
    Field::new(Channel::Grid, "grid velocities", &[3, 4, 5], &[3, 4, 5]),
    Field::new(Channel::FlowLoad, "pressure jump from the flow", &[0], &[0]),
    Field::new(Channel::FlowLoad, "traction from the flow", &[1, 2, 3], &[0]),
];

/// A value that deviates.
#[derive(Clone, Debug, PartialEq)]
pub struct Deviation {
    /// Window and iteration.
    pub at: Moment,
    /// Index in [`FIELDS`].
    pub field: usize,
    /// Row: canopy node or face, or grid node.
    pub row: usize,
    /// Column of the channel.
    pub column: usize,
    /// Values of the reference and of the other run.
    pub values: [f64; 2],
    /// Difference relative to the scale.
    pub relative: f64,
}

impl std::fmt::Display for Deviation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let field = &FIELDS[self.field];
        let row = match field.channel {
            Channel::StructureLoad | Channel::FlowLoad => "face",
            Channel::StructureDisplacement | Channel::MeshDisplacement => "canopy node",
            Channel::Grid => "grid node",
        };
        write!(
            f,
            "window {}, iteration {}, {}, {row} {} component {}: {:.9e} and {:.9e} {}, relative difference {:.1e}",
            self.at.index,
            self.at.iteration,
            field.name,
            self.row,
            self.column,
            self.values[0],
            self.values[1],
            field.unit,
            self.relative
        )
    }
}

/// Largest relative difference of each field in a window.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindowDifference {
    /// Window.
    pub window: u64,
    /// Values in the order of [`FIELDS`]; `None` if not compared.
    pub fields: [Option<f64>; FIELDS.len()],
}

/// Result of a comparison.
#[derive(Clone, Debug, Default)]
pub struct Comparison {
    /// Relative tolerance.
    pub tolerance: f64,
    /// First value beyond the tolerance.
    pub first: Option<Deviation>,
    /// Largest differences of each window.
    pub windows: Vec<WindowDifference>,
    /// Number of compared values.
    pub numbers: u64,
    /// First window with different numbers of coupling iterations, and both numbers.
    pub other_iterations: Option<(u64, [u64; 2])>,
    /// Relative tolerance of iteration counts, whose product with the reference is rounded up. `None`: counts are reported,
    /// but are no deviation.
    pub iteration_tolerance: Option<f64>,
    /// First count beyond the iteration tolerance (without one: first different count).
    pub first_count: Option<OtherCount>,
}

impl Comparison {
    /// An empty comparison with relative tolerance `tolerance`.
    pub fn new(tolerance: f64) -> Self {
        Self { tolerance, ..Self::default() }
    }

    /// Sets the relative tolerance of iteration counts.
    pub fn judging_counts(mut self, slack: Option<f64>) -> Self {
        self.iteration_tolerance = slack;
        self
    }

    /// Compares an exchange with that of the reference. Arrays missing in one of them are skipped.
    pub fn add<A: AsRef<[f64]>, B: AsRef<[f64]>>(&mut self, reference: &Event<A>, other: &Event<B>) {
        let others = other.arrays();
        for (channel, values) in reference.arrays() {
            if let Some((_, b)) = others.iter().find(|(c, _)| *c == channel) {
                self.add_array(reference.at(), channel, values.as_ref(), b.as_ref());
            }
        }
        if let (Some(role), Some(a), Some(b)) = (reference.role(), reference.stats(), other.stats()) {
            self.add_counts(reference.at(), role, a, b);
        }
    }

    /// Compares the iteration counts of a solve.
    pub fn add_counts(&mut self, at: &Moment, role: Role, reference: &[f64; STATS], other: &[f64; STATS]) {
        if self.first_count.is_some() {
            return;
        }
        let slack = self.iteration_tolerance.unwrap_or(0.0);
        let beyond = |(_, count): &(usize, &Count)| {
            let (a, b) = (count.of(reference), count.of(other));
            count.role == role && (a - b).abs() > (slack * a).ceil()
        };
        self.first_count = COUNTS.iter().enumerate().find(beyond).map(|(number, count)| OtherCount {
            at: *at,
            count: number,
            values: [count.of(reference), count.of(other)],
        });
    }

    /// Compares one array.
    pub fn add_array(&mut self, at: &Moment, channel: Channel, reference: &[f64], other: &[f64]) {
        self.numbers += reference.len() as u64;
        if self.windows.last().is_none_or(|w| w.window != at.index) {
            self.windows.push(WindowDifference { window: at.index, ..Default::default() });
        }
        for (number, field) in FIELDS.iter().enumerate().filter(|(_, f)| f.channel == channel) {
            let worst = worst(field, reference, other);
            if let Some(window) = self.windows.last_mut() {
                let so_far = &mut window.fields[number];
                *so_far = Some(so_far.unwrap_or(0.0).max(worst.map_or(0.0, |w| w.3)));
            }
            if let Some((row, column, values, relative)) = worst
                && relative > self.tolerance
                && self.first.is_none()
            {
                self.first = Some(Deviation { at: *at, field: number, row, column, values, relative });
            }
        }
    }

    /// Whether there is no deviation beyond the tolerances.
    pub fn same(&self) -> bool {
        self.first.is_none() && self.judged_count().is_none()
    }

    /// First count beyond the iteration tolerance.
    pub fn judged_count(&self) -> Option<&OtherCount> {
        self.first_count.as_ref().filter(|_| self.iteration_tolerance.is_some())
    }

    /// Description of the first deviation.
    pub fn deviation(&self) -> Option<String> {
        let numbers = self.first.as_ref().map(ToString::to_string);
        numbers.or_else(|| self.judged_count().map(ToString::to_string))
    }

    /// Text report: first deviation, and first, last and largest difference of each field.
    pub fn report(&self) -> String {
        let mut text = match &self.first {
            None => format!(
                "no deviation above {:.0e}: {} in {}",
                self.tolerance,
                counted(self.numbers, "number"),
                counted(self.windows.len() as u64, "window")
            ),
            Some(d) => format!("first deviation: {d} (tolerance {:.0e})", self.tolerance),
        };
        if let Some((window, [a, b])) = self.other_iterations {
            text.push_str(&format!(
                "\nwindow {window}: {} in the reference, {b} now",
                counted(a, "iteration")
            ));
        }
        if let Some(count) = &self.first_count {
            let judged = match self.iteration_tolerance {
                Some(slack) => format!("tolerance {:.0} %", 100.0 * slack),
                None => "ignored without --iteration-tolerance".into(),
            };
            text.push_str(&format!("\nfirst different iteration count: {count} ({judged})"));
        }
        text.push_str("\n  relative difference           first window   last window    largest  in window");
        for (number, field) in FIELDS.iter().enumerate() {
            let seen: Vec<(u64, f64)> =
                self.windows.iter().filter_map(|w| Some((w.window, w.fields[number]?))).collect();
            let (Some(first), Some(last)) = (seen.first(), seen.last()) else { continue };
            let most = seen.iter().fold(*first, |m, w| if w.1 > m.1 { *w } else { m });
            text.push_str(&format!(
                "\n  {:<32} {:9.1e}     {:9.1e}  {:9.1e}  {:9}",
                field.name, first.1, last.1, most.1, most.0
            ));
        }
        text
    }

    /// CSV table: one row per window, one column of relative differences per field.
    pub fn csv(&self) -> String {
        let names: Vec<String> = FIELDS.iter().map(|f| f.name.replace(' ', "_")).collect();
        let mut text = format!("window,{}\n", names.join(","));
        for w in &self.windows {
            let cells: Vec<String> =
                w.fields.iter().map(|d| d.map_or(String::new(), |d| format!("{d:.6e}"))).collect();
            text.push_str(&format!("{},{}\n", w.window, cells.join(",")));
        }
        text
    }
}

/// Largest relative difference of a field: row, column, values, relative difference. `None` if all differences are below
/// the floor. Values that are not finite have an infinite difference.
fn worst(field: &Field, reference: &[f64], other: &[f64]) -> Option<(usize, usize, [f64; 2], f64)> {
    let width = field.channel.width();
    if reference.len() != other.len() {
        return Some((reference.len().min(other.len()) / width, 0, [f64::NAN; 2], f64::INFINITY));
    }
    let rows = || reference.chunks_exact(width).zip(other.chunks_exact(width)).enumerate();
    let scale = rows()
        .flat_map(|(_, (a, _))| field.scale.iter().map(move |&c| a[c].abs()))
        .fold(0.0, |m: f64, v| if v > m { v } else { m });
    let mut worst: Option<(usize, usize, [f64; 2], f64)> = None;
    for (row, (a, b)) in rows() {
        for &c in field.columns {
            let difference = (a[c] - b[c]).abs();
            if difference <= field.floor || a[c].to_bits() == b[c].to_bits() {
                continue;
            }
            let relative =
                if difference.is_nan() { f64::INFINITY } else { difference / scale.max(field.floor) };
            if worst.is_none_or(|w| relative > w.3) {
                worst = Some((row, c, [a[c], b[c]], relative));
            }
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(index: u64) -> Moment {
        Moment {
            index,
            iteration: 1,
            substeps: 1,
            time: 0.0,
            dt: 1.0,
            frame_velocity: [0.0; 3],
            frame_acceleration: [0.0; 3],
        }
    }

    #[test]
    fn iteration_counts_are_compared_with_their_tolerance() {
        let event = |newton: f64| {
            let mut stats = [0.0; STATS];
            stats[structure_stats::NEWTON_STEPS] = newton;
            stats[structure_stats::ASSEMBLY_S] = 1e-3 * newton;
            Event::Structure { at: at(1), load: vec![0.0; 8], displacement: vec![0.0; 3], stats }
        };
        let compared = |slack, other| {
            let mut c = Comparison::new(0.0).judging_counts(slack);
            c.add(&event(3.0), &event(other));
            c
        };
        // 25 % of 3, rounded up, is 1. Times are not compared.
        assert!(compared(Some(0.25), 4.0).same() && compared(Some(0.0), 3.0).same());
        assert!(!compared(Some(0.0), 4.0).same());
        let far = compared(Some(0.25), 7.0);
        let says =
            "window 1, iteration 1, Newton iterations of the structure-solver: 3 in the reference, 7 now";
        assert_eq!(far.deviation().as_deref(), Some(says));
        assert!(!far.same() && far.report().contains(says), "{}", far.report());
        // Without a tolerance it is reported only.
        let reported = compared(None, 4.0);
        assert!(reported.same() && reported.deviation().is_none());
        assert!(reported.report().contains("3 in the reference, 4 now"));
    }

    #[test]
    fn first_deviation_is_reported_with_its_location() {
        let mut c = Comparison::new(1e-6);
        let a = [10.0, 0.0, 0.0, 0.0, -20.0, 0.0, 0.0, 0.0];
        let mut b = a;
        c.add_array(&at(0), Channel::FlowLoad, &a, &b);
        assert!(c.same());
        b[6] = 1e-7;
        c.add_array(&at(1), Channel::FlowLoad, &a, &b);
        assert!(c.same(), "a traction of 1e-7 Pa relative to 20 Pa");
        b[4] = -20.1;
        c.add_array(&at(2), Channel::FlowLoad, &a, &b);
        let first = c.first.clone().expect("a deviation");
        assert_eq!((first.at.index, first.row, first.column, first.field), (2, 1, 0, 6));
        assert!((first.relative - 0.005).abs() < 1e-12);
        assert!(c.report().contains("window 2, iteration 1, pressure jump from the flow"), "{}", c.report());
        assert_eq!(c.windows.len(), 3);
        assert_eq!(c.windows[0].fields[6], Some(0.0));
        assert_eq!(c.windows[0].fields[0], None);
    }

    #[test]
    fn nan_deviates_unless_both_values_are_bitwise_identical() {
        let mut c = Comparison::new(1e-3);
        c.add_array(&at(0), Channel::StructureDisplacement, &[f64::NAN, 0.0, 0.0], &[f64::NAN, 0.0, 0.0]);
        assert!(c.same());
        c.add_array(&at(0), Channel::StructureDisplacement, &[1.0, 0.0, 0.0], &[f64::NAN, 0.0, 0.0]);
        assert_eq!(c.first.expect("a deviation").relative, f64::INFINITY);
    }
}
