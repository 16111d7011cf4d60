//! Pictures of the flow for ParaView.

use std::ops::Range;
use std::path::Path;

use channel::Fault;
use immersed::flow::Flow;
use mesh::vtk::{Series, Values, write_volume};
use nalgebra::{Matrix3, Vector3};

/// Cells of a file of a picture, about, and files of a picture at most: a file needs 450 bytes of memory a cell while it is written.
const FILE_CELLS: usize = 65_536;
const MAX_FILES: usize = 16;

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
        let planes = flow.grid.cells()[2];
        let files = flow.grid.count().div_ceil(FILE_CELLS).clamp(1, MAX_FILES.min(planes));
        let names: Vec<String> = (0..files).map(|i| format!("flow/flow_{:05}_{i}.vtu", self.count)).collect();
        for (i, name) in names.iter().enumerate() {
            piece(flow, place, planes * i / files..planes * (i + 1) / files, &folder.join(name))?;
        }
        let series = self.series.get_or_insert_with(|| Series::resume(folder.join("flow.pvd"), time));
        series.push(time, &names).map_err(Fault::new)?;
        self.count += 1;
        Ok(())
    }
}

fn single(v: Vector3<f64>) -> [f32; 3] {
    v.map(|x| x as f32).into()
}

/// Nodes and cells of the cells in `planes` along z.
fn geometry(flow: &Flow, origin: Vector3<f64>, planes: &Range<usize>) -> (Vec<[f64; 3]>, Vec<[u32; 8]>) {
    let axes = &flow.grid.axes;
    let [nx, ny, _] = flow.grid.cells();
    let mut nodes = Vec::with_capacity((nx + 1) * (ny + 1) * (planes.len() + 1));
    for z in &axes[2].faces[planes.start..=planes.end] {
        for y in &axes[1].faces {
            nodes.extend(axes[0].faces.iter().map(|x| <[f64; 3]>::from(Vector3::new(*x, *y, *z) + origin)));
        }
    }
    let node = |i: usize, j: usize, k: usize| ((k * (ny + 1) + j) * (nx + 1) + i) as u32;
    let mut cells = Vec::with_capacity(nx * ny * planes.len());
    for k in 0..planes.len() {
        for j in 0..ny {
            for i in 0..nx {
                let ring =
                    |k: usize| [node(i, j, k), node(i + 1, j, k), node(i + 1, j + 1, k), node(i, j + 1, k)];
                let ([a, b, c, d], [e, f, g, h]) = (ring(k), ring(k + 1));
                cells.push([a, b, c, d, e, f, g, h]);
            }
        }
    }
    (nodes, cells)
}

/// Writes the cells in `planes` along z.
fn piece(flow: &Flow, place: &Place, planes: Range<usize>, file: &Path) -> Result<(), Fault> {
    if let Some(parent) = file.parent() {
        std::fs::create_dir_all(parent)
            .map_err(|e| Fault::new(format!("cannot create {}: {e}", parent.display())))?;
    }
    let (nodes, cells) = geometry(flow, place.origin, &planes);
    let [nx, ny, _] = flow.grid.cells();
    let own = planes.start * nx * ny..planes.end * nx * ny;
    let cell = |at: usize| [at % nx, at / nx % ny, at / (nx * ny)];
    let pressure: Vec<f32> = flow.pressures().skip(own.start).take(own.len()).map(|p| p as f32).collect();
    let velocities = || own.clone().map(|at| flow.cell_velocity(cell(at)));
    let ground: Vec<_> = velocities().map(|v| single(v + place.wind)).collect();
    let relative = |v: Vector3<f64>| v + place.wind - place.frame;
    let frame: Vec<_> = velocities().map(|v| single(relative(v))).collect();
    let mach: Vec<f32> = velocities().map(|v| (relative(v).norm() / place.sound) as f32).collect();
    let gradients = || own.clone().map(|at| gradient(flow, cell(at)));
    let curl = |g: Matrix3<f64>| single(Vector3::new(g.m32 - g.m23, g.m13 - g.m31, g.m21 - g.m12));
    let vorticity: Vec<_> = gradients().map(curl).collect();
    let q: Vec<f32> = gradients().map(|g| (-0.5 * (g * g).trace()) as f32).collect();
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

/// Gradient of the velocity in a cell, row i that of component i, by differences of neighbouring cells, 1/s.
fn gradient(flow: &Flow, cell: [usize; 3]) -> Matrix3<f64> {
    let n = flow.grid.cells();
    let along = |d: usize| {
        let axis = &flow.grid.axes[d];
        let [below, above] = [cell[d].saturating_sub(1), (cell[d] + 1).min(n[d] - 1)];
        let value = |i: usize| {
            let mut other = cell;
            other[d] = i;
            flow.cell_velocity(other)
        };
        (value(above) - value(below)) / (axis.centre(above) - axis.centre(below))
    };
    Matrix3::from_columns(&[along(0), along(1), along(2)])
}

#[cfg(test)]
mod tests {
    use immersed::axis::Axis;
    use immersed::flow::Settings;
    use immersed::grid::{End, Ends, Grid};
    use immersed::momentum::Momentum;

    use super::*;

    /// Files of one picture, and the cells in all of them.
    fn written(planes: usize) -> (usize, usize) {
        let open = Ends::Open([End::Inflow, End::Outflow]);
        let side = || Axis::even(0.0, 1.0, 50);
        let grid = Grid::new([side(), side(), Axis::even(0.0, 1.0, planes)], [open, open, open]);
        let momentum = Momentum { upwind_share: 0.5, viscosity: 0.0 };
        let flow = Flow::new(grid, Settings { density: 1.2, far: Vector3::z(), momentum, tolerance: 1e-3 });
        let zero = Vector3::zeros();
        let place = Place { origin: zero, wind: zero, frame: zero, sound: 340.0 };
        let folder = tempfile::tempdir().expect("a folder");
        Snapshots::default().write(&flow, &place, 0.0, folder.path()).expect("written");
        let pvd = std::fs::read_to_string(folder.path().join("flow.pvd")).expect("a series");
        let names: Vec<&str> = pvd.split("file=\"").skip(1).filter_map(|s| s.split('"').next()).collect();
        let cells = names.iter().map(|name| {
            let bytes = std::fs::read(folder.path().join(name)).expect("a file");
            let text = String::from_utf8_lossy(&bytes);
            let number = text.split("NumberOfCells=\"").nth(1).and_then(|s| s.split('"').next());
            number.expect("a number").parse::<usize>().expect("a number")
        });
        (names.len(), cells.sum())
    }

    #[test]
    fn files_of_a_picture_have_all_cells() {
        assert_eq!(written(20), (1, 50_000));
        assert_eq!(written(60), (3, 150_000));
    }
}
