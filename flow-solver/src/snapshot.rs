//! Pictures of the flow for ParaView.

use std::path::Path;

use channel::Fault;
use mesh::vtk::{Series, Values, write_volume};

use crate::geometry::vec3::{Vec3, norm, sub};
use crate::monitors::Statistics;
use crate::physics::{Gas, Viscosity};
use crate::solver::Solver;

/// The series of one stage.
#[derive(Default)]
pub struct Snapshots {
    series: Option<Series>,
    count: usize,
}

impl Snapshots {
    /// Goes on with the series that lies in `folder`.
    pub fn resume(folder: &Path) -> Self {
        let series = Series::resume(folder.join("flow.pvd"), f64::INFINITY);
        Self { count: series.times(), series: Some(series) }
    }

    /// Adds the solver's state at `time` (s): one file for each rank below
    /// `folder/flow`, listed in `folder/flow.pvd`, with what was gathered in time. Collective.
    ///
    /// # Errors
    /// Trouble with the files, on every rank.
    pub fn write<G: Gas<N>, V: Viscosity, const N: usize>(
        &mut self,
        solver: &Solver<G, V, N>,
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

    fn piece<G: Gas<N>, V: Viscosity, const N: usize>(
        &self,
        solver: &Solver<G, V, N>,
        file: &Path,
        statistics: Option<&Statistics>,
    ) -> Result<(), Fault> {
        if let Some(parent) = file.parent() {
            std::fs::create_dir_all(parent)
                .map_err(|e| Fault::new(format!("cannot create {}: {e}", parent.display())))?;
        }
        let n = solver.topology.n_owned;
        let q = &solver.q[..n];
        let single = |v: Vec3| v.map(|x| x as f32);
        let velocity = |q: &[f64; N]| [q[1], q[2], q[3]];
        let relative = |q: &[f64; N]| sub(velocity(q), solver.scheme.frame);
        let pressure: Vec<f32> = q.iter().map(|q| q[0] as f32).collect();
        let ground: Vec<[f32; 3]> = q.iter().map(|q| single(velocity(q))).collect();
        let fall: Vec<[f32; 3]> = q.iter().map(|q| single(relative(q))).collect();
        let mach: Vec<f32> = q
            .iter()
            .map(|q| (norm(relative(q)) / solver.spatial.gas.sound_speed_squared(q).sqrt()) as f32)
            .collect();
        let mut vorticity = Vec::with_capacity(n);
        let mut q_criterion = Vec::with_capacity(n);
        for g in &solver.gradient[..n] {
            let d = |i: usize, j: usize| g[j][i + 1];
            vorticity.push(single([d(2, 1) - d(1, 2), d(0, 2) - d(2, 0), d(1, 0) - d(0, 1)]));
            let mut sum = 0.0;
            for i in 0..3 {
                for j in 0..3 {
                    sum -= 0.5 * d(i, j) * d(j, i);
                }
            }
            q_criterion.push(sum as f32);
        }
        let mut fields = vec![
            ("pressure_pa", Values::F32(&pressure)),
            ("velocity_ground_m_s", Values::Vector32(&ground)),
            ("velocity_frame_m_s", Values::Vector32(&fall)),
            ("mach", Values::F32(&mach)),
            ("vorticity_1_s", Values::Vector32(&vorticity)),
            ("q_criterion_1_s2", Values::F32(&q_criterion)),
        ];
        let gathered = statistics.map(|s| {
            let rows = (0..n).map(|c| s.of(c));
            rows.map(|(mean, rms)| (mean.map(|x| x as f32), rms.map(|x| x as f32))).collect::<Vec<_>>()
        });
        let scalar = |rms: bool| {
            let rows = gathered.iter().flatten();
            rows.map(|(m, r)| if rms { r[0] } else { m[0] }).collect::<Vec<f32>>()
        };
        let vector = |rms: bool| {
            let rows = gathered.iter().flatten().map(|(m, r)| if rms { r } else { m });
            rows.map(|v| [v[1], v[2], v[3]]).collect::<Vec<_>>()
        };
        let (p_mean, p_rms, u_mean, u_rms) = (scalar(false), scalar(true), vector(false), vector(true));
        if gathered.is_some() {
            fields.extend([
                ("pressure_mean_pa", Values::F32(&p_mean)),
                ("pressure_rms_pa", Values::F32(&p_rms)),
                ("velocity_frame_mean_m_s", Values::Vector32(&u_mean)),
                ("velocity_frame_rms_m_s", Values::Vector32(&u_rms)),
            ]);
        }
        let eddy: Vec<f32> = solver.eddy()[..n.min(solver.eddy().len())].iter().map(|e| *e as f32).collect();
        if !eddy.is_empty() {
            fields.push(("eddy_viscosity_pa_s", Values::F32(&eddy)));
        }
        write_volume(file, &solver.nodes, &solver.topology.cell_nodes, &[], &fields).map_err(Fault::new)
    }
}
