//! Quality report of a flow grid before the run.

use std::fmt;

use crate::geometry::{Point, Vec3, at, quad_area_vector, triangle_area_vector};
use crate::quality;
use crate::vtk::volume_shape;
use crate::{FaceTable, FlowGrid, msh::ElementShape};

/// Least, mean and largest of a measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Least.
    pub least: f64,
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub largest: f64,
}

/// The worst cell by one measure.
#[derive(Clone, Debug, PartialEq)]
pub struct Worst {
    /// The measure.
    pub measure: &'static str,
    /// Its value there.
    pub value: f64,
    /// The cell.
    pub cell: u32,
    /// Its centre, m.
    pub at: Point,
}

/// Sizes and shapes of the cells of a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct QualityReport {
    /// Hexahedra, prisms, pyramids, tetrahedra.
    pub cells: [usize; 4],
    /// Nodes.
    pub nodes: usize,
    /// Volume of a cell, m3.
    pub volume: Range,
    /// Sum of the volumes, m3.
    pub total_volume: f64,
    /// Smallest scaled Jacobian of a cell's corners: 1 at right angles, 0 flat.
    pub scaled_jacobian: Range,
    /// Longest over shortest edge of a cell.
    pub aspect: Range,
    /// Angle between a face's normal and the line of the two centres, degrees.
    pub non_orthogonality: Range,
    /// Distance from a face's centre to where the line of the two centres meets it,
    /// over the distance of the centres.
    pub skewness: Range,
    /// Larger over smaller size (cube root of the volume) of two neighbours.
    pub size_jump: Range,
    /// The worst cells by scaled Jacobian, aspect, non-orthogonality, skewness and size
    /// jump: three each.
    pub worst: Vec<Worst>,
}

/// Gathers the least, mean, largest, and the three worst.
struct Measure {
    name: &'static str,
    /// -1 where small values are bad.
    sign: f64,
    least: f64,
    largest: f64,
    sum: f64,
    count: usize,
    worst: Vec<(f64, u32)>,
}

const WORST: usize = 3;

impl Measure {
    fn new(name: &'static str, sign: f64) -> Self {
        Self {
            name,
            sign,
            least: f64::INFINITY,
            largest: f64::NEG_INFINITY,
            sum: 0.0,
            count: 0,
            worst: Vec::new(),
        }
    }

    fn add(&mut self, value: f64, cell: u32) {
        self.least = self.least.min(value);
        self.largest = self.largest.max(value);
        self.sum += value;
        self.count += 1;
        let bad = self.sign * value;
        if self.worst.len() == WORST && bad <= self.worst[WORST - 1].0 {
            return;
        }
        match self.worst.iter_mut().find(|w| w.1 == cell) {
            Some(w) => w.0 = w.0.max(bad),
            None => self.worst.push((bad, cell)),
        }
        self.worst.sort_by(|a, b| b.0.total_cmp(&a.0));
        self.worst.truncate(WORST);
    }

    fn range(&self) -> Range {
        if self.count == 0 {
            return Range { least: 0.0, mean: 0.0, largest: 0.0 };
        }
        Range { least: self.least, mean: self.sum / self.count as f64, largest: self.largest }
    }
}

/// Area vector and centre of a face, as the flow sees it.
fn face_shape(grid: &FlowGrid, nodes: [u32; 4]) -> (Vec3, Vec3) {
    let p = nodes.map(|n| at(&grid.coords, n));
    if nodes[2] == nodes[3] {
        let area = triangle_area_vector([p[0], p[1], p[2]]);
        return (area, (p[0] + p[1] + p[2]) * (1.0 / 3.0));
    }
    let area = quad_area_vector(p);
    let middle = (p[0] + p[1] + (p[2] + p[3])) * 0.25;
    let (mut moment, mut weight) = (Vec3::zeros(), 0.0);
    for k in 0..4 {
        let (a, b) = (p[k] - middle, p[(k + 1) % 4] - middle);
        let w = a.cross(&b).dot(&area);
        weight += w;
        moment += (a + b) * (w / 3.0);
    }
    (area, if weight > 0.0 { middle + moment * (1.0 / weight) } else { middle })
}

