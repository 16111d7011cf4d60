//! The parts of a step on a device, in the order of `flow.rs`.

use std::ops::Range;
use std::rc::Rc;

use nalgebra::Vector3;

use super::arguments::Arguments;
use super::eddies::DeviceEddies;
use super::queue::{Buffer, Queue};
use super::rows::DeviceRows;
use super::surface::{DeviceEdges, DeviceFriction};
use super::tables::Tables;
use super::{Address, Device, DeviceError, Product};
use crate::constraints::{FluxConstraints, JumpsOfRows};
use crate::eddy_viscosity::EddyViscosity;
use crate::free_edges::EdgeFluxes;
use crate::friction::Friction;
use crate::grid::{Grid, Velocity};
use crate::momentum::Momentum;
use crate::poisson::{Box3, Poisson};
use crate::wall_rates::WallRates;

/// Shares of the cells in the search for largest values: first and second.
const SHARES: [usize; 2] = [131_072, 512];
/// Constraints of so many steps stay on the device.
const MOST_ROWS: usize = 16;

/// Three staggered components on the device.
type Field = [Buffer; 3];

fn addresses(field: &Field) -> [Address; 3] {
    [0, 1, 2].map(|c| field[c].at(0))
}

/// A step to which the flow may return.
#[derive(Debug)]
struct Kept {
    velocity: Field,
    before: Field,
    rates: Field,
    /// Length of the step before it, if there was one, s.
    previous_dt: Option<f64>,
}

/// Largest values of a velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Largest {
    /// Sum over the axes of velocity over width of a cell, 1/s.
    pub(crate) rate: f64,
    /// Speed, m/s.
    pub(crate) speed: f64,
    /// Least and largest pressure, as it is in its array.
    pub(crate) pressures: [f64; 2],
}

/// Finds the largest of values that the cells have, `N` of each.
#[derive(Debug)]
pub(crate) struct Reduction<const N: usize> {
    first: Buffer,
    second: Buffer,
}

impl<const N: usize> Reduction<N> {
    pub(crate) fn new(queue: &Queue) -> Self {
        let [first, second] = SHARES.map(|shares| queue.buffer(N * shares));
        Self { first, second }
    }

    /// Arguments of a kernel that gives the largest values of shares, up to their places.
    pub(crate) fn arguments() -> Arguments {
        Arguments::of(SHARES[0])
    }

    /// Where the kernel puts them.
    pub(crate) fn shares(&self) -> [Address; N] {
        std::array::from_fn(|i| self.first.at(i * SHARES[0]))
    }

    /// The largest values after that loop; what is not a number stays so.
    pub(crate) fn values(&self, queue: &Queue) -> [f64; N] {
        let arguments = Arguments::of(N * SHARES[1])
            .address(self.first.at(0))
            .address(self.second.at(0))
            .integers(&[SHARES[1], SHARES[0] / SHARES[1]]);
        queue.launch("reduce", &arguments);
        let mut found = vec![0.0; N * SHARES[1]];
        queue.download(self.second.at(0), &mut found);
        let larger = |a: f64, b: f64| if b > a || b.is_nan() { b } else { a };
        std::array::from_fn(|i| {
            found[i * SHARES[1]..(i + 1) * SHARES[1]].iter().copied().fold(f64::NEG_INFINITY, larger)
        })
    }
}

/// How a step continues the last ones.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extrapolation {
    /// Length of the step, s.
    pub(crate) dt: f64,
    /// Share of the rates of the step before.
    pub(crate) back: f64,
}

/// The flow on a device.
#[derive(Debug)]
pub(crate) struct DeviceFlow {
    queue: Queue,
    tables: Tables,
    cells: [usize; 3],
    strides: [usize; 3],
    length: usize,
    velocity: Field,
    /// Rates of the step before, and of the predicted one.
    before: Field,
    rates: Field,
    predicted: Field,
    edges: Option<DeviceEdges>,
    /// Friction of the prediction, which serves again where the surface rests.
    friction: Option<DeviceFriction>,
    kept: Option<Kept>,
    /// Free arrays of velocities, and of rates, whose ghosts are zero.
    spare: [Vec<Field>; 2],
    pressure: Buffer,
    /// Pressures of the box around the surface, modes in x, and modes in x and y.
    boxed: Buffer,
    of_x: Buffer,
    modes: Buffer,
    /// Inverse pivots of the last cells of the box.
    closure: Buffer,
    largest: Reduction<4>,
    rows: Vec<DeviceRows>,
    eddies: Option<DeviceEddies>,
}

