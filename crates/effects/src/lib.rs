//! The effects of a scene: what each is, which are on, how much they change, what they cost.
//!
//! [`table::TABLE`] is the only place that knows them; the handshake, `ripstop check`,
//! `ripstop effects` and `docs/reference/effects.md` read it.

// An error ends the run: its size is no cost.
#![allow(clippy::result_large_err)]

mod criteria;
pub mod estimate;
pub mod fall;
pub mod numbers;
pub mod rank;
#[cfg(test)]
mod rank_tests;
pub mod report;
pub mod table;
pub mod wind;

use case::{Role, Scene};
pub use rank::{Ranking, Verdict};
pub use table::{Entry, TABLE};

/// An effect of a scene that a program must implement.
pub struct Effect {
    /// Dotted key in the scene.
    pub key: &'static str,
    /// The program that simulates it.
    pub role: Role,
    /// Asked for.
    pub on: bool,
    /// One line for people.
    pub what: &'static str,
}

/// All effects that a program must announce to be given a scene that asks for them.
///
/// # Examples
///
/// ```
/// # use std::path::Path;
/// let scene = case::load(Path::new("../../cases/square-drop/scene.toml"))?;
/// let effects = effects::effects(&scene);
/// let on = |key: &str| effects.iter().any(|e| e.key == key && e.on);
/// assert!(on("fabric.wrinkling") && !on("fabric.contact"));
/// # Ok::<(), case::SceneError>(())
/// ```
pub fn effects(scene: &Scene) -> Vec<Effect> {
    TABLE
        .iter()
        .filter_map(|e| Some(Effect { key: e.key, role: e.announced_by?, on: (e.on)(scene), what: e.what }))
        .collect()
}
