//! Start of a stage from the flow of the other method: between a fitted grid and a Cartesian one with an immersed canopy.
//!
//! The velocity on either grid is a field that is constant in each control volume: a cell of the fitted grid, or for each component of the immersed flow
//! the box around the centre of a face. A control volume of the new grid takes the mean of that field by exact [`overlap`], so that momentum is conserved to
//! round-off. Velocities are relative to the wind, which is the field where the old grid ends. The next step of either solver removes the divergence of
//! the interpolated velocity.

pub mod overlap;

use std::path::Path;

use case::{Role, Scene};
use channel::Fault;
use immersed::flow::Flow;
use immersed::grid::{Grid, Velocity};
use nalgebra::Vector3;

use self::overlap::Planes;
use crate::immersed_canopy::Saved;
use crate::physics::Gas;
use crate::solver::Solver;
use crate::state::{self, TimeLevel};

type Point = Vector3<f64>;

/// Planes between the control volumes of component `c` of a staggered velocity on a grid with its origin at `origin`, m. Box `i + 1` along an axis is the
/// control volume of face or cell `i`; those at the ends of `c` are half a cell wide.
fn control_volumes(grid: &Grid, c: usize, origin: Point) -> Planes {
    [0, 1, 2].map(|d| {
        let axis = &grid.axes[d];
        let n = axis.len();
        let planes: Vec<f64> = if c == d {
            let centres = (0..n).map(|i| axis.centre(i));
            std::iter::once(axis.faces[0]).chain(centres).chain([axis.faces[n]]).collect()
        } else {
            axis.faces.clone()
        };
        planes.into_iter().map(|x| x + origin[d]).collect()
    })
}

/// Position in the arrays of `grid` of a box between `planes`; `None` outside of them.
fn position(grid: &Grid, planes: &Planes, at: [usize; 3]) -> Option<usize> {
    let inside = (0..3).all(|d| (1..planes[d].len()).contains(&at[d]));
    inside.then(|| grid.at(at.map(|i| i as isize - 1)))
}

/// Volume of a box between `planes`, m3.
fn box_volume(planes: &Planes, at: [usize; 3]) -> f64 {
    (0..3).map(|d| planes[d][at[d]] - planes[d][at[d] - 1]).product()
}

/// The velocity of an immersed flow as a field.
pub struct ImmersedField<'a> {
    grid: &'a Grid,
    velocity: &'a Velocity,
    planes: [Planes; 3],
}

impl<'a> ImmersedField<'a> {
    /// Of `velocity`, relative to the wind, m/s, on `grid` with its origin at `origin`, m.
    pub fn new(grid: &'a Grid, velocity: &'a Velocity, origin: Point) -> Self {
        Self { grid, velocity, planes: [0, 1, 2].map(|c| control_volumes(grid, c, origin)) }
    }

    /// Integral over a cell with these `corners` (m, in VTK order), m4/s; zero outside of the grid.
    pub fn integral(&self, corners: &[Point; 8]) -> Point {
        let component = |c: usize, _: usize| {
            let (planes, u) = (&self.planes[c], &self.velocity[c]);
            let mut sum = 0.0;
            overlap::of_cell(corners, planes, &mut |at, part| {
                sum += position(self.grid, planes, at).map_or(0.0, |at| part * u[at]);
            });
            sum
        };
        Point::from_fn(component)
    }

    /// Integral over the whole grid, m4/s.
    pub fn total(&self) -> Point {
        let component = |c: usize, _: usize| {
            let (planes, u) = (&self.planes[c], &self.velocity[c]);
            let boxes = |d: usize| 1..planes[d].len();
            let mut sum = 0.0;
            for k in boxes(2) {
                for j in boxes(1) {
                    for at in boxes(0).map(|i| [i, j, k]) {
                        sum += position(self.grid, planes, at).map_or(0.0, |p| box_volume(planes, at) * u[p]);
                    }
                }
            }
            sum
        };
        Point::from_fn(component)
    }
}

/// The staggered velocity, m/s, on `grid` with its origin at `origin`, m, of cells with their corners (m, in VTK order) and velocities relative to the wind,
/// m/s. Where no cell is, the velocity is zero. Ghosts are not filled.
pub fn staggered_velocity<'a>(
    grid: &Grid,
    origin: Point,
    cells: impl Iterator<Item = ([Point; 8], Point)> + Clone + 'a,
) -> Velocity {
    let mut velocity = grid.uniform(Point::zeros());
    for (c, u) in velocity.iter_mut().enumerate() {
        let planes = control_volumes(grid, c, origin);
        for (corners, v) in cells.clone() {
            overlap::of_cell(&corners, &planes, &mut |at, part| {
                if let Some(p) = position(grid, &planes, at) {
                    u[p] += part / box_volume(&planes, at) * v[c];
                }
            });
        }
    }
    velocity
}

