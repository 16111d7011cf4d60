//! Vectors and matrices of space.
//!
//! What travels between ranks or programs or lies in files is `[f64; 3]`; `Vec3::from` of one costs nothing.

/// A point or vector.
pub type Vec3 = nalgebra::Vector3<f64>;

/// A matrix of space; of a velocity gradient the row is the direction, the column the component.
pub type Mat3 = nalgebra::Matrix3<f64>;
