//! The ranks of the flow-solver as those of an immersed flow.

use comm::Comm;
use immersed::slabs::Ranks;

/// Ranks of the flow-solver.
#[derive(Clone, Debug)]
pub struct FlowRanks(pub Comm);

fn counts(of: &[usize]) -> Vec<i32> {
    of.iter().map(|n| *n as i32).collect()
}

impl Ranks for FlowRanks {
    fn rank(&self) -> usize {
        self.0.rank()
    }

    fn size(&self) -> usize {
        self.0.size()
    }

    fn sum(&self, values: &mut [f64]) {
        self.0.sum_slice(values);
    }

    fn largest(&self, values: &mut [f64]) {
        self.0.max_slice(values);
    }

    fn all_to_all(&self, send: &[f64], sent: &[usize], receive: &mut [f64], received: &[usize]) {
        self.0.all_to_all_into(send, &counts(sent), receive, &counts(received));
    }

    fn shift(&self, up: bool, send: &[f64], receive: &mut [f64]) {
        self.0.shift(up, send, receive);
    }

    fn gather(&self, values: &mut [f64], ends: &[usize]) {
        self.0.all_gather_in_place(values, ends);
    }
}