/// Starts the flow on a fitted grid from the state of an immersed flow in `file`, in a wind of `wind` m/s. Pressure starts from that of the undisturbed air,
/// and the first steps are of first order in time. Collective.
///
/// # Errors
/// A file that is missing, damaged or of another kind.
pub fn start_fitted<G: Gas<N>, const N: usize>(
    solver: &mut Solver<G, N>,
    wind: Point,
    file: &Path,
) -> Result<(), Fault> {
    let (grid, velocity, origin) = Saved::load(file)?.field().map_err(|what| {
        Fault::new(format!("flow state: {}", archive::Error::content(file, format!("it {what}"))))
    })?;
    let field = ImmersedField::new(&grid, &velocity, origin);
    let mut q = vec![solver.spatial.gas.undisturbed(wind); solver.topology.n_local()];
    for (cell, (q, corners)) in q.iter_mut().zip(&solver.topology.cell_nodes).enumerate() {
        let mean = field.integral(&corners.map(|n| solver.nodes[n as usize])) / solver.metrics.volume[cell];
        (0..3).for_each(|c| q[1 + c] = wind[c] + mean[c]);
    }
    solver.halo.exchange(q.as_flattened_mut(), N);
    let level = TimeLevel { q, volume: Vec::new(), nodes: solver.nodes.clone() };
    // On a moving grid as many as the mesh-mover takes: wall and air take the same difference.
    let first_order_steps = if solver.settings.moving { 1 } else { 2 };
    solver.restore([level.clone(), level], 0.0, first_order_steps).map_err(Fault::new)
}

/// Starts an immersed flow, whose grid has its origin at `origin` (m, in the falling frame), from the state that stage `source` left on its fitted grid, in a
/// wind of `wind` m/s. Collective.
///
/// # Errors
/// A file that is missing, damaged or of another grid.
pub fn start_immersed(
    flow: &mut Flow,
    (origin, wind): (Point, Point),
    (scene, source, out): (&Scene, usize, &Path),
) -> Result<(), Fault> {
    let view = scene.for_stage(source);
    let (_, grid) = crate::setup::start_grid(&view, source, out)?;
    let file = case::state_file(&case::state_folder(out, &view, source), Role::Flow);
    let saved = state::read(&file, (grid.cells.len(), grid.coords.len()))?;
    let positions = saved.positions();
    let corners = grid.cells.iter().map(|cell| cell.map(|n| positions[n as usize]));
    let velocities = saved.velocities();
    let cells = corners.zip(velocities.iter().map(|v| v - wind));
    flow.velocity = staggered_velocity(&flow.grid, origin, cells);
    flow.fill_ghosts();
    Ok(())
}

#[cfg(test)]
mod tests {
    use immersed::axis::Axis;
    use immersed::grid::{End, Ends};

    use super::*;

    /// Cartesian grid of growing cells from -`half` to `half` along each axis.
    fn cartesian(half: f64) -> Grid {
        let axis = |n| {
            Axis::stretched([-0.3 * half, 0.3 * half], 0.6 * half / f64::from(n), [0.7 * half; 2], 1.3, 1)
        };
        Grid::new([axis(5), axis(6), axis(7)], [Ends::Open([End::Slip; 2]); 3])
    }

    /// The fitted grid of the small descent around its unstressed canopy: corners of its cells.
    fn fitted() -> Vec<[Point; 8]> {
        let scene =
            case::parse(Path::new("scene.toml"), include_str!("../../../cases/square-drop/scene.toml"))
                .unwrap_or_else(|e| panic!("{e}"));
        let (_, grid) = crate::setup::start_grid(&scene, 0, Path::new("/nowhere")).expect("a grid");
        grid.cells.iter().map(|cell| cell.map(|n| Point::from(grid.coords[n as usize]))).collect()
    }

    fn field(x: Point) -> Point {
        Point::new((1.3 * x.y).sin() + 0.2 * x.z, 0.5 - x.x * x.z, (0.7 * x.x).cos() * x.y + 1.0)
    }

    fn centre(corners: &[Point; 8]) -> Point {
        corners.iter().sum::<Point>() * 0.125
    }

    /// A velocity at the faces of a grid.
    fn velocity_of(grid: &Grid, origin: Point) -> Velocity {
        let mut velocity = grid.uniform(Point::zeros());
        let cells = grid.cells();
        for (c, u) in velocity.iter_mut().enumerate() {
            let count = |d: usize| cells[d] + usize::from(c == d);
            for k in 0..count(2) {
                for j in 0..count(1) {
                    for cell in (0..count(0)).map(|i| [i, j, k]) {
                        let x = Point::from_fn(|d, _| grid.coordinate(c, d, cell[d]));
                        u[grid.at(cell.map(|i| i as isize))] = field(x + origin)[c];
                    }
                }
            }
        }
        velocity
    }

