//! Pattern files: flat panels and how they are sewn into a canopy.
//!
//! A file is read for its keys and types here; whether its panels can be sewn is judged where they are meshed.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

/// The contents of a pattern file. Lengths are in m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pattern {
    /// Flat panels.
    #[serde(rename = "panel")]
    pub panels: Vec<PatternPanel>,
    /// Pairs of edges that are sewn together.
    #[serde(default, rename = "seam")]
    pub seams: Vec<Seam>,
    /// Points from which suspension lines run.
    #[serde(default, rename = "attachment")]
    pub attachments: Vec<Attachment>,
    /// Edges or points that are held in space.
    #[serde(default, rename = "hold")]
    pub holds: Vec<Hold>,
    /// Edges along which the tape of `[tapes.hem]` runs, as `panel.edge`.
    #[serde(default)]
    pub hem: Vec<String>,
    /// Edges along which the tape of `[tapes.vents]` runs, as `panel.edge`.
    #[serde(default)]
    pub vents: Vec<String>,
}

/// A flat panel, cut once or several times.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PatternPanel {
    /// Name, without a dot.
    pub name: String,
    /// Equal panels of this outline, each turned by an equal part of a turn about the z axis.
    #[serde(default = "one")]
    pub copies: u32,
    /// Edges of the outline, counter-clockwise in the drawing.
    #[serde(rename = "edge")]
    pub edges: Vec<PatternEdge>,
    /// The side from which the drawing is seen.
    #[serde(default)]
    pub seen_from: Side,
    /// Direction of the warp in the drawing, degrees counter-clockwise from its x axis.
    #[serde(default = "quarter")]
    pub warp_deg: f64,
    /// Where the panel starts in space.
    pub start: PanelStart,
}

/// An edge of a panel: between two corners, or around the whole panel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PatternEdge {
    /// Name, without a dot.
    pub name: String,
    /// Points of the edge from its first corner on, m. It ends at the first point of the next edge. A curve is a polyline with points much closer than the elements.
    pub points_m: Vec<[f64; 2]>,
}

/// A side of the fabric.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Side {
    /// The outer side, out of the canopy.
    #[default]
    Outside,
    /// The inner side.
    Inside,
}

impl Side {
    /// Factor on x of a drawing that makes it one seen from outside.
    pub fn mirror(self) -> f64 {
        match self {
            Side::Outside => 1.0,
            Side::Inside => -1.0,
        }
    }
}

/// Where the first copy of a panel starts in space. Seams join the panels and remove tension from there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PanelStart {
    /// Flat: position of the drawing's origin, m, with `x_axis` and `y_axis`.
    pub origin_m: Option<[f64; 3]>,
    /// Direction of the drawing's x axis in space.
    pub x_axis: Option<[f64; 3]>,
    /// Direction of the drawing's y axis in space, normal to `x_axis`.
    pub y_axis: Option<[f64; 3]>,
    /// Around the z axis: distance from the axis and height of points of a meridian from below to the crown, m. The drawing's y is the length along it, x runs around the axis.
    pub meridian_m: Option<Vec<[f64; 2]>>,
    /// Angle of the drawing's line x = 0 about the z axis, degrees; of the first copy.
    #[serde(default)]
    pub turn_deg: f64,
}

/// Two edges that are sewn together, the start of one to the end of the other. The longer one is gathered evenly onto the shorter one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seam {
    /// The edges, as `panel.edge`.
    pub edges: [String; 2],
    /// The second edge is that of the next copy.
    #[serde(default)]
    pub next_copy: bool,
    /// Numbers of the two copies, from 0, that this seam joins; absent: all copies.
    pub copies: Option<[u32; 2]>,
    /// Whether the tape of `[tapes.seams]` runs along it.
    #[serde(default = "yes")]
    pub tape: bool,
}

/// A point of each copy of an edge from which a suspension line runs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Attachment {
    /// The edge, as `panel.edge`.
    pub edge: String,
    /// Place along the edge as a share of its length from its start.
    pub at: f64,
}

/// An edge of each copy of a panel, or a point of it, that is held in space.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hold {
    /// The edge, as `panel.edge`.
    pub edge: String,
    /// Place along the edge as a share of its length from its start; absent: the whole edge.
    pub at: Option<f64>,
    /// Components that are held: some of the letters x, y and z.
    #[serde(default = "all_components")]
    pub components: String,
}

fn one() -> u32 {
    1
}

fn quarter() -> f64 {
    90.0
}

fn yes() -> bool {
    true
}

fn all_components() -> String {
    "xyz".into()
}

/// A pattern file that cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum PatternFileError {
    /// The file system.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// Its keys or types.
    #[error("{}: {reason}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Line, key and cause.
        reason: String,
    },
}

impl Pattern {
    /// Reads a pattern file.
    ///
    /// # Errors
    /// A file that is missing, no TOML, or has wrong keys or types.
    pub fn read(path: &Path) -> Result<Self, PatternFileError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| PatternFileError::Io { path: path.into(), source })?;
        toml::from_str(&text).map_err(|e| {
            let place = e.span().map(|s| crate::error::line_and_column(&text, s.start));
            let at = place.map_or(String::new(), |(line, column)| format!("line {line}, column {column}: "));
            PatternFileError::Content {
                path: path.into(),
                reason: format!(
                    "{at}{}; the how-to \"canopy from a pattern\" has all keys",
                    e.message().trim_end()
                ),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(text: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pattern.toml");
        std::fs::write(&path, text).unwrap();
        Pattern::read(&path).unwrap_err().to_string()
    }

    /// Every key of a pattern file stands in its how-to page: an unknown key is refused with all keys of its table.
    #[test]
    fn all_keys_are_documented() {
        let page = include_str!("../../../docs/how-to/canopy-from-a-pattern.md");
        for table in [
            "",
            "[[panel]]\n",
            "[[panel]]\n[[panel.edge]]\n",
            "[[panel]]\n[panel.start]\n",
            "[[seam]]\n",
            "[[attachment]]\n",
            "[[hold]]\n",
        ] {
            let text = message(&format!("{table}strange = 1\n"));
            let (_, keys) = text.split_once("expected").unwrap_or_else(|| panic!("{text}"));
            let keys: Vec<&str> = keys.split('`').skip(1).step_by(2).collect();
            assert!(keys.len() >= 2, "{text}");
            for key in keys {
                let named = [format!("`{key}`"), format!("`[[{key}]]`"), format!("`[[panel.{key}]]`")];
                assert!(named.iter().any(|n| page.contains(n.as_str())), "{table}{key} is not documented");
            }
        }
    }

    #[test]
    fn errors_name_the_place() {
        let text = message("[[panel]]\nname = \"a\"\ncopies = \"two\"\n");
        assert!(text.contains("pattern.toml: line 3, column 10") && text.contains("\"two\""), "{text}");
        let missing = Pattern::read(Path::new("/none.toml")).unwrap_err().to_string();
        assert!(missing.contains("/none.toml"), "{missing}");
    }
}
