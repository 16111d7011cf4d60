//! Isotropic turbulence that decays behind a grid, in a periodic box: Comte-Bellot and Corrsin (1971), mesh of 5.08 cm in 10 m/s.
#![allow(dead_code, clippy::needless_range_loop)]

use std::f64::consts::PI;

use flow_solver::physics::{EddyViscosity, Isothermal, Laminar, Turbulent, WallTreatment};
use flow_solver::turbulence::{SpalartAllmaras, ddes};
use flow_solver::{Solver, Step};
use mesh::{BoxShape, FlowGrid, Patch, box_grid_of};
use nalgebra::Complex;

use super::common::{Noise, settings, solver_of};

/// Density, kg/m3, and kinematic viscosity, m2/s.
const RHO: f64 = 1.225;
const NU: f64 = 1.5e-5;

/// Length of the box, m: 11 meshes.
pub const SIZE: f64 = 0.09 * 2.0 * PI;

/// Times at the three stations after the first, s: 42, 98 and 171 meshes behind the grid.
pub const TIMES: [f64; 3] = [0.0, (98.0 - 42.0) * 0.0508 / 10.0, (171.0 - 42.0) * 0.0508 / 10.0];

/// Wave number, 1/cm, and three-dimensional energy spectrum at the three stations, cm3/s2 (table 3 of the paper).
const SPECTRUM: [[f64; 4]; 20] = [
    [0.15, 60.0, 55.0, 49.7],
    [0.20, 129.0, 106.0, 92.0],
    [0.25, 230.0, 196.0, 120.0],
    [0.30, 322.0, 195.0, 125.0],
    [0.40, 435.0, 202.0, 98.0],
    [0.50, 457.0, 168.0, 81.5],
    [0.70, 380.0, 127.0, 60.2],
    [1.00, 270.0, 79.2, 39.4],
    [1.50, 168.0, 47.8, 24.1],
    [2.00, 120.0, 34.6, 16.5],
    [2.50, 89.0, 28.6, 12.5],
    [3.00, 70.3, 23.1, 9.12],
    [4.00, 47.0, 14.3, 5.62],
    [6.00, 24.7, 5.95, 1.69],
    [8.00, 12.6, 2.23, 0.520],
    [10.0, 7.42, 0.900, 0.161],
    [12.5, 3.96, 0.363, 0.0520],
    [15.0, 2.33, 0.162, 0.0141],
    [17.5, 1.34, 0.0660, 0.004],
    [20.0, 0.80, 0.0330, 0.001],
];

/// Measured spectrum at `station`, m3/s2, at the wave number `k`, 1/m: straight in logarithms, also below the first row.
pub fn measured(station: usize, k: f64) -> f64 {
    let k = k / 100.0;
    let above = SPECTRUM.partition_point(|row| row[0] < k).clamp(1, SPECTRUM.len() - 1);
    let [a, b] = [SPECTRUM[above - 1], SPECTRUM[above]];
    let share = (k / a[0]).ln() / (b[0] / a[0]).ln();
    let log = a[1 + station].ln() * (1.0 - share) + b[1 + station].ln() * share;
    1e-6 * log.exp()
}

/// Wave number of a shell, 1/m.
pub fn wave_number(shell: usize) -> f64 {
    2.0 * PI / SIZE * shell as f64
}

/// Measured energy per mass of the shells that `n` cells along an edge resolve, m2/s2.
pub fn resolved(station: usize, n: usize) -> f64 {
    (1..=n / 2).map(|m| measured(station, wave_number(m)) * wave_number(1)).sum()
}

/// Fourier transform over a cube of `n` values along x, then y, then z, by its sums; not normalised.
fn transform(values: &mut [Complex<f64>], n: usize, inverse: bool) {
    let turn = 2.0 * PI / n as f64 * if inverse { 1.0 } else { -1.0 };
    let roots: Vec<_> = (0..n).map(|k| Complex::new(0.0, turn * k as f64).exp()).collect();
    let mut line = vec![Complex::default(); n];
    for stride in [1, n, n * n] {
        for start in (0..n * n * n).filter(|i| i / stride % n == 0) {
            for (k, sum) in line.iter_mut().enumerate() {
                *sum = (0..n).map(|j| values[start + j * stride] * roots[j * k % n]).sum();
            }
            (0..n).for_each(|k| values[start + k * stride] = line[k]);
        }
    }
}

