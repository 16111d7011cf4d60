//! Areas, volumes, centres and swept volumes.

pub mod face;
mod metrics;
pub mod vec3;

pub use metrics::{FaceGeometry, FaceMetric, Metrics};
