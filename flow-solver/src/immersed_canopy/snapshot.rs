//! Pictures of the flow for ParaView.

use std::path::Path;

use channel::Fault;
use immersed::flow::Flow;
use mesh::vtk::{Series, Values, write_volume};
use nalgebra::{Matrix3, Vector3};

/// The series of one stage.
#[derive(Default)]
pub struct Snapshots {
    series: Option<Series>,
    count: usize,
}

/// What a picture needs besides the flow.
pub struct Place {
    /// Origin of the grid in the falling frame, m.
    pub origin: Vector3<f64>,
    /// Wind, and velocity of the frame, m/s.
    pub wind: Vector3<f64>,
    pub frame: Vector3<f64>,
    /// Speed of sound, m/s.
    pub sound: f64,
}

impl Snapshots {
    /// Continues the series in `folder`.
    pub fn resume(folder: &Path) -> Self {
        let series = Series::resume(folder.join("flow.pvd"), f64::INFINITY);
        Self { count: series.times(), series: Some(series) }
    }

    /// Adds the accepted state at `time` (s) below `folder`, with the same fields as the flow on a fitted grid.
    ///
    /// # Errors
    /// The files cannot be written.
    pub fn write(&mut self, flow: &Flow, place: &Place, time: f64, folder: &Path) -> Result<(), Fault> {
        let name = format!("flow/flow_{:05}_0.vtu", self.count);
        piece(flow, place, &folder.join(&name))?;
        let series = self.series.get_or_insert_with(|| Series::resume(folder.join("flow.pvd"), time));
        series.push(time, &[name]).map_err(Fault::new)?;
        self.count += 1;
        Ok(())
    }
}

fn single(v: Vector3<f64>) -> [f32; 3] {
    v.map(|x| x as f32).into()
}

fn piece(flow: &Flow, place: &Place, file: &Path) -> Result<(), Fault> {
    if let Some(parent) = file.parent() {
        std::fs::create_dir_all(parent)
            .map_err(|e| Fault::new(format!("cannot create {}: {e}", parent.display())))?;
    }
    let axes = &flow.grid.axes;
    let n = flow.grid.cells();
    let mut nodes = Vec::with_capacity(n.iter().map(|n| n + 1).product());
    for z in &axes[2].faces {
        for y in &axes[1].faces {
            nodes.extend(
                axes[0].faces.iter().map(|x| <[f64; 3]>::from(Vector3::new(*x, *y, *z) + place.origin)),
            );
        }
    }
    let node = |i: usize, j: usize, k: usize| ((k * (n[1] + 1) + j) * (n[0] + 1) + i) as u32;
    let mut cells = Vec::with_capacity(flow.grid.count());
    for k in 0..n[2] {
        for j in 0..n[1] {
            for i in 0..n[0] {
                let ring =
                    |k: usize| [node(i, j, k), node(i + 1, j, k), node(i + 1, j + 1, k), node(i, j + 1, k)];
                let ([a, b, c, d], [e, f, g, h]) = (ring(k), ring(k + 1));
                cells.push([a, b, c, d, e, f, g, h]);
            }
        }
    }
    let velocity = flow.cell_velocities();
    let pressure: Vec<f32> = flow.pressures().map(|p| p as f32).collect();
    let ground: Vec<_> = velocity.iter().map(|v| single(v + place.wind)).collect();
    let relative = |v: &Vector3<f64>| v + place.wind - place.frame;
    let frame: Vec<_> = velocity.iter().map(|v| single(relative(v))).collect();
    let mach: Vec<f32> = velocity.iter().map(|v| (relative(v).norm() / place.sound) as f32).collect();
    let curl = |g: Matrix3<f64>| single(Vector3::new(g.m32 - g.m23, g.m13 - g.m31, g.m21 - g.m12));
    let vorticity: Vec<_> = gradients(flow, &velocity).map(curl).collect();
    let q: Vec<f32> = gradients(flow, &velocity).map(|g| (-0.5 * (g * g).trace()) as f32).collect();
    drop(velocity);
    let fields = [
        ("pressure_pa", Values::F32(&pressure)),
        ("velocity_ground_m_s", Values::Vector32(&ground)),
        ("velocity_frame_m_s", Values::Vector32(&frame)),
        ("mach", Values::F32(&mach)),
        ("vorticity_1_s", Values::Vector32(&vorticity)),
        ("q_criterion_1_s2", Values::F32(&q)),
    ];
    write_volume(file, &nodes, &cells, &[], &fields).map_err(Fault::new)
}

/// Gradients of the velocity in each cell, row i that of component i, by differences of neighbouring cells, 1/s.
fn gradients<'a>(flow: &'a Flow, velocity: &'a [Vector3<f64>]) -> impl Iterator<Item = Matrix3<f64>> + 'a {
    let n = flow.grid.cells();
    let strides = [1, n[0], n[0] * n[1]];
    (0..velocity.len()).map(move |at| {
        let cell = [at % n[0], at / n[0] % n[1], at / strides[2]];
        let along = |d: usize| {
            let axis = &flow.grid.axes[d];
            let (below, above) = (cell[d].saturating_sub(1), (cell[d] + 1).min(n[d] - 1));
            let value = |i: usize| velocity[at + i * strides[d] - cell[d] * strides[d]];
            (value(above) - value(below)) / (axis.centre(above) - axis.centre(below))
        };
        Matrix3::from_columns(&[along(0), along(1), along(2)])
    })
}
