//! Sets of numbers that are joined pair by pair.

/// Disjoint sets of the numbers from 0.
pub(super) struct Union(Vec<usize>);

impl Union {
    /// Of `n` numbers, each a set of its own.
    pub fn new(n: usize) -> Self {
        Self((0..n).collect())
    }

    /// The least number of the set of `i`.
    pub fn root(&mut self, i: usize) -> usize {
        let mut at = i;
        while self.0[at] != at {
            self.0[at] = self.0[self.0[at]];
            at = self.0[at];
        }
        at
    }

    /// Joins the sets of two numbers.
    pub fn join(&mut self, a: usize, b: usize) {
        let [a, b] = [self.root(a), self.root(b)];
        self.0[a.max(b)] = a.min(b);
    }
}