/// Centre of volume of a cell, m: tetrahedra from its first corner to its faces.
fn centroid(x: &[Vec3; 8]) -> Vec3 {
    let o = x[0];
    let (mut sum, mut volume) = (Vec3::zeros(), 0.0);
    for face in crate::HEX_FACES {
        let p = face.map(|i| x[i] - o);
        let m = (p[0] + p[1] + (p[2] + p[3])) * 0.25;
        for i in 0..4 {
            let (a, b) = (p[i], p[(i + 1) % 4]);
            let v = m.dot(&a.cross(&b));
            volume += v;
            sum += (a + b + m) * (0.25 * v);
        }
    }
    o + sum * (1.0 / volume)
}

/// Angle between the normal and the line of the two cell centres, degrees, and first cell of each face between cells.
pub(crate) fn non_orthogonality(grid: &FlowGrid, faces: &FaceTable) -> Vec<(f64, u32)> {
    let centre: Vec<Vec3> = grid.cells.iter().map(|c| centroid(&quality::corners(&grid.coords, c))).collect();
    let angle = |&(nodes, i, j): &(crate::faces::FaceNodes, u32, u32)| {
        let (area, _) = face_shape(grid, nodes);
        (degrees_between(centre[j as usize] - centre[i as usize], area), i)
    };
    faces.interior.iter().map(angle).collect()
}

/// Angle between two vectors, degrees.
fn degrees_between(a: Vec3, b: Vec3) -> f64 {
    (a.dot(&b) / (a.norm() * b.norm())).clamp(-1.0, 1.0).acos().to_degrees()
}

impl QualityReport {
    /// Looks at every cell and every face between two cells.
    pub fn new(grid: &FlowGrid, faces: &FaceTable) -> Self {
        let n = grid.cells.len();
        let (mut centre, mut size) = (Vec::with_capacity(n), Vec::with_capacity(n));
        let mut cells = [0; 4];
        let mut volume = Measure::new("volume", -1.0);
        let mut jacobian = Measure::new("scaled Jacobian", -1.0);
        let mut aspect = Measure::new("aspect", 1.0);
        for (c, nodes) in grid.cells.iter().enumerate() {
            let x = quality::corners(&grid.coords, nodes);
            let v = quality::volume(&x);
            cells[match volume_shape(nodes).0 {
                ElementShape::Prism => 1,
                ElementShape::Pyramid => 2,
                ElementShape::Tetrahedron => 3,
                _ => 0,
            }] += 1;
            centre.push(centroid(&x));
            size.push(v.cbrt());
            volume.add(v, c as u32);
            jacobian.add(quality::scaled_jacobian(&grid.coords, nodes), c as u32);
            aspect.add(quality::aspect(&grid.coords, nodes), c as u32);
        }
        let mut angle = Measure::new("non-orthogonality", 1.0);
        let mut skew = Measure::new("skewness", 1.0);
        let mut jump = Measure::new("size jump", 1.0);
        for &(nodes, i, j) in &faces.interior {
            let (area, middle) = face_shape(grid, nodes);
            let (a, b) = (centre[i as usize], centre[j as usize]);
            let d = b - a;
            let along = d.dot(&area);
            angle.add(degrees_between(d, area), i);
            let cross = a + d * ((middle - a).dot(&area) / along);
            let off = (middle - cross).norm() / d.norm();
            skew.add(if off.is_finite() { off } else { f64::MAX.sqrt() }, i);
            let ratio = size[i as usize] / size[j as usize];
            jump.add(ratio.max(1.0 / ratio), i);
        }
        let worst = [&jacobian, &aspect, &angle, &skew, &jump].into_iter().flat_map(|m| {
            let row = |&(bad, cell): &(f64, u32)| Worst {
                measure: m.name,
                value: m.sign * bad,
                cell,
                at: centre[cell as usize].into(),
            };
            m.worst.iter().map(row).collect::<Vec<_>>()
        });
        Self {
            cells,
            nodes: grid.coords.len(),
            volume: volume.range(),
            total_volume: volume.sum,
            scaled_jacobian: jacobian.range(),
            aspect: aspect.range(),
            non_orthogonality: angle.range(),
            skewness: skew.range(),
            size_jump: jump.range(),
            worst: worst.collect(),
        }
    }
}

