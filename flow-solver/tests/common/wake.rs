//! The wake of a shape of zero thickness at Reynolds number 1e5: forces and their statistics.
#![allow(dead_code)]

use flow_solver::physics::{
    EddyViscosity, Inviscid, Isothermal, Laminar, Turbulent, Viscosity, WallTreatment,
};
use flow_solver::turbulence::{SpalartAllmaras, ddes};
use flow_solver::{Loads, Solver};

use super::common::{Noise, at_rest, isothermal, settings};
use super::shapes::Shape;

const RHO: f64 = 1.225;
const SPEED: f64 = 5.0;
/// Dynamic viscosity at Reynolds number 1e5 by the diameter of 1 m, Pa s.
const VISCOSITY: f64 = RHO * SPEED / 1e5;

/// How the flow treats viscosity and eddies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// No viscosity, slip walls.
    Inviscid,
    /// Molecular viscosity alone.
    Laminar,
    /// WALE.
    Wale,
    /// Delayed detached eddies.
    Ddes,
}

impl Model {
    /// By its name on the command line.
    pub fn named(name: &str) -> Option<Self> {
        let of = [
            ("inviscid", Self::Inviscid),
            ("laminar", Self::Laminar),
            ("wale", Self::Wale),
            ("ddes", Self::Ddes),
        ];
        of.into_iter().find(|(n, _)| *n == name).map(|(_, model)| model)
    }

    /// Smallest upwind share of the convective flux by default in a scene.
    pub fn upwind_share(self) -> f64 {
        if self == Self::Inviscid { 1.0 } else { 0.0 }
    }
}

/// One computation.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    /// The body.
    pub shape: Shape,
    /// Its flow model.
    pub model: Model,
    /// Cells per diameter.
    pub across: usize,
    /// End, U/D.
    pub end: f64,
    /// Seed of the push at the start.
    pub seed: u64,
    /// Smallest upwind share of the convective flux.
    pub upwind: f64,
    /// Time step times cells across, U/D.
    pub courant: f64,
    /// Half width of the box, m.
    pub half: f64,
}

/// What a run gives.
pub struct Wake {
    /// Time (U/D), drag coefficient and the two coefficients of the side force after each step. A flat shape has no side force but
    /// friction: instead of it, the coefficients of the moment about its centre (reference length 1 m).
    pub rows: Vec<[f64; 4]>,
    /// Cells.
    pub cells: usize,
    /// Iterations per step.
    pub iterations: f64,
}

impl Case {
    /// Runs to the end; each 5 U/D a progress line to `progress`.
    pub fn run(&self, progress: impl FnMut([f64; 4])) -> Wake {
        let viscosity = VISCOSITY;
        let wall = WallTreatment::Automatic;
        match self.model {
            Model::Inviscid => self.advance(self.solver(Inviscid), progress),
            Model::Laminar => self.advance(self.solver(Laminar { viscosity }), progress),
            Model::Wale => {
                let eddies = EddyViscosity::Wale;
                self.advance(self.solver(Turbulent { viscosity, eddies, wall }), progress)
            }
            Model::Ddes => {
                let eddies = EddyViscosity::TransportInput;
                let mut s = self.solver(Turbulent { viscosity, eddies, wall });
                let model = SpalartAllmaras::new(&s.topology, viscosity, RHO, ddes);
                s.set_turbulence(model);
                self.advance(s, progress)
            }
        }
    }

    fn solver<V: Viscosity>(&self, viscosity: V) -> Solver<Isothermal, 4> {
        let mut set = settings([0.0, 0.0, SPEED], 1e-2);
        set.moving = false;
        let mut s = isothermal(&self.shape.grid_in(self.across, self.half), viscosity, set);
        s.spatial.upwind_share = self.upwind;
        s
    }

    fn advance(&self, mut s: Solver<Isothermal, 4>, mut progress: impl FnMut([f64; 4])) -> Wake {
        push(&mut s, self.seed);
        let mut loads = Loads::new(&s);
        let scale = 0.5 * RHO * SPEED * SPEED * self.shape.area();
        let dt = self.courant / self.across as f64;
        let steps = (self.end / dt).ceil() as usize;
        let (mut rows, mut iterations) = (Vec::with_capacity(steps), 0);
        for k in 1..=steps {
            iterations += s.advance(&at_rest(dt / SPEED)).expect("a step that converges").iterations;
            let total = loads.compute(&s);
            let force = total.force / scale;
            let side = if self.shape.is_flat() { total.moment / scale } else { force };
            s.accept(dt / SPEED, false);
            let row = [k as f64 * dt, force.z, side.x, side.y];
            rows.push(row);
            if (row[0] / 5.0).floor() > ((row[0] - dt) / 5.0).floor() {
                progress(row);
            }
        }
        Wake { rows, cells: s.topology.n_owned, iterations: iterations as f64 / steps as f64 }
    }
}

