//! Pictures of the flow for ParaView.

use std::path::Path;

use channel::Fault;
use mesh::vtk::{Series, Values, write_volume};

use crate::geometry::vec3::Vec3;
use crate::gradient;
use crate::monitors::Statistics;
use crate::physics::{Gas, velocity};
use crate::solver::Solver;

/// The series of one stage.
#[derive(Default)]
pub struct Snapshots {
    series: Option<Series>,
    count: usize,
}

impl Snapshots {
    /// Continues the series in `folder`.
    pub fn resume(folder: &Path) -> Self {
        let series = Series::resume(folder.join("flow.pvd"), f64::INFINITY);
        Self { count: series.times(), series: Some(series) }
    }

    /// Adds the solver's state at `time` (s): one file for each rank below
    /// `folder/flow`, listed in `folder/flow.pvd`, with what was gathered in time. Collective.
    ///
    /// # Errors
    /// The files cannot be written; returned on every rank.
    pub fn write<G: Gas<N>, const N: usize>(
        &mut self,
        solver: &Solver<G, N>,
        time: f64,
        folder: &Path,
        statistics: Option<&Statistics>,
    ) -> Result<(), Fault> {
        let comm = solver.comm();
        let name = |rank: usize| format!("flow/flow_{:05}_{rank}.vtu", self.count);
        let mut outcome = self.piece(solver, &folder.join(name(comm.rank())), statistics);
        if comm.is_root() && outcome.is_ok() {
            let files: Vec<String> = (0..comm.size()).map(name).collect();
            let series = self.series.get_or_insert_with(|| Series::resume(folder.join("flow.pvd"), time));
            outcome = series.push(time, &files).map_err(Fault::new);
        }
        self.count += 1;
        if comm.all(outcome.is_ok()) {
            return Ok(());
        }
        Err(outcome.err().unwrap_or_else(|| Fault::new("another rank could not write its snapshot")))
    }

    fn piece<G: Gas<N>, const N: usize>(
        &self,
        solver: &Solver<G, N>,
        file: &Path,
        statistics: Option<&Statistics>,
    ) -> Result<(), Fault> {
        if let Some(parent) = file.parent() {
            std::fs::create_dir_all(parent)
                .map_err(|e| Fault::new(format!("cannot create {}: {e}", parent.display())))?;
        }
        let n = solver.topology.n_owned;
        let now = State::of(solver);
        let gathered = statistics.map(|s| Gathered::of(s, n));
        let mut fields = now.fields();
        fields.extend(gathered.iter().flat_map(Gathered::fields));
        let eddy: Vec<f32> = solver.eddy().iter().take(n).map(|e| *e as f32).collect();
        if !eddy.is_empty() {
            fields.push(("eddy_viscosity_pa_s", Values::F32(&eddy)));
        }
        let nodes: Vec<mesh::Point> = solver.nodes.iter().map(|x| (*x).into()).collect();
        write_volume(file, &nodes, &solver.topology.cell_nodes, &[], &fields).map_err(Fault::new)
    }
}

/// A named field of the picture.
type Named<'a> = (&'static str, Values<'a>);

/// Vectors are drawn in single precision.
fn single(v: Vec3) -> [f32; 3] {
    v.map(|x| x as f32).into()
}

/// Fields of the owned cells at one time level.
struct State {
    pressure: Vec<f32>,
    /// Relative to the ground, and to the falling frame.
    ground: Vec<[f32; 3]>,
    fall: Vec<[f32; 3]>,
    mach: Vec<f32>,
    vorticity: Vec<[f32; 3]>,
    q_criterion: Vec<f32>,
}

impl State {
    fn of<G: Gas<N>, const N: usize>(solver: &Solver<G, N>) -> Self {
        let n = solver.topology.n_owned;
        let (q, g) = (&solver.q[..n], &solver.gradient[..n]);
        let relative = |q: &[f64; N]| velocity(q) - solver.scheme.frame;
        let mach = |q: &[f64; N]| relative(q).norm() / solver.spatial.gas.sound_speed_squared(q).sqrt();
        Self {
            pressure: q.iter().map(|q| q[0] as f32).collect(),
            ground: q.iter().map(|q| single(velocity(q))).collect(),
            fall: q.iter().map(|q| single(relative(q))).collect(),
            mach: q.iter().map(|q| mach(q) as f32).collect(),
            vorticity: g.iter().map(|g| single(gradient::vorticity(g))).collect(),
            q_criterion: g.iter().map(|g| q_criterion(g) as f32).collect(),
        }
    }

    fn fields(&self) -> Vec<Named<'_>> {
        vec![
            ("pressure_pa", Values::F32(&self.pressure)),
            ("velocity_ground_m_s", Values::Vector32(&self.ground)),
            ("velocity_frame_m_s", Values::Vector32(&self.fall)),
            ("mach", Values::F32(&self.mach)),
            ("vorticity_1_s", Values::Vector32(&self.vorticity)),
            ("q_criterion_1_s2", Values::F32(&self.q_criterion)),
        ]
    }
}

/// Second invariant of the velocity gradient, 1/s2: positive where rotation outweighs strain.
fn q_criterion<const N: usize>(g: &gradient::Gradient<N>) -> f64 {
    let mut sum = 0.0;
    for i in 0..3 {
        for j in 0..3 {
            sum -= 0.5 * g[j][i + 1] * g[i][j + 1];
        }
    }
    sum
}

/// Means and fluctuations of the owned cells.
struct Gathered {
    pressure_mean: Vec<f32>,
    pressure_rms: Vec<f32>,
    velocity_mean: Vec<[f32; 3]>,
    velocity_rms: Vec<[f32; 3]>,
}

impl Gathered {
    fn of(statistics: &Statistics, n: usize) -> Self {
        let of = |c: usize| {
            let (mean, rms) = statistics.of(c);
            (mean.map(|x| x as f32), rms.map(|x| x as f32))
        };
        Self {
            pressure_mean: (0..n).map(|c| of(c).0[0]).collect(),
            pressure_rms: (0..n).map(|c| of(c).1[0]).collect(),
            velocity_mean: (0..n).map(|c| vector(of(c).0)).collect(),
            velocity_rms: (0..n).map(|c| vector(of(c).1)).collect(),
        }
    }

    fn fields(&self) -> [Named<'_>; 4] {
        [
            ("pressure_mean_pa", Values::F32(&self.pressure_mean)),
            ("pressure_rms_pa", Values::F32(&self.pressure_rms)),
            ("velocity_frame_mean_m_s", Values::Vector32(&self.velocity_mean)),
            ("velocity_frame_rms_m_s", Values::Vector32(&self.velocity_rms)),
        ]
    }
}

/// The velocity among pressure and velocity.
fn vector([_, u, v, w]: [f32; 4]) -> [f32; 3] {
    [u, v, w]
}