/// Whole wave numbers of an entry of a transform.
fn wave(i: usize, n: usize) -> [f64; 3] {
    [i % n, i / n % n, i / (n * n)].map(|k| if k > n / 2 { k as f64 - n as f64 } else { k as f64 })
}

/// Shell of an entry; those beyond the sphere that the grid resolves have none.
fn shell(i: usize, n: usize) -> Option<usize> {
    let [a, b, c] = wave(i, n);
    let m = (a * a + b * b + c * c).sqrt().round() as usize;
    (1..=n / 2).contains(&m).then_some(m)
}

/// Energy per mass of each shell, m2/s2, of three transforms.
fn energies(u: &[Vec<Complex<f64>>; 3], n: usize) -> Vec<f64> {
    let mut sums = vec![0.0; n / 2 + 1];
    let scale = 0.5 / (n as f64).powi(6);
    for i in 0..n * n * n {
        if let Some(m) = shell(i, n) {
            sums[m] += scale * u.iter().map(|u| u[i].norm_sqr()).sum::<f64>();
        }
    }
    sums
}

/// Where the velocities of a field lie, and which divergence they have none of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    /// All components at the centres of cells, the exact divergence.
    Centres,
    /// Each component on the lower face of its cell, the sum of the fluxes through its faces; a mirror image of itself at the ends along z.
    Faces,
}

/// Entry of the mirror image along z of entry `i`, whose component lies on the faces along z (`on_face`) or not.
pub fn mirrored(i: usize, n: usize, on_face: bool) -> usize {
    let k = i / (n * n);
    let image = if on_face { (n - k) % n } else { n - 1 - k };
    image * n * n + i % (n * n)
}

impl Place {
    /// Direction along which a wave of whole wave numbers `k` has divergence, and by how many turns its component along d is shifted.
    fn of_wave(self, k: [f64; 3], n: usize) -> ([f64; 3], [f64; 3]) {
        let turns = k.map(|k| -0.5 * k / n as f64);
        match self {
            Self::Centres => (k, [0.0; 3]),
            Self::Faces => (k.map(|k| (PI * k / n as f64).sin()), turns),
        }
    }
}

/// Velocities without divergence, of random phases and the measured spectrum of the first station, m/s: cells along x first.
pub fn random_field(n: usize, place: Place) -> Vec<[f64; 3]> {
    let mut noise = Noise(42);
    let mut u: [Vec<Complex<f64>>; 3] = std::array::from_fn(|d| {
        let mut values: Vec<_> = (0..n * n * n).map(|_| Complex::new(noise.next(), 0.0)).collect();
        if place == Place::Faces {
            let sign = if d == 2 { -1.0 } else { 1.0 };
            (0..n * n * n / 2).for_each(|i| values[mirrored(i, n, false)] = values[i] * sign);
        }
        transform(&mut values, n, false);
        values
    });
    for i in 0..n * n * n {
        let k = wave(i, n);
        // The waves that a real field cannot tell from their opposites have no direction.
        let lost = shell(i, n).is_none() || k.iter().any(|k| 2.0 * k.abs() == n as f64);
        let (k, turns) = place.of_wave(k, n);
        let square = k.iter().map(|k| k * k).sum::<f64>().max(f64::MIN_POSITIVE);
        let along: Complex<f64> = (0..3).map(|d| u[d][i] * (k[d] / square)).sum();
        for d in 0..3 {
            let shift = Complex::new(0.0, 2.0 * PI * turns[d]).exp();
            u[d][i] = if lost { Complex::default() } else { (u[d][i] - along * k[d]) * shift };
        }
    }
    let found = energies(&u, n);
    let wanted = |m: usize| measured(0, wave_number(m)) * wave_number(1);
    for i in 0..n * n * n {
        let factor = shell(i, n).map_or(0.0, |m| (wanted(m) / found[m]).sqrt());
        u.iter_mut().for_each(|u| u[i] *= factor);
    }
    let scale = 1.0 / (n as f64).powi(3);
    u.iter_mut().for_each(|u| transform(u, n, true));
    (0..n * n * n).map(|i| [0, 1, 2].map(|d| scale * u[d][i].re)).collect()
}

