//! A coupling time window: its state, its solvers, the interface of a scheme, the criterion and the loop.

pub mod criterion;
pub mod load_shape;
pub mod report;
pub mod scheme;
pub mod solvers;
pub mod state;
pub mod stopping;
pub mod values;
pub mod window_loop;
