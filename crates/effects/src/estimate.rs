//! An estimate of what an effect changes in the answer of a scene, with the range that it promises.

use case::{Canopy, Scene};

use super::fall::{Fall, Influence, Motion};
use super::numbers::Numbers;
use super::wind::Wind;

/// Share of the answer from which an effect matters.
pub const WORTH: f64 = 0.01;
/// Absolute part of every promise, as a share of the answer: what is smaller is not distinguished.
pub const RESOLUTION: f64 = 1e-3;
/// The added mass is known within this factor.
const ADDED_MASS_FACTOR: f64 = 2.0;

/// A relative change of a quantity, with the effect over without it, less one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amount {
    /// The estimate.
    pub value: f64,
    /// The least and the largest change that the estimate promises.
    pub range: [f64; 2],
    /// The same where the effect acts in the opposite direction, if its direction is not known.
    pub opposite: Option<[f64; 2]>,
}

impl Amount {
    /// The largest size that the estimate allows.
    pub fn most(&self) -> f64 {
        self.ranges().flatten().fold(0.0, |m, x| m.max(x.abs()))
    }

    /// The least size that the estimate allows.
    pub fn least(&self) -> f64 {
        let least = |[low, high]: [f64; 2]| if low * high <= 0.0 { 0.0 } else { low.abs().min(high.abs()) };
        self.ranges().map(least).fold(f64::INFINITY, f64::min)
    }

    fn ranges(&self) -> impl Iterator<Item = [f64; 2]> {
        std::iter::once(self.range).chain(self.opposite)
    }

    /// Whether a measured change, known to `noise`, lies in the range; `signed`: with its sign.
    pub fn agrees(&self, measured: f64, noise: f64, signed: bool) -> bool {
        let slack = noise + RESOLUTION;
        let inside = |x: f64| self.ranges().any(|[low, high]| x >= low - slack && x <= high + slack);
        inside(measured) || (!signed && inside(-measured))
    }
}

/// An estimate.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Change of descent speed, drag and line tension; `None`: the stage has no such quantity.
    pub changes: [Option<Amount>; 3],
    /// The factor within which what the effect does at a fixed speed is estimated.
    pub factor: f64,
    /// Whether the direction of the change is part of the estimate.
    pub signed: bool,
    /// The figures behind it.
    pub why: String,
}

impl Estimate {
    /// The largest of the estimated changes.
    pub fn size(&self) -> f64 {
        self.changes.iter().flatten().map(|a| a.value.abs()).fold(0.0, f64::max)
    }

    /// The largest change that the estimate allows.
    pub fn most(&self) -> f64 {
        self.changes.iter().flatten().map(Amount::most).fold(0.0, f64::max)
    }
}

/// What is known of an effect in a scene.
#[derive(Clone, Debug, PartialEq)]
pub enum Assessment {
    /// How much it changes.
    Estimated(Estimate),
    /// No estimate can be made from the scene, for this reason.
    NotAssessed(String),
}

impl Assessment {
    /// No estimate, with the reason.
    pub fn not(why: impl Into<String>) -> Self {
        Self::NotAssessed(why.into())
    }

    /// The estimate, if there is one.
    pub fn estimate(&self) -> Option<&Estimate> {
        match self {
            Self::Estimated(e) => Some(e),
            Self::NotAssessed(_) => None,
        }
    }
}

/// A scene as the estimates see it.
pub struct Scope<'a> {
    /// Its numbers.
    pub n: &'a Numbers<'a>,
    /// Its quasi-steady fall.
    pub fall: Fall,
    /// The stage whose answer is estimated.
    pub stage: usize,
}

/// How well an influence is known.
pub struct Certainty {
    /// Factor, above 1.
    pub factor: f64,
    /// Whether its direction is known too.
    pub signed: bool,
}

impl<'a> Scope<'a> {
    /// Of stage `stage` of the scene of `n`, of which `windows` windows are run (all where `None`).
    pub fn new(n: &'a Numbers<'a>, stage: usize, windows: Option<u64>) -> Self {
        Self { n, fall: Fall::new(n, stage, windows), stage }
    }

