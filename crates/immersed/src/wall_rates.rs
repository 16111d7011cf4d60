//! What pressure and surface change at the values next to a surface.

use std::ops::Range;
use std::rc::Rc;

use crate::slabs::Ranks;

/// A value next to a surface: its component, and its position in the array.
pub type WallValue = (u8, u32);

/// Rates of change of the velocity by pressure and pressure jumps in a step, m/s2, at the values next to a surface: the force that the friction of the next step expects
/// ([`crate::friction`]). Values that were not next to the surface have the rate zero.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WallRates {
    /// Component and position of each value, ascending.
    values: Vec<WallValue>,
    rates: Vec<f64>,
}

impl WallRates {
    /// Of values with their component and position, ascending.
    ///
    /// # Panics
    /// Another number of rates, or values in another order.
    pub fn new(values: Vec<WallValue>, rates: Vec<f64>) -> Self {
        assert!(values.len() == rates.len() && values.is_sorted(), "a rate for each value, in their order");
        Self { values, rates }
    }

    /// Component, position and rate of each value.
    pub fn iter(&self) -> impl Iterator<Item = (WallValue, f64)> + '_ {
        self.values.iter().copied().zip(self.rates.iter().copied())
    }

    /// Rate of a value.
    pub(crate) fn of(&self, value: WallValue) -> f64 {
        self.values.binary_search(&value).map_or(0.0, |found| self.rates[found])
    }

    /// Those of all ranks; a rank has the positions `own`, and perhaps others from an earlier call.
    pub(crate) fn gather(&mut self, ranks: &Rc<dyn Ranks>, own: &Range<usize>) {
        let owned: Vec<_> = self.iter().filter(|((_, at), _)| own.contains(&(*at as usize))).collect();
        let mut counts = vec![0.0; ranks.size()];
        counts[ranks.rank()] = owned.len() as f64;
        ranks.sum(&mut counts);
        let up_to = |rank: usize| counts[..rank].iter().map(|count| 3 * *count as usize).sum();
        let ends: Vec<usize> = (1..=ranks.size()).map(up_to).collect();
        let mut all = vec![0.0; ends[ranks.size() - 1]];
        let place = up_to(ranks.rank())..ends[ranks.rank()];
        for (numbers, ((component, at), rate)) in all[place].chunks_exact_mut(3).zip(owned) {
            numbers.copy_from_slice(&[f64::from(component), f64::from(at), rate]);
        }
        ranks.gather(&mut all, &ends);
        let mut found: Vec<(WallValue, f64)> =
            all.chunks_exact(3).map(|n| ((n[0] as u8, n[1] as u32), n[2])).collect();
        found.sort_by_key(|(value, _)| *value);
        (self.values, self.rates) = found.into_iter().unzip();
    }
}
