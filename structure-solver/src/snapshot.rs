//! Pictures for ParaView: the canopy and the lines as time series.

use std::path::Path;

use mesh::vtk::{Series, Values, write_surface};
use mesh::{MeshError, StructureMesh};

use crate::loops::FaceLoad;
use crate::materials::Regime;
use crate::newton::State;
use crate::state_file::gather;
use crate::system::System;

/// The series of a stage.
#[derive(Default)]
pub struct Pictures {
    series: Option<[Series; 2]>,
    count: usize,
}

impl Pictures {
    /// Goes on with the series that lie in `folder`.
    pub fn resume(folder: &Path) -> Self {
        let series = ["canopy.pvd", "lines.pvd"].map(|name| Series::resume(folder.join(name), f64::INFINITY));
        Self { count: series[0].times(), series: Some(series) }
    }

    /// Adds `state` under `load` at `time` (s) to `canopy.pvd` and `lines.pvd` in
    /// `folder`. Collective; rank 0 writes.
    ///
    /// Canopy: displacement and velocity of nodes; of triangles the principal
    /// second Piola-Kirchhoff stresses and Green strains, the state (0 slack, 1 wrinkled,
    /// 2 taut) and the pressure jump. Lines: the tension of each cable, the line that it
    /// is a part of and what it models (0 suspension line, 1 riser, 2 reinforcement).
    pub fn add(
        &mut self,
        system: &System,
        mesh: &StructureMesh,
        state: &State,
        load: FaceLoad<'_>,
        time: f64,
        folder: &Path,
    ) -> Result<(), MeshError> {
        let model = &system.model;
        let (comm, n) = (&model.comm, mesh.coords.len());
        let owned = |v: &[f64]| gather(comm, model.numbering.owned(), &v[..3 * model.n_owned()], 3, n);
        let (u, v) = (owned(&state.u), owned(&state.v));
        let x: Vec<f64> = model.reference.iter().zip(&state.u).map(|(x, u)| x + u).collect();

        let own = &model.triangles[..model.n_own_triangles];
        let global: Vec<u64> = own.iter().map(|t| u64::from(t.global)).collect();
        let rows: Vec<f64> = system
            .loops()
            .iter()
            .flat_map(|l| l.stresses(&x))
            .take(own.len())
            .flat_map(|([s1, s2], regime)| [s1, s2, f64::from(number(regime))])
            .collect();
        let fabric = gather(comm, &global, &rows, 3, mesh.triangles.len());
        let rows: Vec<f64> =
            system.loops().iter().flat_map(|l| l.strains(&x)).take(own.len()).flatten().collect();
        let strain = gather(comm, &global, &rows, 2, mesh.triangles.len());
        let own = &model.cables[..model.n_own_cables];
        let global: Vec<u64> = own.iter().map(|c| u64::from(c.global)).collect();
        let rows: Vec<f64> = system.loops().iter().flat_map(|l| l.tensions(&x)).take(own.len()).collect();
        let tension = gather(comm, &global, &rows, 1, mesh.cables.len());
        if !comm.is_root() {
            return Ok(());
        }

        let (u, v) = (u.as_chunks::<3>().0, v.as_chunks::<3>().0);
        let points: Vec<_> = mesh.coords.iter().zip(u).map(|(x, u)| crate::vec3::add(*x, *u)).collect();
        let column = |c: usize| fabric.chunks_exact(3).map(|row| row[c]).collect::<Vec<f64>>();
        let (first, second) = (column(0), column(1));
        let strains = [0, 1].map(|c| strain.iter().skip(c).step_by(2).copied().collect::<Vec<f64>>());
        let regime: Vec<u32> = column(2).iter().map(|r| *r as u32).collect();
        let pressure: Vec<f64> = mesh.triangle_face.iter().map(|&f| load.pressure[f as usize]).collect();
        let m = mesh.n_canopy;
        let [canopy, lines] = self
            .series
            .get_or_insert_with(|| ["canopy.pvd", "lines.pvd"].map(|name| Series::new(folder.join(name))));
        let name = format!("canopy_{:05}.vtu", self.count);
        write_surface(
            &folder.join(&name),
            &points[..m],
            &mesh.triangles,
            &[("displacement_m", Values::Vector(&u[..m])), ("velocity_m_s", Values::Vector(&v[..m]))],
            &[
                ("stress_1_pa", Values::F64(&first)),
                ("stress_2_pa", Values::F64(&second)),
                ("strain_1", Values::F64(&strains[0])),
                ("strain_2", Values::F64(&strains[1])),
                ("wrinkling_state", Values::U32(&regime)),
                ("pressure_jump_pa", Values::F64(&pressure)),
            ],
        )?;
        canopy.push(time, &[&name])?;
        if !mesh.cables.is_empty() {
            let name = format!("lines_{:05}.vtu", self.count);
            let ends: Vec<[u32; 2]> = mesh.cables.iter().map(|c| c.nodes).collect();
            let line: Vec<u32> = mesh.cables.iter().map(|c| c.line).collect();
            let kind: Vec<u32> = mesh.cables.iter().map(|c| c.kind as u32).collect();
            let fields = [
                ("tension_n", Values::F64(&tension)),
                ("line", Values::U32(&line)),
                ("kind", Values::U32(&kind)),
            ];
            write_surface(&folder.join(&name), &points, &ends, &[], &fields)?;
            lines.push(time, &[&name])?;
        }
        self.count += 1;
        Ok(())
    }
}

fn number(regime: Regime) -> u8 {
    regime as u8
}