    /// The scene.
    pub fn scene(&self) -> &'a Scene {
        self.n.scene
    }

    /// Whether the canopy is a bluff body in a free stream, as the estimates of its drag assume.
    pub fn bluff(&self) -> Result<(), String> {
        match &self.scene().canopy {
            Canopy::Panel(_) => Err("a panel in a box is no bluff body in a free stream".into()),
            Canopy::AirBag(_) => Err("a closed bag stands in no stream".into()),
            _ if self.scene().grid_file().is_some() => {
                Err("the flow grid comes from a file: whether the stream is free is not known".into())
            }
            _ if self.fall.motion == Motion::NoAir => Err("the last stage has no air".into()),
            _ if self.n.speed <= 0.0 => Err("no stream is given (no descent speed, no wind)".into()),
            _ => Ok(()),
        }
    }

    /// The estimate of an influence.
    pub fn of(&self, influence: &Influence, certainty: &Certainty, why: String) -> Assessment {
        let wind = &self.fall.wind;
        self.evaluate(certainty, why, |fall, factor| {
            let with = fall.answer(&influence.times(factor), wind);
            (with, fall.answer(&Influence::default(), wind))
        })
    }

    /// The estimate of what makes `without` the wind of the scene.
    pub fn of_wind(&self, without: &Wind, certainty: &Certainty, why: String) -> Assessment {
        self.evaluate(certainty, why, |fall, factor| {
            let none = Influence::default();
            let mut with = fall.answer(&none, &fall.wind);
            let base = fall.answer(&none, without);
            for (w, b) in with.iter_mut().zip(&base) {
                if let (Some(w), Some(b)) = (w, b) {
                    *w = *b + factor * (*w - *b);
                }
            }
            (with, base)
        })
    }

    /// Answers with and without the effect, over all corners of what is uncertain: the influence and the
    /// added mass.
    fn evaluate(
        &self,
        certainty: &Certainty,
        why: String,
        answers: impl Fn(&Fall, f64) -> ([Option<f64>; 3], [Option<f64>; 3]),
    ) -> Assessment {
        let mut changes: [Option<Amount>; 3] = [None; 3];
        for air in [1.0, 1.0 / ADDED_MASS_FACTOR, ADDED_MASS_FACTOR] {
            let mut fall = self.fall.clone();
            fall.added_mass *= air;
            let sizes = [1.0, 1.0 / certainty.factor, certainty.factor];
            let opposite = sizes.iter().map(|f| -f).filter(|_| !certainty.signed);
            for factor in sizes.into_iter().chain(opposite) {
                let (with, without) = answers(&fall, factor);
                for (q, change) in changes.iter_mut().enumerate() {
                    let (Some(with), Some(without)) = (with[q], without[q]) else { continue };
                    if without.abs() <= f64::MIN_POSITIVE || !(with / without).is_finite() {
                        continue;
                    }
                    let x = with / without - 1.0;
                    match change {
                        None => *change = Some(Amount { value: x, range: [x, x], opposite: None }),
                        Some(a) if factor > 0.0 => a.range = wider(a.range, x),
                        Some(a) => a.opposite = Some(a.opposite.map_or([x, x], |range| wider(range, x))),
                    }
                }
            }
        }
        if changes.iter().all(Option::is_none) {
            return Assessment::not("the last stage has no speed, drag or line tension that could change");
        }
        Assessment::Estimated(Estimate { changes, factor: certainty.factor, signed: certainty.signed, why })
    }
}

fn wider(range: [f64; 2], x: f64) -> [f64; 2] {
    [range[0].min(x), range[1].max(x)]
}

/// A relative change for people.
pub fn percent(share: f64) -> String {
    let p = 100.0 * share;
    if p == 0.0 {
        "0 %".into()
    } else if p.abs() < 0.01 {
        format!("{p:.0e} %")
    } else if p.abs() < 10.0 {
        format!("{p:.2} %")
    } else {
        format!("{p:.0} %")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The sign counts where it is promised; noise and resolution widen the range.
    #[test]
    fn a_measurement_agrees_in_the_range_alone() {
        let a = Amount { value: 0.03, range: [0.01, 0.09], opposite: None };
        for (measured, noise, signed, agrees) in [
            (0.05, 0.0, true, true),
            (-0.05, 0.0, true, false),
            (-0.05, 0.0, false, true),
            (0.095, 0.0, true, false),
            (0.095, 0.005, true, true),
            // A thousandth of the answer beyond either end.
            (0.0091, 0.0, true, true),
            (0.0089, 0.0, true, false),
            (0.0909, 0.0, true, true),
            (0.0911, 0.0, true, false),
            (0.0, 0.0, true, false),
        ] {
            assert_eq!(a.agrees(measured, noise, signed), agrees, "{measured} {noise} {signed}");
        }
        // A known part of -10 % and an unknown one of 1 to 4 % either way.
        let b = Amount { value: -0.12, range: [-0.14, -0.11], opposite: Some([-0.09, -0.06]) };
        assert!(b.agrees(-0.08, 0.0, false) && b.agrees(-0.12, 0.0, false) && !b.agrees(-0.1, 0.0, false));
        assert!((b.least() - 0.06).abs() < 1e-15 && (b.most() - 0.14).abs() < 1e-15);
    }
}