/// Pushes the air behind the shape to one side, with some noise: the wake need not leave its symmetric state by round-off.
fn push(s: &mut Solver<Isothermal, 4>, seed: u64) {
    let mut noise = Noise(seed.wrapping_mul(2_654_435_761).wrapping_add(12_345));
    for i in 0..s.topology.n_owned {
        let x = s.metrics.centre[i];
        let near = (-(x[0] * x[0] + x[1] * x[1] + (x[2] - 1.0).powi(2))).exp();
        let push = [0.3, 0.2].map(|u| SPEED * near * (u + 0.1 * noise.next()));
        for level in &mut s.previous {
            level.q[i][1] += push[0];
            level.q[i][2] += push[1];
        }
    }
}

/// Statistics of the second half of a run.
#[derive(Clone, Debug)]
pub struct Statistics {
    /// Mean drag coefficient.
    pub drag: f64,
    /// Half width of its 95 % interval by batch means.
    pub interval: f64,
    /// Number of batches.
    pub batches: usize,
    /// Correlation of neighbouring batch means: near zero where batches are long enough.
    pub correlation: f64,
    /// Mean drag coefficients of its four quarters.
    pub quarters: Vec<f64>,
    /// Root mean square of both components of the side force (flat shapes: moment) about their means, as one coefficient.
    pub side: f64,
    /// Strouhal number: peak of the spectrum of both components.
    pub strouhal: f64,
    /// Spacing of frequencies that the length of the record resolves, U/D.
    pub resolution: f64,
}

/// Two-sided 95 % points of Student's distribution for 3, 4, ... 19 degrees of freedom.
const STUDENT: [f64; 17] = [
    3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131, 2.120, 2.110,
    2.101, 2.093,
];

/// Of the second half of `rows`, in batches of 10 U/D or longer, 4 to 20 of them.
pub fn statistics(rows: &[[f64; 4]]) -> Statistics {
    let end = rows[rows.len() - 1][0];
    let late: Vec<[f64; 4]> = rows.iter().filter(|r| r[0] > 0.5 * end).copied().collect();
    let mean = |rows: &[[f64; 4]], c: usize| rows.iter().map(|r| r[c]).sum::<f64>() / rows.len() as f64;
    let parts = |n: usize| -> Vec<f64> {
        (0..n).map(|k| mean(&late[k * late.len() / n..(k + 1) * late.len() / n], 1)).collect()
    };
    let batches = ((0.05 * end).round() as usize).clamp(4, 20);
    let batch = parts(batches);
    let centre = batch.iter().sum::<f64>() / batches as f64;
    let square = batch.iter().map(|x| (x - centre).powi(2)).sum::<f64>();
    let lagged = batch.windows(2).map(|w| (w[0] - centre) * (w[1] - centre)).sum::<f64>();
    let deviation = (square / (batches - 1) as f64).sqrt();
    let side = |c: usize| {
        let middle = mean(&late, c);
        late.iter().map(|r| r[c] - middle).collect::<Vec<f64>>()
    };
    let sides = [side(2), side(3)];
    let power = sides.iter().flatten().map(|x| x * x).sum::<f64>() / late.len() as f64;
    Statistics {
        drag: mean(&late, 1),
        interval: STUDENT[batches - 4] * deviation / (batches as f64).sqrt(),
        batches,
        correlation: lagged / square,
        quarters: parts(4),
        side: power.sqrt(),
        strouhal: peak(&sides, 0.5 * end),
        resolution: 2.0 / end,
    }
}

/// Frequency (U/D) between 0.05 and 0.5 of the largest value of the spectrum, summed over both components, with Hann's window.
fn peak(sides: &[Vec<f64>; 2], length: f64) -> f64 {
    let n = sides[0].len() as f64;
    let power = |f: f64| {
        let of = |x: &Vec<f64>| {
            let (mut re, mut im) = (0.0, 0.0);
            for (k, x) in x.iter().enumerate() {
                let s = k as f64 / n;
                let (sin, cos) = (std::f64::consts::TAU * f * length * s).sin_cos();
                let w = 1.0 - (std::f64::consts::TAU * s).cos();
                re += w * x * cos;
                im += w * x * sin;
            }
            re * re + im * im
        };
        sides.iter().map(of).sum::<f64>()
    };
    let at = |k: usize| 0.05 + 0.25 * k as f64 / length;
    let count = (0.45 * length / 0.25) as usize;
    (0..=count).map(|k| (at(k), power(at(k)))).fold((0.0, -1.0), |a, b| if b.1 > a.1 { b } else { a }).0
}
