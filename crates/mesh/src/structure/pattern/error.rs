//! What makes a pattern that cannot be cut, sewn or meshed.

use crate::Point;

/// A pattern that cannot be cut, sewn or meshed: panel, edge, value, and what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PatternError {
    /// A panel whose keys have no meaning.
    #[error("panel \"{panel}\": {reason}")]
    Panel {
        /// Its name.
        panel: String,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// An edge that cannot be cut.
    #[error("panel \"{panel}\", edge \"{edge}\": {reason}")]
    Edge {
        /// Name of the panel.
        panel: String,
        /// Name of the edge.
        edge: String,
        /// What is wrong, and what to do.
        reason: String,
    },
    /// An outline in the wrong sense.
    #[error(
        "panel \"{panel}\": the outline runs clockwise around {area:.4} m2; list edges and points counter-clockwise, and set \
         seen_from = \"inside\" if the drawing shows the inner side"
    )]
    Clockwise {
        /// Name of the panel.
        panel: String,
        /// Area of the outline, m2.
        area: f64,
    },
    /// An outline that crosses or touches itself.
    #[error(
        "panel \"{panel}\": the edges \"{}\" and \"{}\" cross or touch near ({:.4}, {:.4}) m; correct their points, or use smaller \
         elements where the divided curves cross", edges[0], edges[1], at[0], at[1]
    )]
    Crossing {
        /// Name of the panel.
        panel: String,
        /// Names of the edges.
        edges: [String; 2],
        /// Where, m.
        at: [f64; 2],
    },
    /// A panel that has no mesh of this element size.
    #[error(
        "panel \"{panel}\": the triangle at ({:.4}, {:.4}) m has the quality {quality:.2e} (1: equilateral, at least {least} needed); \
         change canopy.element_size_m, or remove corners that are nearer to each other than it", at[0], at[1]
    )]
    Thin {
        /// Name of the panel.
        panel: String,
        /// Middle of the triangle, m.
        at: [f64; 2],
        /// Its quality.
        quality: f64,
        /// Least quality that is accepted.
        least: f64,
    },
    /// A name that no edge has.
    #[error("{key}: there is no edge \"{name}\" (panel.edge); available: {}", edges.join(", "))]
    UnknownEdge {
        /// Where the file says so.
        key: String,
        /// The name.
        name: String,
        /// Names of all edges.
        edges: Vec<String>,
    },
    /// A seam that cannot be sewn.
    #[error("seam[{seam}] of \"{}\" and \"{}\": {reason}", edges[0], edges[1])]
    Seam {
        /// Number of the seam, from 0.
        seam: usize,
        /// Its edges.
        edges: [String; 2],
        /// What is wrong, and what to do.
        reason: String,
    },
    /// Three panels at one edge.
    #[error(
        "edge \"{edge}\" of copy {copy} is sewn by seam[{}] and seam[{}]: at most two panels meet at an edge; remove one of them",
        seams[0], seams[1]
    )]
    SewnTwice {
        /// The edge.
        edge: String,
        /// Copy of its panel.
        copy: usize,
        /// Numbers of the seams.
        seams: [usize; 2],
    },
    /// Panels that no seam joins.
    #[error(
        "copy {copy} of panel \"{panel}\" is not joined with the first panel by seams: add the missing [[seam]]"
    )]
    Apart {
        /// Name of the panel.
        panel: String,
        /// The copy.
        copy: usize,
    },
    /// A seam that joins nodes of one triangle, or more than two triangles on one edge.
    #[error(
        "the seams fold panel \"{panel}\" (copy {copy}) onto itself at ({:.4}, {:.4}) m of its drawing: {reason}; use smaller elements, or \
         correct the seams", at[0], at[1]
    )]
    Folded {
        /// Name of the panel.
        panel: String,
        /// The copy.
        copy: usize,
        /// Where, m, as seen from outside.
        at: [f64; 2],
        /// What is wrong.
        reason: &'static str,
    },
    /// A start that stays stretched.
    #[error(
        "panel \"{panel}\" (copy {copy}) starts stretched by {stretch:.3} of its flat shape near {at:?} m after {iterations} iterations \
         (at most {limit} allowed): place the panels nearer to the assembled shape by `start`"
    )]
    Stretched {
        /// Name of the panel.
        panel: String,
        /// The copy.
        copy: usize,
        /// Largest principal stretch.
        stretch: f64,
        /// Largest one that is allowed.
        limit: f64,
        /// Iterations done.
        iterations: usize,
        /// Where it starts in space, m.
        at: Point,
    },
    /// Attachments, holds or tapes.
    #[error("{key}: {reason}")]
    Entry {
        /// Where the file says so.
        key: String,
        /// What is wrong, and what to do.
        reason: String,
    },
}
