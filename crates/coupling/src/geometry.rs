//! Geometry of the canopy's faces: quadrilaterals, and triangles that repeat their last node.

pub use mesh::geometry::{Vec3, distinct, quad_area_vector};

/// Mean of the corners.
pub fn centre(corners: &[Vec3; 4]) -> Vec3 {
    let used = if corners[2] == corners[3] { 3 } else { 4 };
    corners[1..used].iter().fold(corners[0], |sum, c| sum + c) / used as f64
}

/// Direction of an area vector; zero where there is no area.
pub fn direction(area: &Vec3) -> Vec3 {
    area / area.norm().max(f64::MIN_POSITIVE)
}

/// Force (N) of a load (`[LOAD_WIDTH]`: pressure jump and traction, Pa) on a face with this area vector.
pub fn face_force(area: &Vec3, load: &[f64]) -> Vec3 {
    area * load[0] + Vec3::new(load[1], load[2], load[3]) * area.norm()
}

/// Vector `node` of `values`, `[nodes][3]`.
pub fn at(values: &[f64], node: u32) -> Vec3 {
    Vec3::from_column_slice(&values[3 * node as usize..3 * node as usize + 3])
}
