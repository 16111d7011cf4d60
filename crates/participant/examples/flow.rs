//! A flow model of one equation in place of the flow-solver.
//!
//! The air inside an inflated canopy is at rest relative to it, so the pressure jump is nearly the same on the whole canopy:
//!
//! jump = 1/2 rho c |u| u,    u = w . e_z - v_face . n,
//!
//! with the density rho, a pressure coefficient c, the velocity w of the air relative to the frame of the payload, and the velocity
//! v_face and unit normal n of a face.

use std::ops::Range;
use std::path::Path;
use std::process::ExitCode;

use ripstop_participant::{
    Announcement, Fault, Input, Participant, Role, Run, Stats, Window, flow_stats, main as participant_main,
    save_state,
};

type Vec3 = [f64; 3];

/// kg/m3
const DENSITY: f64 = 1.225;
/// Pressure jump over dynamic pressure.
const COEFFICIENT: f64 = 1.5;

struct StagnationFlow {
    announcement: Announcement,
    faces: Vec<[u32; 4]>,
    /// Grid node of each canopy node; empty where the canopy is held still and no grid is read.
    grid_rows: Vec<u64>,
    /// Positions of the canopy nodes at the start of the stage, m.
    start: Vec<Vec3>,
    /// Vertical velocity of the wind, m/s.
    wind: f64,
    /// Faces of this rank.
    rows: Range<usize>,
}

impl StagnationFlow {
    fn new(run: &Run) -> Result<Self, Fault> {
        let data = run.data(true)?;
        let grid = data.flow_grid()?;
        let start = grid.canopy_nodes.iter().map(|node| grid.coords[*node as usize]).collect();
        // In a stage without a mesh-mover the canopy is held still, and no grid is read.
        let moving = data.is_coupled();
        let grid_nodes = if moving { grid.coords.len() } else { 0 };
        let effects = ["resume", "coupling.adaptive"];
        Ok(Self {
            announcement: run.announcement(&data, "stagnation-flow", grid_nodes, &effects),
            faces: data.structure.faces.clone(),
            grid_rows: if moving { grid.canopy_nodes.clone() } else { Vec::new() },
            start,
            wind: data.scene["flow"]["wind_m_s"][2].as_f64().unwrap_or(0.0),
            rows: run.share(data.structure.faces.len()),
        })
    }

    /// Area vector (m2) and mean velocity (m/s) of a face.
    fn face(&self, face: &[u32; 4], input: &Input<'_>) -> (Vec3, Vec3) {
        let row = |node: u32| match input.grid.is_empty() {
            true => (self.start[node as usize], [0.0; 3]),
            false => {
                let [x, y, z, u, v, w] = *input.grid.row(node as usize);
                ([x, y, z], [u, v, w])
            }
        };
        let [a, b, c, d] = face.map(row);
        let area = cross(minus(c.0, a.0), minus(d.0, b.0)).map(|x| 0.5 * x);
        let velocity = [0, 1, 2].map(|i| 0.25 * (a.1[i] + b.1[i] + c.1[i] + d.1[i]));
        (area, velocity)
    }
}

impl Participant for StagnationFlow {
    fn announce(&self) -> Announcement {
        self.announcement.clone()
    }

    fn output_rows(&self) -> Vec<u64> {
        self.rows.clone().map(|row| row as u64).collect()
    }

    fn grid_rows(&self) -> Vec<u64> {
        self.grid_rows.clone()
    }

    fn advance(&mut self, window: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        // The frame falls with the payload: the air comes from below.
        let air = self.wind - window.frame_velocity[2];
        let mut stats = Stats::default();
        for (number, face) in self.faces.iter().enumerate() {
            let (area, velocity) = self.face(face, input);
            let size = dot(area, area).sqrt();
            let u = air - dot(velocity, area) / size;
            let jump = 0.5 * DENSITY * COEFFICIENT * u.abs() * u;
            if let Some(at) = number.checked_sub(self.rows.start).filter(|_| number < self.rows.end) {
                // No friction.
                output[4 * at..4 * at + 4].copy_from_slice(&[jump, 0.0, 0.0, 0.0]);
            }
            // Global values, the same on each rank.
            for (axis, component) in area.iter().enumerate() {
                stats.values[flow_stats::FORCE + axis] += jump * component;
            }
        }
        Ok(stats)
    }

    fn accept(&mut self, _: &Window) -> Result<(), Fault> {
        // There is no state: the pressure follows from the present motion alone.
        Ok(())
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        if self.rows.start == 0 { save_state(folder, Role::Flow, &()) } else { Ok(()) }
    }

    fn snapshot(&mut self, _: f64, _: &Path) -> Result<(), Fault> {
        Ok(())
    }
}

fn minus(a: Vec3, b: Vec3) -> Vec3 {
    [0, 1, 2].map(|i| a[i] - b[i])
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn main() -> ExitCode {
    participant_main(Role::Flow, StagnationFlow::new)
}
