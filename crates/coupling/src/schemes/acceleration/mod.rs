//! Acceleration of the coupling iteration, and relaxation of the part of the residual that no column spans.

pub mod accelerator;
pub mod added_mass;
pub mod fixed_point;
pub mod jacobi_relaxation;
pub mod jacobian;
pub mod quasi_newton;
pub mod quasi_newton_options;
pub mod relaxation;