impl DeviceFlow {
    /// For a flow on `grid`.
    ///
    /// # Errors
    /// No memory.
    pub(crate) fn new(device: Rc<dyn Device>, grid: &Grid, poisson: &Poisson) -> Result<Self, DeviceError> {
        let queue = Queue::new(device);
        let (length, count) = (grid.array_len(), grid.count());
        let [nx, ny, _] = grid.cells();
        let field = || [0, 1, 2].map(|_| queue.buffer(length));
        let flow = Self {
            tables: Tables::new(&queue, grid, poisson),
            cells: grid.cells(),
            strides: grid.strides,
            length,
            velocity: field(),
            before: field(),
            rates: field(),
            predicted: field(),
            edges: None,
            friction: None,
            kept: None,
            spare: Default::default(),
            pressure: queue.buffer(count),
            boxed: queue.buffer(1),
            of_x: queue.buffer(count),
            modes: queue.buffer(count),
            closure: queue.buffer(nx * ny),
            largest: Reduction::new(&queue),
            rows: Vec::new(),
            eddies: None,
            queue,
        };
        match flow.failure() {
            Some(error) => Err(error),
            None => Ok(flow),
        }
    }

    pub(crate) fn device(&self) -> &Rc<dyn Device> {
        self.queue.device()
    }

    /// The first failure of the device.
    pub(crate) fn failure(&self) -> Option<DeviceError> {
        self.queue.failure()
    }

    pub(crate) fn tables(&self) -> (&Queue, &Tables) {
        (&self.queue, &self.tables)
    }

    fn count(&self) -> usize {
        self.cells.iter().product()
    }

    /// An array for a velocity (0) or rates (1).
    fn field(&mut self, kind: usize) -> Field {
        let Self { spare, queue, length, .. } = self;
        spare[kind].pop().unwrap_or_else(|| [0, 1, 2].map(|_| queue.buffer(*length)))
    }

    /// Takes velocity and rates of the last step from the host.
    pub(crate) fn upload(&mut self, velocity: &Velocity, before: &Velocity) {
        for c in 0..3 {
            self.queue.upload(self.velocity[c].at(0), &velocity[c]);
            if !before[c].is_empty() {
                self.queue.upload(self.before[c].at(0), &before[c]);
            }
        }
    }

    /// Gives velocity, rates of the last step and pressure to the host.
    pub(crate) fn download(&self, velocity: &mut Velocity, before: &mut Velocity, pressure: &mut [f64]) {
        for c in 0..3 {
            for (values, field) in [(&mut velocity[c], &self.velocity[c]), (&mut before[c], &self.before[c])]
            {
                values.resize(self.length, 0.0);
                self.queue.download(field.at(0), values);
            }
        }
        self.queue.download(self.pressure.at(0), pressure);
    }

    // ---- prediction

    /// Rates of convection, viscosity and friction.
    pub(crate) fn find_rates(
        &mut self,
        (momentum, frame): (&Momentum, Vector3<f64>),
        grid: &Grid,
        edges: &EdgeFluxes,
        friction: Option<&Friction>,
    ) {
        let (u, rates) = (addresses(&self.velocity), addresses(&self.rates));
        for (c, of_component) in rates.into_iter().enumerate() {
            let arguments = Arguments::of(self.count())
                .integers(&self.tables.grid)
                .addresses(u)
                .address(of_component)
                .address(self.tables.undisturbed(c))
                .integer(c);
            let arguments = self.tables.lines(c).into_iter().fold(arguments, Arguments::address);
            let arguments = arguments
                .numbers(frame.as_slice())
                .number(momentum.upwind_share / 12.0)
                .number(momentum.viscosity)
                .integers(&self.tables.outflows());
            self.queue.launch("rates", &arguments);
        }
        if !edges.is_empty() {
            let known = self.edges.take().filter(|known| known.are(edges, momentum.upwind_share));
            let edges =
                known.unwrap_or_else(|| DeviceEdges::new(&self.queue, grid, edges, momentum.upwind_share));
            let targets = &edges.targets;
            let arguments = Arguments::of(targets.count).addresses(u).addresses(rates);
            let arguments = (0..6).fold(arguments, |words, i| words.address(targets.array(i)));
            let arguments =
                arguments.address(edges.factors.at(0)).integers(&self.strides).numbers(frame.as_slice());
            self.queue.launch("edges", &arguments);
            self.edges = Some(edges);
        }
        let known = self.friction.take();
        self.friction = friction.map(|friction| match known.filter(|known| known.is(friction)) {
            Some(known) => {
                known.set_velocities(&self.queue, friction);
                known
            }
            None => DeviceFriction::new(&self.queue, friction),
        });
        if let Some(friction) = &self.friction {
            let targets = &friction.interrupted;
            let arguments = Arguments::of(targets.count).addresses(u).addresses(rates);
            let arguments = (0..4).fold(arguments, |words, i| words.address(targets.array(i)));
            let h = grid.axes[0].spacing;
            self.queue.launch("interrupt", &arguments.number(momentum.viscosity / (h * h)));
        }
        if let Some(eddies) = &self.eddies {
            eddies.update(&self.queue, &self.tables, u, friction);
            eddies.add_rates(&self.queue, &self.tables, u, rates);
        }
    }

