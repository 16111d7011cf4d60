//! Closed forms and exact properties. Each test derives its reference value and
//! argues its tolerance.

mod air_bag;
mod bending;
mod cables;
mod common;
mod convergence;
mod elements;
mod energy;
mod explicit;
mod loops;
mod pressure;
mod shapes;
mod tapes;
mod time;
mod vibrations;
mod wrinkling;
