//! Prescribed motions of nodes.

/// A displacement history of some components of some nodes.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Components that move, as local numbers `3 node + component`.
    pub(crate) dofs: Vec<u32>,
    /// Where they are at the start, m.
    pub(crate) start: Vec<f64>,
    time: Vec<f64>,
    displacement: Vec<[f64; 3]>,
}

impl Motion {
    /// Of `dofs`, now displaced by `start` (m): `displacement` (m) from there at each
    /// `time` (s), ascending and as many, at least one.
    pub(crate) fn new(dofs: Vec<u32>, start: Vec<f64>, time: Vec<f64>, displacement: Vec<[f64; 3]>) -> Self {
        debug_assert!(!time.is_empty() && time.len() == displacement.len());
        Self { dofs, start, time, displacement }
    }

    /// Displacement from the start at time `t` (s): linear between the given times,
    /// constant before and after them. At infinity the last one.
    pub fn at(&self, t: f64) -> [f64; 3] {
        let after = self.time.partition_point(|s| *s <= t);
        if after == 0 {
            return self.displacement[0];
        }
        if after == self.time.len() {
            return self.displacement[after - 1];
        }
        let share = (t - self.time[after - 1]) / (self.time[after] - self.time[after - 1]);
        let (a, b) = (self.displacement[after - 1], self.displacement[after]);
        std::array::from_fn(|i| a[i] + share * (b[i] - a[i]))
    }

    /// Displacement of each of the components at time `t` (s), from the unstressed
    /// positions, m.
    pub(crate) fn values(&self, t: f64) -> impl Iterator<Item = (u32, f64)> {
        let d = self.at(t);
        self.dofs.iter().zip(&self.start).map(move |(&i, s)| (i, s + d[i as usize % 3]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histories_are_linear_between_their_times() {
        let m = Motion::new(vec![5], vec![0.1], vec![1.0, 3.0], vec![[0.0; 3], [0.0, 0.0, 2.0]]);
        assert_eq!(m.at(0.0), [0.0; 3]);
        assert_eq!(m.at(2.0), [0.0, 0.0, 1.0]);
        assert_eq!(m.at(f64::INFINITY), [0.0, 0.0, 2.0]);
        assert_eq!(m.values(1.5).collect::<Vec<_>>(), [(5, 0.6)]);
    }
}
