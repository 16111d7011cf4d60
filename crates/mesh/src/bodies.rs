//! Rigid bodies that a stage moves: the patches of a grid that are their surfaces.

use case::{Pose, Scene, Stage};

use crate::geometry::{Vec3, at};
use crate::{FlowGrid, Patch};

/// Largest speed of the walls of the bodies that a stage moves, m/s; 0 where it moves none.
pub fn body_speed(stage: &Stage, grid: &FlowGrid) -> f64 {
    let mut fastest = 0.0f64;
    for motion in &stage.body_motions {
        // A scene with another text than a formula is refused when it is read.
        let Ok(rigid) = motion.compiled() else { continue };
        let walls = grid.faces_of(&motion.patches).filter(|&k| is_solid(grid.boundary[k].0));
        let nodes = walls.flat_map(|k| grid.boundary[k].1);
        let reach = nodes.map(|n| rigid.reach(grid.coords[n as usize])).fold(0.0, f64::max);
        fastest = fastest.max(rigid.largest_speed(reach, stage.windows(), stage.window_s));
    }
    fastest
}

/// Largest speed of the canopy that `stage` moves as a rigid body, or of nodes that it rotates, m/s, with the nodes of the canopy at `nodes`; 0 where it moves none.
pub fn canopy_speed(scene: &Scene, stage: &Stage, nodes: &[[f64; 3]]) -> f64 {
    let of_canopy = stage.body_motions.iter().filter(|m| scene.moves_canopy(m));
    let speed = |rigid: case::RigidMotion| {
        let reach = nodes.iter().map(|x| rigid.reach(*x)).fold(0.0, f64::max);
        rigid.largest_speed(reach, stage.windows(), stage.window_s)
    };
    let body = of_canopy.filter_map(|m| m.compiled().ok()).map(speed).fold(0.0, f64::max);
    stage.motions.iter().filter_map(|m| turning_speed(scene, stage, m, nodes)).fold(body, f64::max)
}

/// Largest speed, m/s, that the rotation of a motion would give any of the canopy's `nodes` (m); `None` without one.
fn turning_speed(scene: &Scene, stage: &Stage, motion: &case::Motion, nodes: &[[f64; 3]]) -> Option<f64> {
    motion.rotation.as_ref()?;
    let k = scene.stages.iter().position(|s| s.name == stage.name)?;
    let motion = motion.in_stage(scene, k, &case::StageTimes::planned(scene)).ok()?;
    let reach = nodes.iter().map(|x| motion.reach(*x)).fold(0.0, f64::max);
    Some(reach * motion.largest_rate(stage.windows(), stage.window_s))
}

/// Room of a canopy that a stage moves as a rigid body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CanopyRoom {
    /// Largest displacement of a node at the end of a window, m.
    pub displacement: f64,
    /// Largest displacement of the axis of the rotation, m.
    pub translation: f64,
    /// Largest angle, rad.
    pub angle: f64,
}

/// The motion of the canopy, with its nodes at `nodes` (m), in `stage`; `None` where the stage does not move it as a rigid body.
pub fn canopy_room(scene: &Scene, stage: &Stage, nodes: &[[f64; 3]]) -> Option<CanopyRoom> {
    let motion = stage.body_motions.iter().find(|m| scene.moves_canopy(m))?.compiled().ok()?;
    let poses = extreme_poses(&motion, stage);
    let largest = |of: &dyn Fn(&Pose) -> f64| poses.iter().map(of).fold(0.0, f64::max);
    let way = |p: &Pose, x: &[f64; 3]| (Vec3::from(p.apply(*x)) - Vec3::from(*x)).norm();
    Some(CanopyRoom {
        displacement: largest(&|p| nodes.iter().map(|x| way(p, x)).fold(0.0, f64::max)),
        translation: largest(&|p| Vec3::from(p.displacement).norm()),
        angle: largest(&|p| p.angle.abs()),
    })
}

/// Smallest distance of a node of the canopy from the outer boundary of its grid, m; infinite without one.
pub fn canopy_gap(grid: &FlowGrid) -> f64 {
    let mut nodes: Vec<u32> = (0..grid.boundary.len()).flat_map(|k| grid.boundary[k].1).collect();
    nodes.sort_unstable();
    nodes.dedup();
    let others: Vec<Vec3> = nodes.iter().map(|&n| at(&grid.coords, n)).collect();
    gap(grid, &grid.canopy_nodes, &others)
}

fn is_solid(patch: Patch) -> bool {
    matches!(patch, Patch::Wall | Patch::Slip)
}

/// Room of the bodies of a stage between the parts of the boundary that do not move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Largest displacement of a node of a body at the end of a window, m.
    pub displacement: f64,
    /// Smallest distance of a node of a body from a boundary node that is fixed, m; infinite without any.
    pub gap: f64,
    /// Shortest edge of the faces of the bodies, m.
    pub edge: f64,
    /// Largest displacement of a body's node out of a plane patch that does not move but shares this node, m.
    pub out_of_plane: f64,
}

/// Poses of a motion that [`clearance`] examines: those in which a component of the displacement or the angle is extreme.
const EXTREMES: usize = 8;