    /// From a Cartesian grid within the fitted one: momentum of the cells is that of the boxes to round-off, and a smooth field arrives where it was.
    #[test]
    fn momentum_of_an_immersed_flow_is_conserved_on_a_fitted_grid() {
        let (grid, cells, origin) = (cartesian(2.5), fitted(), Point::new(0.11, -0.07, 0.23));
        let velocity = velocity_of(&grid, origin);
        let donor = ImmersedField::new(&grid, &velocity, origin);
        let (mut sum, mut worst, mut near) = (Point::zeros(), 0.0f64, 0);
        for corners in &cells {
            let integral = donor.integral(corners);
            sum += integral;
            if corners.iter().all(|x| (x - origin).amax() < 0.6) {
                let mean = integral / overlap::cell_volume(corners);
                worst = worst.max((mean - field(centre(corners))).amax());
                near += 1;
            }
        }
        let total = donor.total();
        println!(
            "momentum {sum}, of the donor {total}; largest error of {near} cells near the origin {worst:e}"
        );
        assert!((sum - total).amax() < 1e-11 * total.amax(), "{sum} {total}");
        // Donor values are constant over cells of 0.3 m, in which the field changes by up to 0.4.
        assert!(near > 100 && worst < 0.25, "{near} {worst}");
    }

    /// To a Cartesian grid around the fitted one.
    #[test]
    fn momentum_of_a_fitted_flow_is_conserved_on_an_immersed_grid() {
        let (grid, cells, origin) = (cartesian(60.0), fitted(), Point::new(0.11, -0.07, 0.23));
        let inside = |x: &Point| (x - origin).amax() < 59.0;
        assert!(cells.iter().flatten().all(inside));
        let with_velocity = cells.iter().map(|corners| (*corners, field(centre(corners))));
        let velocity = staggered_velocity(&grid, origin, with_velocity.clone());
        let total = ImmersedField::new(&grid, &velocity, origin).total();
        let sum: Point = with_velocity.map(|(x, v)| overlap::cell_volume(&x) * v).sum();
        assert!((sum - total).amax() < 1e-11 * sum.amax(), "{sum} {total}");
    }

    /// The control volume of a component lies around its face: a cell that fills it takes its value, one that is a cell of the grid the mean of two.
    #[test]
    fn control_volumes_lie_around_the_faces() {
        let axis = || Axis::even(-1.0, 1.0, 8);
        let grid = Grid::new([axis(), axis(), axis()], [Ends::Open([End::Slip; 2]); 3]);
        let origin = Point::new(0.1, 0.2, -0.3);
        let velocity = velocity_of(&grid, origin);
        let donor = ImmersedField::new(&grid, &velocity, origin);
        let cell = |low: Point| {
            [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
                .map(|(x, y, z)| low + 0.25 * Point::new(f64::from(x), f64::from(y), f64::from(z)))
        };
        for c in 0..3 {
            let index = [3, 4, 5];
            let at = grid.at(index);
            let corner = origin + Point::from_fn(|d, _| grid.axes[d].faces[index[d] as usize]);
            let mut around = corner;
            around[c] -= 0.125;
            let mean = |low: Point| donor.integral(&cell(low))[c] / 0.25f64.powi(3);
            assert!((mean(around) - velocity[c][at]).abs() < 1e-12, "{c}");
            let between = 0.5 * (velocity[c][at] + velocity[c][at + grid.strides[c]]);
            assert!((mean(corner) - between).abs() < 1e-12, "{c}");
        }
    }

    /// A uniform velocity arrives unchanged, at every face that the cells surround.
    #[test]
    fn uniform_velocity_is_kept() {
        let (grid, cells, origin) = (cartesian(2.0), fitted(), Point::zeros());
        let uniform = Point::new(0.3, -1.0, 2.0);
        let velocity = staggered_velocity(&grid, origin, cells.iter().map(|x| (*x, uniform)));
        for c in 0..3 {
            let count = |d: usize| grid.cells()[d] + usize::from(c == d);
            for cell in (0..count(2)).flat_map(|k| (0..count(1)).map(move |j| [2, j as isize, k as isize])) {
                let u = velocity[c][grid.at(cell)];
                assert!((u - uniform[c]).abs() < 1e-11, "{c} {cell:?}: {u}");
            }
        }
        let back = ImmersedField::new(&grid, &velocity, origin);
        let near = cells.iter().filter(|corners| corners.iter().all(|x| x.amax() < 1.9));
        for corners in near {
            let mean = back.integral(corners) / overlap::cell_volume(corners);
            assert!((mean - uniform).amax() < 1e-11, "{mean}");
        }
    }
}
