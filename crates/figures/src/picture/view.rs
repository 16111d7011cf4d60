//! Perspective view of canopy and lines.

use mesh::Point;
use mesh::geometry::{Vec3, at};
use mesh::vtk::read::Piece;

use super::legend::Legend;
use super::raster::{Position, Raster};
use crate::colour::Rgb;

/// Lines of the parachute.
pub(super) const DARK: Rgb = [0.13, 0.15, 0.18];

/// Normalises a vector; a zero vector is unchanged.
fn unit(a: Vec3) -> Vec3 {
    a.try_normalize(0.0).unwrap_or(a)
}

/// Minimum and maximum coordinates; infinite without points.
pub(super) fn bounds(points: impl IntoIterator<Item = Point>) -> [Point; 2] {
    let mut found = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for p in points {
        for c in 0..3 {
            found[0][c] = found[0][c].min(p[c]);
            found[1][c] = found[1][c].max(p[c]);
        }
    }
    found
}

/// A perspective view that fits given points into a frame.
#[derive(Clone)]
pub(super) struct View {
    eye: Vec3,
    axes: [Vec3; 3],
    /// Scale, pixels, and centre of the projection.
    scale: f64,
    shift: [f64; 2],
}

impl View {
    /// A view from `azimuth` (from x towards y) and `elevation`, degrees, that fits all `points` into the frame from
    /// `corner` with `size` pixels.
    pub(super) fn fit(
        points: &[Point],
        [azimuth, elevation]: [f64; 2],
        corner: [f64; 2],
        size: [f64; 2],
    ) -> Self {
        let [low, high] = bounds(points.iter().copied()).map(Vec3::from);
        let centre = (low + high) * 0.5;
        let extent = (high - low).norm().max(1e-9);
        let (a, e) = (azimuth.to_radians(), elevation.to_radians());
        let back = Vec3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin());
        let right = Vec3::new(-a.sin(), a.cos(), 0.0);
        let eye = centre + back * (2.5 * extent);
        let mut view = Self { eye, axes: [right, right.cross(&back), back], scale: 1.0, shift: [0.0; 2] };
        let [low, high] = bounds(points.iter().map(|&p| view.place(p)));
        let span = [high[0] - low[0], high[1] - low[1]].map(|s| s.max(1e-9));
        view.scale = (size[0] / span[0]).min(size[1] / span[1]);
        view.shift = [0, 1].map(|c| corner[c] + 0.5 * size[c] - 0.5 * view.scale * (low[c] + high[c]));
        view
    }

    /// Projects a point.
    pub(super) fn place(&self, point: Point) -> Position {
        let d = Vec3::from(point) - self.eye;
        let depth = -d.dot(&self.axes[2]);
        // `right.cross(&back)` points downwards, as pixels do.
        let slope = [d.dot(&self.axes[0]) / depth, d.dot(&self.axes[1]) / depth];
        [self.shift[0] + self.scale * slope[0], self.shift[1] + self.scale * slope[1], depth]
    }
}

/// Shades a colour with light from the upper left of the viewer, on both sides of the fabric.
fn lit(colour: Rgb, normal: Vec3, view: &View) -> Rgb {
    let [right, down, back] = view.axes;
    let light = unit(back * 1.2 - right * 0.5 - down * 0.7);
    let normal = unit(normal);
    // Towards the eye.
    let facing = if normal.dot(&back) < 0.0 { -1.0 } else { 1.0 };
    let diffuse = (facing * normal.dot(&light)).max(0.0) as f32;
    colour.map(|c| c * (0.5 + 0.54 * diffuse))
}

/// Content of a frame.
pub(super) struct Body<'a> {
    pub(super) canopy: &'a Piece,
    pub(super) lines: Option<&'a Piece>,
    /// Value of each canopy node.
    pub(super) values: &'a [f64],
}

/// Area-weighted nodal means of cell values, and nodal normals.
pub(super) fn at_points(canopy: &Piece, cell_values: &[f64]) -> (Vec<f64>, Vec<Vec3>) {
    let n = canopy.points.len();
    let (mut sum, mut weight, mut normal) = (vec![0.0; n], vec![0.0; n], vec![Vec3::zeros(); n]);
    for (cell, &value) in cell_values.iter().enumerate().take(canopy.n_cells()) {
        let nodes = canopy.cell(cell);
        let [a, b, c, ..] = *nodes else { continue };
        let [a, b, c] = [a, b, c].map(|i| at(&canopy.points, i));
        let area = (b - a).cross(&(c - a));
        let size = area.norm();
        for &i in nodes {
            let i = i as usize;
            sum[i] += size * value;
            weight[i] += size;
            normal[i] += area;
        }
    }
    let values = sum.iter().zip(&weight).map(|(s, w)| if *w > 0.0 { s / w } else { 0.0 }).collect();
    (values, normal)
}