/// The room of the bodies that `stage` moves; `sliding`: boundary nodes slide within planes. `None` where it moves none.
pub fn clearance(stage: &Stage, grid: &FlowGrid, sliding: bool) -> Option<Clearance> {
    let mut moved = vec![false; grid.coords.len()];
    if !stage.body_motions.iter().any(|m| grid.faces_of(&m.patches).next().is_some()) {
        return None;
    }
    let named = stage.body_motions.iter().flat_map(|m| grid.faces_of(&m.patches));
    let mut face_moves = vec![false; grid.boundary.len()];
    for k in named {
        face_moves[k] = true;
        grid.boundary[k].1.iter().for_each(|&n| moved[n as usize] = true);
    }
    let shares = |k: &usize| !face_moves[*k] && grid.boundary[*k].1.iter().any(|&n| moved[n as usize]);
    let shared: Vec<usize> = (0..grid.boundary.len()).filter(shares).collect();
    let mut found =
        Clearance { displacement: 0.0, gap: f64::INFINITY, edge: f64::INFINITY, out_of_plane: 0.0 };
    for motion in &stage.body_motions {
        let poses = extreme_poses(&motion.compiled().ok()?, stage);
        let change = |n: u32| {
            let x = grid.coords[n as usize];
            poses.iter().map(move |p| Vec3::from(p.apply(x)) - Vec3::from(x))
        };
        let mut nodes: Vec<u32> = Vec::new();
        for k in grid.faces_of(&motion.patches) {
            let face = grid.boundary[k].1;
            nodes.extend(face);
            for (a, b) in [(0, 1), (1, 2), (2, 3), (3, 0)].map(|(i, j)| (face[i], face[j])) {
                let length = (at(&grid.coords, a) - at(&grid.coords, b)).norm();
                found.edge = if a == b { found.edge } else { found.edge.min(length) };
            }
        }
        nodes.sort_unstable();
        nodes.dedup();
        let farthest = nodes.iter().flat_map(|&n| change(n)).map(|d| d.norm()).fold(0.0, f64::max);
        found.displacement = found.displacement.max(farthest);
        for &k in &shared {
            let face = grid.boundary[k].1;
            let normal = crate::geometry::quad_area_vector(face.map(|n| at(&grid.coords, n))).normalize();
            let ours = face.iter().filter(|n| nodes.binary_search(n).is_ok());
            let off = ours.flat_map(|&n| change(n)).map(|d| d.dot(&normal).abs()).fold(0.0, f64::max);
            found.out_of_plane = found.out_of_plane.max(off);
        }
        found.gap =
            found.gap.min(gap(grid, &nodes, &fixed_nodes(grid, &face_moves, &moved, &shared, sliding)));
    }
    found.displacement.is_finite().then_some(found)
}

/// Boundary nodes that do not move. With `sliding` those of patches that touch a body slide out of its way.
fn fixed_nodes(
    grid: &FlowGrid,
    face_moves: &[bool],
    moved: &[bool],
    shared: &[usize],
    sliding: bool,
) -> Vec<Vec3> {
    let touching: Vec<_> = shared.iter().filter_map(|&k| grid.boundary_patch.get(k)).collect();
    let fixed = |k: &usize| {
        let touches = grid.boundary_patch.get(*k).is_some_and(|p| touching.contains(&p));
        !(face_moves[*k] || sliding && touches)
    };
    let mut nodes: Vec<u32> =
        (0..grid.boundary.len()).filter(fixed).flat_map(|k| grid.boundary[k].1).collect();
    nodes.sort_unstable();
    nodes.dedup();
    nodes.retain(|n| !moved[*n as usize]);
    nodes.iter().map(|&n| at(&grid.coords, n)).collect()
}

/// Smallest distance of `nodes` from `others`, m: groups of others that are farther away than the best so far are skipped.
fn gap(grid: &FlowGrid, nodes: &[u32], others: &[Vec3]) -> f64 {
    let sphere = |g: &[Vec3]| {
        let centre = g.iter().sum::<Vec3>() / g.len() as f64;
        (centre, g.iter().map(|x| (x - centre).norm()).fold(0.0, f64::max))
    };
    let groups: Vec<_> = others.chunks(64).map(|g| (sphere(g), g)).collect();
    let mut best = f64::INFINITY;
    for &n in nodes {
        let x = at(&grid.coords, n);
        for ((centre, radius), points) in &groups {
            if (x - centre).norm() - radius < best {
                best = points.iter().map(|p| (p - x).norm()).fold(best, f64::min);
            }
        }
    }
    best
}

/// The poses at the ends of windows in which each component of the displacement and the angle are smallest and largest.
fn extreme_poses(motion: &case::RigidMotion, stage: &Stage) -> Vec<Pose> {
    let value = |p: &Pose, i: usize| if i < 3 { p.displacement[i] } else { p.angle };
    let mut extremes = vec![motion.at(0.0); EXTREMES];
    for k in 1..=stage.windows().min(100_000) {
        let pose = motion.at(k as f64 * stage.window_s);
        for i in 0..EXTREMES / 2 {
            if value(&pose, i) < value(&extremes[2 * i], i) {
                extremes[2 * i] = pose;
            }
            if value(&pose, i) > value(&extremes[2 * i + 1], i) {
                extremes[2 * i + 1] = pose;
            }
        }
    }
    extremes
}