    /// Sets the model of the small eddies.
    pub(crate) fn set_eddies(&mut self, grid: &Grid, eddies: Option<&EddyViscosity>) {
        self.eddies = eddies.map(|eddies| DeviceEddies::new(&self.queue, grid, eddies));
    }

    /// Rate of the eddy viscosity of the accepted velocity ([`crate::flow::Flow::largest_eddy_rate`]).
    pub(crate) fn largest_eddy_rate(&self, friction: Option<&Friction>) -> f64 {
        let Some(eddies) = &self.eddies else { return 0.0 };
        eddies.update(&self.queue, &self.tables, addresses(&self.velocity), friction);
        eddies.largest_rate(&self.queue, &self.tables)
    }

    /// Gives the eddy viscosity to the host.
    pub(crate) fn download_eddies(&self, values: &mut [f64]) {
        if let Some(eddies) = &self.eddies {
            eddies.download(&self.queue, values);
        }
    }

    /// The predicted velocity without friction, pressure and surface.
    pub(crate) fn extrapolate(&self, step: Extrapolation) {
        for c in 0..3 {
            let arguments = Arguments::of(self.count())
                .integers(&self.tables.grid)
                .address(self.predicted[c].at(0))
                .address(self.velocity[c].at(0))
                .address(self.rates[c].at(0))
                .address(self.before[c].at(0))
                .address(self.tables.change(c))
                .number(step.dt * (1.0 + step.back))
                .number(step.dt * step.back);
            self.queue.launch("extrapolate", &arguments);
        }
    }

    /// The wall stress of a step of `dt` s, in the predicted velocity; `friction` gets its forces. `rates`: those of the step before.
    pub(crate) fn apply_friction(
        &self,
        friction: &mut Friction,
        [density, viscosity, dt]: [f64; 3],
        rates: &WallRates,
    ) {
        let Some(on_device) = &self.friction else { return };
        let rates: Vec<f64> = friction.values().map(|value| rates.of(value)).collect();
        self.queue.upload(on_device.values(0), &rates);
        let h = friction.spacing();
        let targets = &on_device.walls;
        let arguments = Arguments::of(targets.count)
            .addresses(addresses(&self.predicted))
            .addresses(addresses(&self.velocity));
        let arguments = (0..3).fold(arguments, |words, i| words.address(targets.array(i)));
        let arguments = (0..4).fold(arguments, |words, i| words.address(on_device.sides(i)));
        let arguments = (0..2).fold(arguments, |words, i| words.address(on_device.values(i)));
        let arguments = arguments.number(viscosity * dt / h).number(density * h.powi(3) / dt).number(dt);
        self.queue.launch("wall", &arguments);
        let mut forces = vec![0.0; on_device.len()];
        self.queue.download(on_device.sides(3), &mut forces);
        friction.set_forces(&forces);
    }