impl fmt::Display for QualityReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [hexahedra, prisms, pyramids, tetrahedra] = self.cells;
        writeln!(
            f,
            "{} cells ({hexahedra} hexahedra, {prisms} prisms, {pyramids} pyramids, {tetrahedra} tetrahedra), \
             {} nodes, {:.6e} m3",
            self.cells.iter().sum::<usize>(),
            self.nodes,
            self.total_volume
        )?;
        writeln!(f, "{:<24} {:>11} {:>11} {:>11}", "", "least", "mean", "largest")?;
        for (name, r) in [
            ("volume, m3", self.volume),
            ("scaled Jacobian", self.scaled_jacobian),
            ("aspect", self.aspect),
            ("non-orthogonality, deg", self.non_orthogonality),
            ("skewness", self.skewness),
            ("size jump", self.size_jump),
        ] {
            writeln!(f, "{name:<24} {:>11.4e} {:>11.4e} {:>11.4e}", r.least, r.mean, r.largest)?;
        }
        writeln!(f, "worst cells")?;
        for w in &self.worst {
            let [x, y, z] = w.at;
            writeln!(
                f,
                "  {:<22} {:>11.4e}  cell {:>8} at ({x:.4}, {y:.4}, {z:.4}) m",
                w.measure, w.value, w.cell
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BoxShape, Patch, box_grid_of};

    fn report(grid: &FlowGrid) -> QualityReport {
        QualityReport::new(grid, &FaceTable::new(grid).unwrap())
    }

    #[test]
    fn cell_types_are_counted_and_uniform_boxes_have_ideal_quality() {
        for (k, shape) in [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra]
            .into_iter()
            .enumerate()
        {
            let grid = box_grid_of(shape, [3; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
            let r = report(&grid);
            assert_eq!(r.cells[k], grid.cells.len());
            assert!((r.total_volume - 1.0).abs() < 1e-12);
            assert!((r.size_jump.largest - 1.0).abs() < 1e-9, "{shape:?}: cells of one size");
        }
        let grid = box_grid_of(BoxShape::Hexahedra, [3; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        let r = report(&grid);
        assert!(r.non_orthogonality.largest < 1e-5 && r.skewness.largest < 1e-12);
        assert!((r.scaled_jacobian.least - 1.0).abs() < 1e-12 && (r.aspect.largest - 1.0).abs() < 1e-12);
    }

    #[test]
    fn skewness_aspect_ratio_and_size_jump_are_measured() {
        // x += z / 2: faces normal to z are crossed at atan(1/2), without being off their middles.
        let mut grid = box_grid_of(BoxShape::Hexahedra, [4; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        grid.coords.iter_mut().for_each(|x| x[0] += 0.5 * x[2]);
        let r = report(&grid);
        assert!((r.non_orthogonality.largest - 0.5f64.atan().to_degrees()).abs() < 1e-9);
        assert!(r.skewness.largest < 1e-12);
        assert!((r.scaled_jacobian.least - (1.25f64).powf(-0.5)).abs() < 1e-12);
        // The upper half is three times as thick: volumes 1 to 3, at the level in between.
        let mut grid =
            box_grid_of(BoxShape::Hexahedra, [2, 2, 4], [0.0; 3], [1.0, 1.0, 2.0], [Patch::Wall; 6]);
        grid.coords.iter_mut().filter(|x| x[2] > 1.0).for_each(|x| x[2] = 1.0 + 3.0 * (x[2] - 1.0));
        let r = report(&grid);
        assert!((r.size_jump.largest - 3f64.cbrt()).abs() < 1e-12);
        assert!((r.aspect.largest - 3.0).abs() < 1e-12);
        let jump: Vec<_> = r.worst.iter().filter(|w| w.measure == "size jump").collect();
        assert!(jump.len() == 3 && jump.iter().all(|w| (w.at[2] - 0.75).abs() < 1e-12), "{jump:?}");
        let text = r.to_string();
        assert!(text.contains("16 cells (16 hexahedra") && text.contains("size jump"), "{text}");
    }
}
