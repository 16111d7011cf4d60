//! Pictures of the flow for ParaView.

use std::ops::Range;
use std::path::Path;

use channel::Fault;
use immersed::flow::Flow;
use mesh::vtk::{Series, Values, write_rectilinear};
use nalgebra::{Matrix3, Vector3};

/// Cells of a file of a picture, about, and files of a picture at most: each needs memory while it is written.
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

    /// Adds the accepted state at `time` (s) below `folder`, with the same fields as the flow on a fitted grid. `flow` is complete on each rank
    /// ([`Flow::gather`]); each writes its share of the files.
    ///
    /// # Errors
    /// The files cannot be written.
    pub fn write(&mut self, flow: &Flow, place: &Place, time: f64, folder: &Path) -> Result<(), Fault> {
        let planes = flow.grid.cells()[2];
        let ranks = flow.slabs().ranks();
        let files = flow.grid.count().div_ceil(FILE_CELLS).max(ranks.size()).min(MAX_FILES).min(planes);
        let names: Vec<String> = (0..files).map(|i| format!("flow/flow_{:05}_{i}.vtr", self.count)).collect();
        for i in flow.slabs().share(files) {
            piece(flow, place, planes * i / files..planes * (i + 1) / files, &folder.join(&names[i]))?;
        }
        if ranks.rank() == 0 {
            let series = self.series.get_or_insert_with(|| Series::resume(folder.join("flow.pvd"), time));
            series.push(time, &names).map_err(Fault::new)?;
        }
        self.count += 1;
        Ok(())
    }
}

fn single(v: Vector3<f64>) -> [f32; 3] {
    v.map(|x| x as f32).into()
}

/// Fields of some cells.
#[derive(Default)]
struct Fields {
    pressure: Vec<f32>,
    ground: Vec<[f32; 3]>,
    frame: Vec<[f32; 3]>,
    mach: Vec<f32>,
    vorticity: Vec<[f32; 3]>,
    q: Vec<f32>,
}

impl Fields {
    /// Of the cells in `planes` along z, x fastest.
    fn of(flow: &Flow, place: &Place, planes: &Range<usize>) -> Self {
        let [nx, ny, _] = flow.grid.cells();
        let own = planes.start * nx * ny..planes.end * nx * ny;
        let pressures = flow.pressures().skip(own.start).take(own.len());
        let mut fields = Self { pressure: pressures.map(|p| p as f32).collect(), ..Self::default() };
        for at in own {
            let cell = [at % nx, at / nx % ny, at / (nx * ny)];
            let ground = flow.cell_velocity(cell) + place.wind;
            let relative = ground - place.frame;
            fields.ground.push(single(ground));
            fields.frame.push(single(relative));
            fields.mach.push((relative.norm() / place.sound) as f32);
            let g = gradient(flow, cell);
            fields.vorticity.push(single(Vector3::new(g.m32 - g.m23, g.m13 - g.m31, g.m21 - g.m12)));
            fields.q.push((-0.5 * (g * g).trace()) as f32);
        }
        fields
    }
}

/// Writes the cells in `planes` along z.
fn piece(flow: &Flow, place: &Place, planes: Range<usize>, file: &Path) -> Result<(), Fault> {
    if let Some(parent) = file.parent() {
        std::fs::create_dir_all(parent)
            .map_err(|e| Fault::new(format!("cannot create {}: {e}", parent.display())))?;
    }
    let fields = Fields::of(flow, place, &planes);
    let fields = [
        ("pressure_pa", Values::F32(&fields.pressure)),
        ("velocity_ground_m_s", Values::Vector32(&fields.ground)),
        ("velocity_frame_m_s", Values::Vector32(&fields.frame)),
        ("mach", Values::F32(&fields.mach)),
        ("vorticity_1_s", Values::Vector32(&fields.vorticity)),
        ("q_criterion_1_s2", Values::F32(&fields.q)),
    ];
    let faces = |d: usize| -> Vec<f64> {
        let range = if d == 2 { planes.start..planes.end + 1 } else { 0..flow.grid.axes[d].len() + 1 };
        flow.grid.axes[d].faces[range].iter().map(|x| x + place.origin[d]).collect()
    };
    let [x, y, z] = [0, 1, 2].map(faces);
    write_rectilinear(file, [&x, &y, &z], &fields).map_err(Fault::new)
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
    use mesh::vtk::read::Piece;

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
        let cells =
            names.iter().map(|name| Piece::read(&folder.path().join(name)).expect("a file").n_cells());
        (names.len(), cells.sum())
    }

    #[test]
    fn files_of_a_picture_have_all_cells() {
        assert_eq!(written(20), (1, 50_000));
        assert_eq!(written(60), (3, 150_000));
    }
}
