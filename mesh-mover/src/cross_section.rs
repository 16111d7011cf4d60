//! Picture of a cross-section of the grid, coloured by the quality of the cells.

use std::fmt::Write;

use crate::local::{EDGES, LocalGrid};

/// An SVG picture of this rank's cells in the plane y = `y`, within `half` of (`centre` x, `centre` z), m: red at a
/// scaled Jacobian of 0, yellow at 1/3, light blue at 1. The canopy's faces appear as outlines of their cells.
pub fn cross_section(grid: &LocalGrid, x: &[f64], y: f64, centre: [f64; 2], half: f64) -> String {
    const SIZE: f64 = 900.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {SIZE} {SIZE}\" stroke=\"#333\" \
         stroke-width=\"0.4\">\n<rect width=\"{SIZE}\" height=\"{SIZE}\" fill=\"#fff\" stroke=\"none\"/>\n"
    );
    for c in 0..grid.cells.len() {
        let p = grid.corners(c, x);
        let mut points: Vec<[f64; 2]> = Vec::new();
        for (i, j) in EDGES {
            let (a, b) = (p[i][1] - y, p[j][1] - y);
            if (a < 0.0) != (b < 0.0) {
                let s = a / (a - b);
                let at = |k: usize| p[i][k] + s * (p[j][k] - p[i][k]);
                points.push([at(0) - centre[0], at(2) - centre[1]]);
            }
        }
        if points.len() < 3 || points.iter().flatten().any(|v| v.abs() > half) {
            continue;
        }
        let n = points.len() as f64;
        let mean = [0, 1].map(|k| points.iter().map(|q| q[k]).sum::<f64>() / n);
        let angle = |q: &[f64; 2]| (q[1] - mean[1]).atan2(q[0] - mean[0]);
        points.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        let pixel = |v: f64| (v / half + 1.0) * 0.5 * SIZE;
        svg += "<path d=\"";
        for (k, q) in points.iter().enumerate() {
            let _ =
                write!(svg, "{}{:.1} {:.1}", if k == 0 { "M" } else { "L" }, pixel(q[0]), SIZE - pixel(q[1]));
        }
        let [r, g, b] = colour(grid.quality(c, x));
        let _ = writeln!(svg, "Z\" fill=\"#{r:02x}{g:02x}{b:02x}\"/>");
    }
    svg + "</svg>\n"
}

fn colour(q: f64) -> [u8; 3] {
    let stops = [[220.0, 40.0, 40.0], [250.0, 220.0, 90.0], [225.0, 238.0, 250.0]];
    let (from, s) = if q < 1.0 / 3.0 { (0, 3.0 * q.max(0.0)) } else { (1, 1.5 * (q.min(1.0) - 1.0 / 3.0)) };
    [0, 1, 2].map(|k| (stops[from][k] + s * (stops[from + 1][k] - stops[from][k])) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_intersected_cell_is_drawn_once() {
        let n = 8;
        let grid = crate::example_grid::plate_in_box(n, 0.0, 1.0, false);
        let local = LocalGrid::new(&grid, &vec![0; grid.coords.len()], &comm::Comm::solo());
        let svg = cross_section(&local, &local.gather(&grid.coords), 0.1, [0.0, 0.0], 1.01);
        assert_eq!(svg.matches("<path").count(), n * n);
        // Squares: right angles, the colour of 1.
        assert_eq!(svg.matches("#e1eefa").count(), n * n);
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n"));
    }
}