    /// Rates at the values next to the surface by the jumps, which the predicted velocity has, and the pressure; for [`WallRates`].
    fn wall_rates(&self, dt: f64) -> Vec<f64> {
        let Some(on_device) = &self.friction else { return Vec::new() };
        let targets = &on_device.walls;
        let arguments = Arguments::of(targets.count)
            .integers(&self.tables.grid)
            .addresses(addresses(&self.predicted))
            .address(targets.array(0))
            .address(targets.array(1))
            .address(on_device.values(1))
            .address(self.pressure.at(0))
            .addresses(self.tables.inverse())
            .address(on_device.values(0))
            .number(dt);
        self.queue.launch("wall_rates", &arguments);
        let mut rates = vec![0.0; targets.count];
        self.queue.download(on_device.values(0), &mut rates);
        rates
    }

    /// Ghosts of the predicted velocity, and its pressure.
    pub(crate) fn close_prediction(&self) {
        self.fill_ghosts(&self.predicted);
        for (c, ends) in self.tables.ends.iter().enumerate() {
            let n = self.cells[c];
            for (end, face, inner) in [(ends[0], 0, 1), (ends[1], n, n - 1)] {
                if end == 2 {
                    let threads = self.cells[(c + 1) % 3] * self.cells[(c + 2) % 3];
                    let arguments = Arguments::of(threads)
                        .integers(&self.tables.grid)
                        .address(self.predicted[c].at(0))
                        .integers(&[c, face, inner]);
                    self.queue.launch("outflow", &arguments);
                }
            }
        }
    }

    fn fill_ghosts(&self, field: &Field) {
        for d in 0..3 {
            let threads: usize = 3 * (1..3).map(|e| self.cells[(d + e) % 3] + 4).product::<usize>();
            let [low, high] = self.tables.ends[d];
            let arguments = Arguments::of(threads)
                .integers(&self.tables.grid)
                .addresses(addresses(field))
                .addresses(self.tables.far())
                .integers(&[d, low, high]);
            self.queue.launch("ghosts", &arguments);
        }
    }

    // ---- pressure

    /// The pressure that removes the divergence of the predicted velocity.
    pub(crate) fn solve_pressure(&self) {
        let arguments = Arguments::of(self.count())
            .integers(&self.tables.grid)
            .addresses(addresses(&self.predicted))
            .addresses(self.tables.widths())
            .address(self.pressure.at(0));
        self.queue.launch("divergence", &arguments);
        let all = self.cells.map(|n| 0..n);
        let plane = self.cells[0] * self.cells[1];
        self.solve_in(&self.pressure, &all, self.tables.pivots.at((self.cells[2] - 1) * plane));
    }

    /// The pressure equation in a box of cells, in place ([`Poisson::solve_in`]).
    fn solve_in(&self, p: &Buffer, cells: &Box3, closure: Address) {
        let [bx, by, bz] = [0, 1, 2].map(|d| cells[d].len());
        let [nx, ny, _] = self.cells;
        let [p, of_x, modes] = [p.at(0), self.of_x.at(0), self.modes.at(0)];
        let vx = self.tables.modes[0].at(cells[0].start);
        let vy = self.tables.modes[1].at(cells[1].start);
        let whole = Product {
            size: [nx, by * bz, bx],
            transposed: [true, false],
            at: [vx, p, of_x],
            columns: [nx, bx, nx],
            next: [0; 3],
            count: 1,
        };
        let planes = Product {
            size: [nx, ny, by],
            transposed: [false; 2],
            at: [of_x, vy, modes],
            columns: [nx, ny, nx],
            next: [nx * by, 0, nx * ny],
            count: bz,
        };
        self.queue.multiply(&whole);
        self.queue.multiply(&planes);
        let arguments = Arguments::of(nx * ny)
            .address(modes)
            .address(self.tables.pivots.at(0))
            .address(self.tables.coupling())
            .address(closure)
            .integers(&[cells[2].start, bz]);
        self.queue.launch("along_z", &arguments);
        self.queue.multiply(&Product {
            size: [nx, by, ny],
            transposed: [false, true],
            at: [modes, vy, of_x],
            next: [nx * ny, 0, nx * by],
            ..planes
        });
        self.queue.multiply(&Product {
            size: [bx, by * bz, nx],
            transposed: [false; 2],
            at: [vx, of_x, p],
            columns: [nx, nx, bx],
            ..whole
        });
    }

