//! A mesh-mover on a plate in a box, for tests.
#![allow(dead_code, missing_docs)]

use case::MeshMotion;
use channel::{Fault, Input, Participant, Stats, Window};
use comm::Comm;
use mesh::{FlowGrid, StructureMesh};
use mesh_mover::elastic::{Elastic, Solid};
use mesh_mover::example_grid::{plate_in_box, plate_structure};
use mesh_mover::motion::Limits;
use mesh_mover::participant::{MeshMover, Setup, owners};
use mesh_mover::state::State;

pub struct MoverFixture {
    pub grid: FlowGrid,
    pub structure: StructureMesh,
    pub mover: MeshMover,
    /// Rows `[x, y, z, vx, vy, vz]` of the owned nodes.
    pub output: Vec<f64>,
}

impl MoverFixture {
    pub fn new(comm: &Comm, settings: &MeshMotion, state: Option<State>) -> Self {
        let grid = plate_in_box(8, 0.1, 0.8, true);
        let structure = plate_structure(&grid);
        let owner = owners(&grid, comm.size()).unwrap();
        let mover = Box::new(Elastic::new(Solid::from(settings)));
        let limits = Limits::from(settings);
        let setup = Setup {
            grid: &grid,
            structure: &structure,
            owner: &owner,
            mover,
            limits,
            state,
            outer: settings.outer_boundary,
            regridder: None,
            bodies: Default::default(),
        };
        let mover = MeshMover::on_grid(setup, comm).unwrap();
        let output = vec![f64::NAN; 6 * mover.output_rows().len()];
        Self { grid, structure, mover, output }
    }

    /// Lift and bend of the plate at time `t`.
    pub fn displacement(&self, t: f64) -> Vec<f64> {
        let bend =
            |p: &[f64; 3]| [0.05 * t, 0.02 * t * p[0], 0.1 * t * (1.0 - 2.0 * p[0] * p[0] - p[1] * p[1])];
        self.structure.coords.iter().flat_map(bend).collect()
    }

    pub fn advance(&mut self, w: &Window, displacement: &[f64]) -> Result<Stats, Fault> {
        let input = Input { canopy: displacement, grid: Default::default() };
        self.mover.advance(w, &input, &mut self.output)
    }
}

pub fn window(index: u64, iteration: u64) -> Window {
    const DT: f64 = 0.25;
    Window { index, iteration, substeps: 10, time: index as f64 * DT, dt: DT, ..Window::default() }
}
