//! Places that flow programs report in their statistics.

/// The place (m) whose first coordinate has `index` in the statistics of the flow; `None` where it was not reported.
pub fn reported_place(values: &[f64], index: usize) -> Option<[f64; 3]> {
    let at = std::array::from_fn(|c| values[index + c]);
    (at != [0.0; 3]).then_some(at)
}

/// ` at (x, y, z) m` for messages, with the coordinates `at` (m), or nothing.
pub fn at_text(at: Option<[f64; 3]>) -> String {
    at.map_or_else(String::new, |[x, y, z]| format!(" at ({x:.4}, {y:.4}, {z:.4}) m"))
}
