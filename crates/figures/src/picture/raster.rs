//! Rasterisation of triangles with a depth buffer and supersampling.

use crate::colour::{PAPER, Rgb};
use crate::pixels::{FINE, Samples};

/// A point in the picture: pixels right and down, and depth.
pub(super) type Position = [f64; 3];

/// The raster: colours and depths of the samples.
pub(super) struct Raster {
    samples: Samples,
    depth: Vec<f32>,
}

fn bytes(colour: Rgb) -> [u8; 3] {
    colour.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8)
}

/// Twice the signed area of the triangle `a b c`.
fn cross(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

impl Raster {
    /// An empty picture.
    pub(super) fn new(width: u32, height: u32) -> Self {
        let samples = Samples::new([width, height], PAPER);
        let depth = vec![f32::INFINITY; samples.rgb.len()];
        Self { samples, depth }
    }

    /// Width and height, pixels.
    pub(super) fn size(&self) -> [f64; 2] {
        self.samples.size().map(f64::from)
    }

    /// Draws a triangle with linear interpolation of its corner colours, where it is nearest.
    pub(super) fn triangle(&mut self, corners: [Position; 3], colours: [Rgb; 3]) {
        let fine = f64::from(FINE);
        let [width, height] = self.samples.size().map(|s| (s * FINE) as usize);
        let p = corners.map(|c| [c[0] * fine, c[1] * fine]);
        let area = cross(p[0], p[1], p[2]);
        if !area.is_finite() || area == 0.0 || corners.iter().any(|c| !c[2].is_finite()) {
            return;
        }
        let range = |axis: usize, limit: usize| {
            let low = p.iter().map(|q| q[axis]).fold(f64::INFINITY, f64::min);
            let high = p.iter().map(|q| q[axis]).fold(f64::NEG_INFINITY, f64::max);
            let limit = limit as f64;
            let clip = |x: f64| x.clamp(0.0, limit) as usize;
            clip((low - 0.5).ceil())..clip((high - 0.5).floor() + 1.0)
        };
        for row in range(1, height) {
            for column in range(0, width) {
                let at = [column as f64 + 0.5, row as f64 + 0.5];
                let w = [cross(p[1], p[2], at) / area, cross(p[2], p[0], at) / area];
                let w = [w[0], w[1], 1.0 - w[0] - w[1]];
                if w.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let sample = row * width + column;
                let depth = (w[0] * corners[0][2] + w[1] * corners[1][2] + w[2] * corners[2][2]) as f32;
                if depth <= self.depth[sample] {
                    self.depth[sample] = depth;
                    let part = |c: usize| (0..3).map(|i| w[i] as f32 * colours[i][c]).sum();
                    self.samples.rgb[sample] = bytes([part(0), part(1), part(2)]);
                }
            }
        }
    }

    /// Draws a convex polygon of one colour.
    pub(super) fn polygon(&mut self, corners: &[Position], colour: Rgb) {
        if let [first, rest @ ..] = corners {
            for pair in rest.windows(2) {
                self.triangle([*first, pair[0], pair[1]], [colour; 3]);
            }
        }
    }

    /// Draws a straight line, `width` pixels wide, with square ends.
    pub(super) fn line(&mut self, ends: [Position; 2], width: f64, colour: Rgb) {
        let [a, b] = ends;
        let along = [b[0] - a[0], b[1] - a[1]];
        let length = along[0].hypot(along[1]);
        if length < 1e-9 {
            return;
        }
        let [x, y] = along.map(|d| 0.5 * width * d / length);
        // Longer by half its width, so that no gap opens between two lines that meet.
        let corner = |e: Position, s: f64, t: f64| [e[0] - s * y + t * x, e[1] + s * x + t * y, e[2]];
        let corners =
            [corner(a, 1.0, -1.0), corner(b, 1.0, 1.0), corner(b, -1.0, 1.0), corner(a, -1.0, -1.0)];
        self.polygon(&corners, colour);
    }

    /// The samples, for further drawing and averaging.
    pub(super) fn finish(self) -> Samples {
        self.samples
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixels::Image;

    const RED: Rgb = [1.0, 0.0, 0.0];
    const BLUE: Rgb = [0.0, 0.0, 1.0];

    fn red(image: &Image, x: u32, y: u32) -> u8 {
        image.pixel(x, y)[0]
    }

    #[test]
    fn nearest_triangle_is_visible_in_any_order() {
        let near = [[0.0, 0.0, 1.0], [20.0, 0.0, 1.0], [0.0, 20.0, 1.0]];
        let far = near.map(|[x, y, _]| [x, y, 2.0]);
        for order in [[(near, RED), (far, BLUE)], [(far, BLUE), (near, RED)]] {
            let mut raster = Raster::new(10, 8);
            for (corners, colour) in order {
                raster.triangle(corners, [colour; 3]);
            }
            assert_eq!(red(&raster.finish().average(), 3, 3), 255);
        }
    }

    #[test]
    fn polygons_fill_and_edges_are_smooth() {
        let mut raster = Raster::new(10, 10);
        raster.polygon(&[[0.0, 0.0, 1.0], [10.0, 0.0, 1.0], [10.0, 10.0, 1.0], [0.0, 10.0, 1.0]], [0.0; 3]);
        // Wider than the picture, and ending in the middle of pixel 5.
        let corners = [[-5.0, -5.0, 0.0], [5.5, -5.0, 0.0], [5.5, 50.0, 0.0], [-5.0, 50.0, 0.0]];
        raster.polygon(&corners, RED);
        raster.polygon(&[[f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], BLUE);
        let image = raster.finish().average();
        for y in 0..10 {
            assert_eq!((red(&image, 0, y), red(&image, 4, y), red(&image, 7, y)), (255, 255, 0));
            assert!((60..200).contains(&red(&image, 5, y)));
        }
    }
}
