//! Refusals: a value that no solver could work with, by the path of its key.

use std::ops::RangeInclusive;

/// A refused value by its dotted path.
pub(crate) struct Refusal {
    pub path: String,
    pub what: String,
    pub help: String,
}

/// The smallest of the numbers that must be positive: products of smaller ones are zero.
const SMALLEST: f64 = 1e-60;

/// The range that a value of a scene is compared with.
#[derive(Clone, Debug, PartialEq)]
pub struct Allowed {
    /// Dotted path of the key, such as `stage[0].substeps`.
    pub path: String,
    /// Smallest and largest value.
    pub range: [f64; 2],
    /// Whether the smallest value itself is allowed.
    pub includes_smallest: bool,
    /// What the value is, or why the range ends there.
    pub why: String,
}

/// The refusals of a scene, in the order in which its sections find them.
#[derive(Default)]
pub(crate) struct Check {
    /// Found so far.
    pub(crate) refusals: Vec<Refusal>,
    /// Ranges of the values that were compared with one, for the reference of keys.
    pub(crate) allowed: Vec<Allowed>,
}

impl Check {
    /// Refuses the value at `path`: what is wrong, and what to do.
    pub(crate) fn refuse(&mut self, path: &str, what: impl Into<String>, help: impl Into<String>) {
        self.refusals.push(Refusal { path: path.into(), what: what.into(), help: help.into() });
    }

    fn note(&mut self, path: &str, range: [f64; 2], includes_smallest: bool, why: &str) {
        self.allowed.push(Allowed { path: path.into(), range, includes_smallest, why: why.into() });
    }

    /// Refuses `value` outside of `allowed`.
    pub(crate) fn range(&mut self, path: &str, value: f64, allowed: RangeInclusive<f64>, why: &str) {
        self.note(path, [*allowed.start(), *allowed.end()], true, why);
        if !allowed.contains(&value) {
            self.outside(path, value, "from", allowed, why);
        }
    }

    /// Refuses `value` outside of `allowed`, whose lower end is refused too.
    pub(crate) fn above(&mut self, path: &str, value: f64, allowed: RangeInclusive<f64>, why: &str) {
        self.note(path, [*allowed.start(), *allowed.end()], false, why);
        if !(value > *allowed.start() && value <= *allowed.end()) {
            self.outside(path, value, "above", allowed, why);
        }
    }

    fn outside(&mut self, path: &str, value: f64, from: &str, allowed: RangeInclusive<f64>, why: &str) {
        let (low, high) = allowed.into_inner();
        self.refuse(path, format!("`{path}` is {value}"), format!("allowed: {from} {low} to {high}; {why}"));
    }

    /// Refuses `value` that is not positive or exceeds `high`.
    pub(crate) fn positive(&mut self, path: &str, value: f64, high: f64, why: &str) {
        if value > 0.0 && value < SMALLEST {
            self.refuse(
                path,
                format!("`{path}` is {value:e}"),
                format!("allowed: {SMALLEST:e} and more; {why}"),
            );
            return;
        }
        self.above(path, value, 0.0..=high, why);
    }

    /// Refuses a count outside of `allowed`.
    pub(crate) fn count(&mut self, path: &str, value: u32, allowed: RangeInclusive<u32>, why: &str) {
        self.note(path, [f64::from(*allowed.start()), f64::from(*allowed.end())], true, why);
        if !allowed.contains(&value) {
            let (low, high) = allowed.into_inner();
            self.refuse(path, format!("`{path}` is {value}"), format!("allowed: {low} to {high}; {why}"));
        }
    }

    /// Refuses `values` with an infinity or what is not a number: `what` they are, in which unit `help` says.
    pub(crate) fn finite(&mut self, path: &str, values: &[f64], what: &str, help: &str) {
        if !values.iter().all(|v| v.is_finite()) {
            self.refuse(path, format!("{what} is not a number"), help);
        }
    }
}

/// Remedy for a name that is not valid.
pub(crate) const NAME_OF_FOLDER: &str =
    "use letters, digits, `-`, `_` and `.`: it becomes the name of a folder";

/// Whether `name` can be the name of a file or folder.
pub(crate) fn plain_name(name: &str) -> bool {
    !name.is_empty()
        && name.len() <= 64
        && !name.starts_with('.')
        && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_.".contains(c))
}