/// Draws fabric, seams, lines and payload.
pub(super) fn draw(raster: &mut Raster, view: &View, body: &Body, legend: &Legend, pen: f64) {
    let canopy = body.canopy;
    let (_, normals) = at_points(canopy, &vec![0.0; canopy.n_cells()]);
    let places: Vec<Position> = canopy.points.iter().map(|&p| view.place(p)).collect();
    let colours: Vec<Rgb> =
        (0..places.len()).map(|i| lit(legend.colour(body.values[i]), normals[i], view)).collect();
    for cell in 0..canopy.n_cells() {
        if let [first, rest @ ..] = canopy.cell(cell) {
            for pair in rest.windows(2) {
                let corners = [*first, pair[0], pair[1]].map(|i| i as usize);
                raster.triangle(corners.map(|i| places[i]), corners.map(|i| colours[i]));
            }
        }
    }
    // Lines lie a little nearer than the fabric that they touch.
    let near = |p: Position| [p[0], p[1], p[2] * 0.998];
    for [a, b] in hem(canopy) {
        raster.line([near(places[a as usize]), near(places[b as usize])], 1.3 * pen, [0.25, 0.18, 0.28]);
    }
    let Some(lines) = body.lines else { return };
    let places: Vec<Position> = lines.points.iter().map(|&p| view.place(p)).collect();
    for cell in 0..lines.n_cells() {
        for ends in lines.edges(cell) {
            raster.line(ends.map(|i| near(places[i as usize])), pen, DARK);
        }
    }
    if let Some((top, size)) = payload_place(canopy, lines) {
        payload(raster, view, top, size);
    }
}

/// Position of the payload (lowest end of the lines) and its drawn size; `None` for cables without fabric, which carry none.
pub(super) fn payload_place(canopy: &Piece, lines: &Piece) -> Option<(Point, f64)> {
    if canopy.n_cells() == 0 {
        return None;
    }
    let ends = (0..lines.n_cells()).flat_map(|c| lines.cell(c)).map(|&i| lines.points[i as usize]);
    let [low, high] = bounds(canopy.points.iter().copied());
    ends.min_by(|a, b| a[2].total_cmp(&b[2])).map(|top| (top, 0.045 * (high[0] - low[0])))
}

/// Corner 0 to 7 of the box that represents the payload.
pub(super) fn payload_corner(top: Point, size: f64, corner: usize) -> Point {
    let side = |bit: usize| if corner & bit == 0 { -0.5 } else { 0.5 };
    [top[0] + size * side(1), top[1] + size * side(2), top[2] + size * (side(4) - 0.5)]
}

/// A box below `top` that shows the position of the payload, not its shape.
fn payload(raster: &mut Raster, view: &View, top: Point, size: f64) {
    let faces: [([usize; 4], Point); 6] = [
        ([0, 1, 3, 2], [0.0, 0.0, -1.0]),
        ([4, 5, 7, 6], [0.0, 0.0, 1.0]),
        ([0, 1, 5, 4], [0.0, -1.0, 0.0]),
        ([2, 3, 7, 6], [0.0, 1.0, 0.0]),
        ([0, 2, 6, 4], [-1.0, 0.0, 0.0]),
        ([1, 3, 7, 5], [1.0, 0.0, 0.0]),
    ];
    for (corners, normal) in faces {
        let corners = corners.map(|i| view.place(payload_corner(top, size, i)));
        raster.polygon(&corners, lit([0.45, 0.48, 0.53], normal.into(), view));
    }
}

/// Boundary edges of the fabric.
fn hem(canopy: &Piece) -> Vec<[u32; 2]> {
    let mut edges: Vec<[u32; 2]> = (0..canopy.n_cells())
        .flat_map(|cell| canopy.edges(cell))
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.sort_unstable();
    edges.chunk_by(|a, b| a == b).filter(|same| same.len() == 1).map(|same| same[0]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn view_fits_the_frame_with_correct_orientation() {
        let cube: Vec<Point> = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(f64::from)).collect();
        let view = View::fit(&cube, [30.0, -15.0], [10.0, 20.0], [200.0, 100.0]);
        let [low, high] = bounds(cube.iter().map(|&p| view.place(p)));
        assert!(low[0] > 9.9 && high[0] < 210.1 && low[1] > 19.9 && high[1] < 120.1);
        assert!((high[1] - low[1] - 100.0).abs() < 1e-6, "frame not filled: {low:?} {high:?}");
        let [bottom, top] = [[0.5, 0.5, 0.0], [0.5, 0.5, 1.0]].map(|p| view.place(p));
        assert!(top[1] < bottom[1]);
        // Seen from +x: +y lies to the right.
        let view = View::fit(&cube, [0.0, 0.0], [0.0; 2], [100.0; 2]);
        assert!(view.place([0.5, 1.0, 0.5])[0] > view.place([0.5, 0.0, 0.5])[0]);
        assert!(view.place([1.0, 0.5, 0.5])[2] < view.place([0.0, 0.5, 0.5])[2]);
    }
}
