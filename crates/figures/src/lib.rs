//! Charts of histories and studies, and rendered pictures of canopy and flow.
//!
//! All text and lines are drawn by `plotters` with one embedded font (`font`), so a figure is the same on
//! every machine. [`chart`] draws curves, bars and maps as SVG and PNG; [`picture`] renders canopy and flow.

// An error ends the run once, so its size does not matter.
#![allow(clippy::result_large_err)]

mod animated_png;
pub mod chart;
pub mod colour;
mod colour_bar;
mod font;
mod gif_file;
mod palette;
pub mod picture;
mod pixels;
pub mod plot;
mod sheet;
pub mod snapshots;
