//! Pictures for ParaView: the canopy and the lines as time series.

use std::path::Path;

use mesh::geometry::Vec3;
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
    /// Continues the series in `folder`.
    pub fn resume(folder: &Path) -> Self {
        let series = ["canopy.pvd", "lines.pvd"].map(|name| Series::resume(folder.join(name), f64::INFINITY));
        Self { count: series[0].times(), series: Some(series) }
    }

    /// Adds `state` under `load` at `time` (s) to `canopy.pvd` and `lines.pvd` in
    /// `folder`. Collective; rank 0 writes.
    ///
    /// Canopy: displacement and velocity of nodes; of triangles the principal
    /// second Piola-Kirchhoff stresses, the direction of the larger one in the present shape, Green strains, the state (0
    /// slack, 1 wrinkled, 2 taut), and the pressure jump and the shear of the air; directions and shear in single precision. Lines: the tension of each cable, the line that it
    /// is a part of and what it models ([`mesh::CableKind::number`]).
    pub fn add(
        &mut self,
        system: &System,
        mesh: &StructureMesh,
        state: &State,
        load: FaceLoad<'_>,
        time: f64,
        folder: &Path,
    ) -> Result<(), MeshError> {
        let Some(f) = Fields::gather(system, mesh, state) else { return Ok(()) };
        let [canopy, lines] = self
            .series
            .get_or_insert_with(|| ["canopy.pvd", "lines.pvd"].map(|name| Series::new(folder.join(name))));
        let name = format!("canopy_{:05}.vtu", self.count);
        f.write_canopy(&folder.join(&name), mesh, load)?;
        canopy.push(time, &[&name])?;
        if !mesh.cables.is_empty() {
            let name = format!("lines_{:05}.vtu", self.count);
            f.write_lines(&folder.join(&name), mesh)?;
            lines.push(time, &[&name])?;
        }
        self.count += 1;
        Ok(())
    }
}

/// What a picture shows, of the whole mesh.
struct Fields {
    /// Displacements (m) and velocities (m/s), `[nodes][3]`.
    u: Vec<f64>,
    v: Vec<f64>,
    /// Principal stresses (Pa) and state, `[triangles][3]`.
    fabric: Vec<f64>,
    /// Principal strains, `[triangles][2]`.
    strain: Vec<f64>,
    /// Directions of the larger principal stress, `[triangles][3]`.
    direction: Vec<f64>,
    /// Tensions of cables, N.
    tension: Vec<f64>,
}

impl Fields {
    /// Of `state`, on rank 0; `None` on the others. Collective.
    fn gather(system: &System, mesh: &StructureMesh, state: &State) -> Option<Self> {
        let model = &system.model;
        let (comm, n) = (&model.comm, mesh.coords.len());
        let owned = |v: &[f64]| gather(comm, model.numbering.owned(), &v[..3 * model.n_owned()], 3, n);
        let (u, v) = (owned(&state.u), owned(&state.v));
        let x: Vec<f64> = model.reference.iter().zip(&state.u).map(|(x, u)| x + u).collect();

        let own = &model.triangles[..model.n_own_triangles];
        let global: Vec<u64> = own.iter().map(|t| u64::from(t.global)).collect();
        let states = system.by_triangle(([0.0; 2], Regime::Slack), |l| l.stresses(&x));
        let row = |([s1, s2], regime): &([f64; 2], Regime)| [*s1, *s2, f64::from(number(*regime))];
        let rows: Vec<f64> = states[..own.len()].iter().flat_map(row).collect();
        let fabric = gather(comm, &global, &rows, 3, mesh.triangles.len());
        let strains = system.by_triangle([0.0; 2], |l| l.strains(&x));
        let rows = strains[..own.len()].as_flattened();
        let strain = gather(comm, &global, rows, 2, mesh.triangles.len());
        let directions = system.by_triangle(Vec3::zeros(), |l| l.stress_directions(&x));
        let rows: Vec<f64> = directions[..own.len()].iter().copied().flat_map(<[f64; 3]>::from).collect();
        let direction = gather(comm, &global, &rows, 3, mesh.triangles.len());
        let own = &model.cables[..model.n_own_cables];
        let global: Vec<u64> = own.iter().map(|c| u64::from(c.global)).collect();
        let rows = &system.tensions(&x)[..own.len()];
        let tension = gather(comm, &global, rows, 1, mesh.cables.len());
        comm.is_root().then_some(Self { u, v, fabric, strain, direction, tension })
    }

    /// Positions of all nodes, m.
    fn points(&self, mesh: &StructureMesh) -> Vec<mesh::Point> {
        let u = self.u.as_chunks::<3>().0;
        mesh.coords.iter().zip(u).map(|(x, u)| std::array::from_fn(|c| x[c] + u[c])).collect()
    }

    fn write_canopy(&self, path: &Path, mesh: &StructureMesh, load: FaceLoad<'_>) -> Result<(), MeshError> {
        let m = mesh.n_canopy;
        let (u, v) = (self.u.as_chunks::<3>().0, self.v.as_chunks::<3>().0);
        let [first, second, regime] = [0, 1, 2].map(|c| column(&self.fabric, 3, c));
        let strains = [0, 1].map(|c| column(&self.strain, 2, c));
        let regime: Vec<u32> = regime.iter().map(|r| *r as u32).collect();
        let pressure: Vec<f64> = mesh.triangle_face.iter().map(|&f| load.pressure[f as usize]).collect();
        let direction: Vec<[f32; 3]> = self.direction.as_chunks::<3>().0.iter().map(single).collect();
        // No traction is that of an inviscid flow, or of a stage without one.
        let traction = load.traction.as_chunks::<3>().0;
        let shear = |&face: &u32| traction.get(face as usize).map_or([0.0; 3], single);
        let shear: Vec<[f32; 3]> = mesh.triangle_face.iter().map(shear).collect();
        write_surface(
            path,
            &self.points(mesh)[..m],
            &mesh.triangles,
            &[("displacement_m", Values::Vector(&u[..m])), ("velocity_m_s", Values::Vector(&v[..m]))],
            &[
                ("stress_1_pa", Values::F64(&first)),
                ("stress_2_pa", Values::F64(&second)),
                ("stress_direction", Values::Vector32(&direction)),
                ("strain_1", Values::F64(&strains[0])),
                ("strain_2", Values::F64(&strains[1])),
                ("wrinkling_state", Values::U32(&regime)),
                ("pressure_jump_pa", Values::F64(&pressure)),
                ("shear_pa", Values::Vector32(&shear)),
            ],
        )
    }

    fn write_lines(&self, path: &Path, mesh: &StructureMesh) -> Result<(), MeshError> {
        let ends: Vec<[u32; 2]> = mesh.cables.iter().map(|c| c.nodes).collect();
        let line: Vec<u32> = mesh.cables.iter().map(|c| c.line).collect();
        let kind: Vec<u32> = mesh.cables.iter().map(|c| c.kind.number()).collect();
        let fields = [
            ("tension_n", Values::F64(&self.tension)),
            ("line", Values::U32(&line)),
            ("kind", Values::U32(&kind)),
        ];
        write_surface(path, &self.points(mesh), &ends, &[], &fields)
    }
}

fn single(v: &[f64; 3]) -> [f32; 3] {
    v.map(|x| x as f32)
}

/// Column `c` of rows of `width` numbers.
fn column(rows: &[f64], width: usize, c: usize) -> Vec<f64> {
    rows.iter().skip(c).step_by(width).copied().collect()
}

fn number(regime: Regime) -> u8 {
    regime as u8
}