/// Model of the small eddies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Model {
    /// None.
    Laminar,
    /// Smagorinsky.
    Smagorinsky,
    /// WALE.
    Wale,
    /// Detached eddies, far from walls.
    Ddes,
}

impl Model {
    /// All of them.
    pub const ALL: [Model; 4] = [Model::Laminar, Model::Smagorinsky, Model::Wale, Model::Ddes];

    fn solver(self, grid: &FlowGrid, settings: flow_solver::Settings) -> Solver<Isothermal, 4> {
        let (gas, viscosity) = (Isothermal::new(settings.air), NU * RHO);
        let eddies = match self {
            Model::Laminar => return solver_of(grid, gas, Laminar { viscosity }, settings),
            Model::Smagorinsky => EddyViscosity::Smagorinsky,
            Model::Wale => EddyViscosity::Wale,
            Model::Ddes => EddyViscosity::TransportInput,
        };
        solver_of(grid, gas, Turbulent { viscosity, eddies, wall: WallTreatment::Resolved }, settings)
    }
}

/// The box at the first station, on `n` cells along each edge.
pub fn at_start(n: usize, model: Model, upwind: f64) -> Solver<Isothermal, 4> {
    let grid: FlowGrid = box_grid_of(BoxShape::Hexahedra, [n; 3], [0.0; 3], [SIZE; 3], [Patch::Periodic; 6]);
    let mut settings = settings([0.0; 3], 1e-2);
    settings.reference_speed = 0.02;
    settings.moving = false;
    let mut s = model.solver(&grid, settings);
    s.spatial.upwind_share = upwind;
    for (q, u) in s.q.iter_mut().zip(random_field(n, Place::Centres)) {
        *q = [0.0, u[0], u[1], u[2]];
    }
    s.halo.exchange(s.q.as_flattened_mut(), 4);
    for level in &mut s.previous {
        level.q.copy_from_slice(&s.q);
    }
    if model == Model::Ddes {
        let mut model = SpalartAllmaras::new(&s.topology, NU * RHO, RHO, ddes);
        // Eddies of the size of cells have grown by then: from the dissipation of the spectrum, (0.17 h)^2 |S|.
        let strain =
            (1..=n / 2).map(|m| 2.0 * wave_number(m).powi(2) * measured(0, wave_number(m)) * wave_number(1));
        let start = (0.17 * SIZE / n as f64).powi(2) * strain.sum::<f64>().sqrt() + 3.0 * NU;
        model.value.fill([start]);
        model.previous.iter_mut().for_each(|p| p.fill([start]));
        s.set_turbulence(model);
    }
    s
}

/// Spectrum of the resolved velocities by shells, m3/s2.
pub fn spectrum(s: &Solver<Isothermal, 4>, n: usize) -> Vec<f64> {
    spectrum_of(n, |d, i| s.q[i][1 + d])
}

/// Spectrum by shells, m3/s2, of the velocities `u` of each component and cell, along x first.
pub fn spectrum_of(n: usize, u: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let u: [Vec<Complex<f64>>; 3] = std::array::from_fn(|d| {
        let mut values: Vec<_> = (0..n * n * n).map(|i| Complex::new(u(d, i), 0.0)).collect();
        transform(&mut values, n, false);
        values
    });
    energies(&u, n).into_iter().map(|e| e / wave_number(1)).collect()
}

/// Resolved energy per mass of all shells, m2/s2.
pub fn energy(spectrum: &[f64]) -> f64 {
    spectrum.iter().sum::<f64>() * wave_number(1)
}

/// Advances from the station before to `station` in steps that 1 m/s crosses `courant` cells in; returns steps and iterations.
pub fn to_station(s: &mut Solver<Isothermal, 4>, n: usize, station: usize, courant: f64) -> (usize, usize) {
    let span = TIMES[station] - TIMES[station - 1];
    let steps = (span * n as f64 / (courant * SIZE)).ceil() as usize;
    let dt = span / steps as f64;
    let step = Step { dt, frame: flow_solver::geometry::vec3::Vec3::zeros(), repeat: false, moved: false };
    let mut iterations = 0;
    for _ in 0..steps {
        iterations += s.advance(&step).expect("a step that converges").iterations;
        s.accept(dt, false);
    }
    (steps, iterations)
}
