//! The eddy viscosity on a device.

use super::Address;
use super::arguments::Arguments;
use super::queue::{Buffer, Queue};
use super::steps::Reduction;
use super::tables::{Packed, Tables};
use crate::eddy_viscosity::{EddyViscosity, crossed_cells};
use crate::friction::Friction;
use crate::grid::Grid;

/// The eddy viscosity of a flow on a device.
#[derive(Debug)]
pub(crate) struct DeviceEddies {
    /// The model as the kernels number it, and its constant.
    model: (usize, f64),
    viscosity: Buffer,
    packed: Buffer,
    /// Distances, widths and filters of the axes.
    lengths: [[usize; 3]; 3],
    strides: [usize; 3],
    largest: Reduction<1>,
}

impl DeviceEddies {
    pub(crate) fn new(queue: &Queue, grid: &Grid, eddies: &EddyViscosity) -> Self {
        let mut packed = Packed::default();
        let of_axis = [0, 1, 2].map(|d| {
            let lengths = eddies.lengths(d);
            [&lengths.distance, &lengths.width, &lengths.filter].map(|v| packed.push(v.iter().copied()))
        });
        Self {
            model: eddies.model().numbered(),
            viscosity: queue.buffer(grid.array_len()),
            packed: queue.numbers(packed.values()),
            lengths: [0, 1, 2].map(|kind| of_axis.map(|axis| axis[kind])),
            strides: grid.strides,
            largest: Reduction::new(queue),
        }
    }

    fn lengths(&self) -> [Address; 9] {
        let mut all = [0; 9];
        all.iter_mut().zip(self.lengths.iter().flatten()).for_each(|(a, at)| *a = self.packed.at(*at));
        all
    }

    /// Finds the viscosity of the velocity `u` around a surface with `friction`.
    pub(crate) fn update(
        &self,
        queue: &Queue,
        tables: &Tables,
        u: [Address; 3],
        friction: Option<&Friction>,
    ) {
        let [nx, ny, nz] = [0, 1, 2].map(|d| tables.grid[d]);
        let arguments = Arguments::of(nx * ny * nz).integers(&tables.grid).addresses(u);
        let arguments = self.lengths().into_iter().fold(arguments, Arguments::address);
        let arguments = arguments.address(self.viscosity.at(0)).integer(self.model.0).number(self.model.1);
        queue.launch("viscosities", &arguments);
        if let Some(friction) = friction {
            let crossed: Vec<u32> = crossed_cells(self.strides, friction).map(|at| at as u32).collect();
            let positions = queue.indices(&crossed);
            let arguments =
                Arguments::of(crossed.len()).address(positions.at(0)).address(self.viscosity.at(0));
            queue.launch("clear_crossed", &arguments);
        }
        for (d, threads) in [ny * nz, (nx + 2) * nz, (nx + 2) * (ny + 2)].into_iter().enumerate() {
            let arguments = Arguments::of(threads)
                .integers(&tables.grid)
                .address(self.viscosity.at(0))
                .integers(&[d, tables.periodic()[d]]);
            queue.launch("viscosity_ghosts", &arguments);
        }
    }

    /// Adds the divergence of the stress to `rates`.
    pub(crate) fn add_rates(&self, queue: &Queue, tables: &Tables, u: [Address; 3], rates: [Address; 3]) {
        for (c, rates) in rates.into_iter().enumerate() {
            let count = tables.grid[..3].iter().product();
            let arguments = Arguments::of(count).integers(&tables.grid).addresses(u);
            let arguments = self.lengths().into_iter().fold(arguments, Arguments::address);
            let arguments = arguments.address(self.viscosity.at(0)).address(rates).integer(c);
            queue.launch("stresses", &arguments);
        }
    }

    /// Largest $`4 \nu_t \sum_d h_d^{-2}`$ of the cells, 1/s.
    pub(crate) fn largest_rate(&self, queue: &Queue, tables: &Tables) -> f64 {
        let arguments = Reduction::<1>::arguments().integers(&tables.grid);
        let arguments = self.lengths().into_iter().fold(arguments, Arguments::address);
        let arguments = arguments.address(self.viscosity.at(0));
        let arguments = self.largest.shares().into_iter().fold(arguments, Arguments::address);
        queue.launch("largest_viscosity", &arguments);
        let [rate] = self.largest.values(queue);
        rate
    }

    /// Gives the viscosity to the host.
    pub(crate) fn download(&self, queue: &Queue, values: &mut [f64]) {
        queue.download(self.viscosity.at(0), values);
    }
}