    /// Ends the step of `dt` s with the pressure jumps of the rows, `factor` being its length over the mass of a cell: its own, and then changes of earlier ones, which do
    /// not change the pressure. Returns the rates at the values next to the surface. `keep`: one may return to it, with this length of the step before.
    pub(crate) fn end_step(
        &mut self,
        grid: &Grid,
        [own, earlier]: [Option<JumpsOfRows<'_>>; 2],
        (factor, dt): (f64, f64),
        keep: Option<Option<f64>>,
    ) -> Vec<f64> {
        self.spread(grid, own, factor);
        self.solve_pressure();
        let wall_rates = self.wall_rates(dt);
        let own_pressure = earlier.map(|_| {
            let pressure = self.queue.buffer(self.count());
            self.queue.copy(&self.pressure, &pressure);
            self.spread(grid, earlier, factor);
            self.solve_pressure();
            pressure
        });
        let arguments = Arguments::of(self.count())
            .integers(&self.tables.grid)
            .address(self.pressure.at(0))
            .addresses(addresses(&self.predicted))
            .addresses(self.tables.inverse())
            .integers(&self.tables.outflows())
            .integers(&self.tables.periodic());
        self.queue.launch("gradient", &arguments);
        if let Some(pressure) = own_pressure {
            self.pressure = pressure;
        }
        if let Some(previous_dt) = keep {
            let rates = self.field(1);
            for (from, to) in self.rates.iter().zip(&rates) {
                self.queue.copy(from, to);
            }
            let [velocity, before] = [self.field(0), self.field(1)];
            let kept = Kept {
                velocity: std::mem::replace(&mut self.velocity, velocity),
                before: std::mem::replace(&mut self.before, before),
                rates,
                previous_dt,
            };
            self.release_kept();
            self.kept = Some(kept);
        }
        std::mem::swap(&mut self.velocity, &mut self.predicted);
        std::mem::swap(&mut self.before, &mut self.rates);
        self.fill_ghosts(&self.velocity);
        wall_rates
    }

    /// Adds the velocity changes at the faces of rows by pressure jumps there to the predicted velocity.
    fn spread(&mut self, grid: &Grid, jumps: Option<JumpsOfRows<'_>>, factor: f64) {
        let Some((rows, jumps)) = jumps.filter(|(rows, _)| !rows.is_empty()) else { return };
        let rows = self.rows_on_device(grid, rows);
        self.impulses(rows, jumps, -factor);
        let rows = &self.rows[rows];
        let arguments = Arguments::of(rows.faces_cut)
            .addresses(addresses(&self.predicted))
            .address(rows.of_faces(0))
            .address(rows.of_faces(1))
            .address(rows.impulse());
        self.queue.launch("spread", &arguments);
    }

    /// Length of the step before the kept one, s.
    pub(crate) fn kept_before(&self) -> Option<Option<f64>> {
        self.kept.as_ref().map(|kept| kept.previous_dt)
    }

    /// Returns to the start of the kept step.
    pub(crate) fn return_to_start(&mut self) {
        if let Some(kept) = self.kept.take() {
            self.spare[0].push(std::mem::replace(&mut self.velocity, kept.velocity));
            self.spare[1].push(std::mem::replace(&mut self.before, kept.before));
            self.spare[1].push(kept.rates);
        }
    }

    /// Ends the possibility to return to the kept step.
    pub(crate) fn release_kept(&mut self) {
        if let Some(kept) = self.kept.take() {
            self.spare[0].push(kept.velocity);
            self.spare[1].extend([kept.before, kept.rates]);
        }
    }

    /// Frees the arrays that no accepted step needs.
    pub(crate) fn release_arrays(&mut self) {
        self.release_kept();
        self.spare = Default::default();
        self.rows = Vec::new();
        (self.edges, self.friction) = (None, None);
    }

    // ---- constraints

    /// Number of the constraints among those that are on the device.
    fn rows_on_device(&mut self, grid: &Grid, rows: &FluxConstraints) -> usize {
        if let Some(found) = self.rows.iter().position(|known| known.are(rows)) {
            return found;
        }
        if self.rows.len() == MOST_ROWS {
            self.rows.remove(0);
        }
        self.rows.push(DeviceRows::new(&self.queue, grid, rows));
        self.rows.len() - 1
    }

    /// Fluxes of the predicted velocity without divergence through `rows`, m3/s, and largest speeds there, m/s.
    pub(crate) fn predicted_fluxes(
        &mut self,
        grid: &Grid,
        rows: &FluxConstraints,
        fluxes: &mut [f64],
        speeds: &mut [f64],
    ) {
        if rows.is_empty() {
            return;
        }
        let number = self.rows_on_device(grid, rows);
        let rows = &self.rows[number];
        let arguments =
            Arguments::of(rows.len()).addresses(addresses(&self.predicted)).address(self.pressure.at(0));
        let arguments =
            [0, 2, 3, 4, 5].into_iter().fold(arguments, |words, i| words.address(rows.of_rows(i)));
        let arguments = arguments
            .address(rows.number(0))
            .address(rows.number(1))
            .address(rows.vector(1))
            .address(rows.vector(2));
        self.queue.launch("fluxes", &arguments);
        self.queue.download(rows.vector(1), fluxes);
        self.queue.download(rows.vector(2), speeds);
    }

    /// Velocity changes at the faces by `jumps`.
    fn impulses(&self, rows: usize, jumps: &[f64], factor: f64) {
        let rows = &self.rows[rows];
        self.queue.upload(rows.vector(0), jumps);
        let arguments = Arguments::of(rows.faces_cut)
            .address(rows.vector(0))
            .address(rows.of_faces(2))
            .address(rows.of_faces(3))
            .address(rows.number(2))
            .address(rows.impulse())
            .number(factor);
        self.queue.launch("impulses", &arguments);
    }

    /// Prepares [`Self::responses`] of `rows` with these `leak`s; `closure` as in [`Poisson::closure`].
    pub(crate) fn prepare(
        &mut self,
        grid: &Grid,
        rows: &FluxConstraints,
        leak: &[f64],
        closure: &[f64],
    ) -> usize {
        let number = self.rows_on_device(grid, rows);
        self.queue.upload(self.rows[number].vector(3), leak);
        self.queue.upload(self.closure.at(0), closure);
        let count = rows.cells.iter().map(Range::len).product();
        if self.boxed.len() < count {
            self.boxed = self.queue.buffer(count);
        }
        number
    }

    /// Fluxes through the rows that `jumps` cause.
    pub(crate) fn responses(&self, number: usize, jumps: &[f64], factor: f64, fluxes: &mut [f64]) {
        self.impulses(number, jumps, factor);
        let rows = &self.rows[number];
        let cells: usize = rows.cells.iter().map(Range::len).product();
        self.queue.clear(self.boxed.at(0), cells);
        let arguments = Arguments::of(rows.cells_cut)
            .address(rows.of_cells(0))
            .address(rows.of_cells(1))
            .address(rows.of_cells(2))
            .address(rows.number(3))
            .address(rows.impulse())
            .address(self.boxed.at(0));
        self.queue.launch("sources", &arguments);
        self.solve_in(&self.boxed, &rows.cells, self.closure.at(0));
        let arguments = Arguments::of(rows.len());
        let arguments = [0, 1, 6, 7].into_iter().fold(arguments, |words, i| words.address(rows.of_rows(i)));
        let arguments = arguments
            .address(rows.number(0))
            .address(rows.number(1))
            .address(rows.impulse())
            .address(self.boxed.at(0))
            .address(rows.vector(3))
            .address(rows.vector(0))
            .address(rows.vector(1));
        self.queue.launch("responses", &arguments);
        self.queue.download(rows.vector(1), fluxes);
    }

    // ---- largest values

    /// Largest values of the accepted velocity relative to `frame`, and of the pressure.
    pub(crate) fn largest(&self, frame: Vector3<f64>) -> Largest {
        let arguments = Reduction::<4>::arguments()
            .integers(&self.tables.grid)
            .addresses(addresses(&self.velocity))
            .addresses(self.tables.inverse_widths())
            .address(self.pressure.at(0))
            .numbers(frame.as_slice());
        let arguments = self.largest.shares().into_iter().fold(arguments, Arguments::address);
        self.queue.launch("largest", &arguments);
        let [rate, speed, low, high] = self.largest.values(&self.queue);
        Largest { rate, speed, pressures: [-low, high] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The arguments fit their words.
    #[test]
    fn rates_have_the_longest_arguments() {
        let words =
            Arguments::of(1).integers(&[0; 5]).addresses([0; 3]).integers(&[0; 3 + 7]).numbers(&[0.0; 5]);
        assert!(words.integers(&[0; 6]).words().len() < 64);
    }
}
