//! How replies of a program compare with recorded ones: pure functions over arrays.

/// Euclidean norm.
pub(super) fn norm(a: &[f64]) -> f64 {
    a.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// `a - b`.
pub(super) fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(x, y)| x - y).collect()
}

/// What is wrong with replies in two windows, if something is.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Deviation {
    /// Norm over the recorded norm.
    Scale(f64),
    /// The opposite of what is recorded: cosine between them.
    Reversed(f64),
    /// The second reply is that of the first window, or the recorded one of it.
    Late,
    /// Rows whose first value has the opposite sign, where most others agree.
    Rows(Vec<usize>),
}

/// Norms that differ by more than this factor cannot come from another method.
const FACTOR: f64 = 10.0;
/// Cosine between vectors below which one is the opposite of the other.
const OPPOSITE: f64 = -0.5;
/// Distance from the recorded reply of the window before, over the recorded change of a window, below which a reply is late.
const LATE: f64 = 0.1;
/// Largest share of rows that single faults explain.
const FEW: f64 = 0.2;

fn scale(found: &[f64], recorded: &[f64]) -> Option<Deviation> {
    let (a, b) = (norm(found), norm(recorded));
    let ratio = a / b;
    (b > 0.0 && !(1.0 / FACTOR..=FACTOR).contains(&ratio)).then_some(Deviation::Scale(ratio))
}

fn reversed(found: &[f64], recorded: &[f64]) -> Option<Deviation> {
    let product: f64 = found.iter().zip(recorded).map(|(x, y)| x * y).sum();
    let cosine = product / (norm(found) * norm(recorded));
    (cosine < OPPOSITE).then_some(Deviation::Reversed(cosine))
}

/// Rows of `width` values whose first value is the opposite of the recorded one to a third, among those above a tenth of the largest.
fn rows(found: &[f64], recorded: &[f64], width: usize) -> Option<Deviation> {
    let firsts = |a: &[f64]| a.iter().step_by(width).copied().collect::<Vec<_>>();
    let (found, recorded) = (firsts(found), firsts(recorded));
    let largest = recorded.iter().fold(0.0f64, |m, r| m.max(r.abs()));
    let judged: Vec<usize> = (0..found.len()).filter(|i| recorded[*i].abs() > 0.1 * largest).collect();
    let flipped: Vec<usize> = judged
        .iter()
        .copied()
        .filter(|&i| (found[i] + recorded[i]).abs() < recorded[i].abs() / 3.0)
        .collect();
    let few = !flipped.is_empty() && flipped.len() as f64 <= FEW * judged.len() as f64;
    few.then_some(Deviation::Rows(flipped))
}

/// Compares replies in two successive windows with the recorded ones. `values`: a reply is a value (a load) and not a
/// position, of which the change counts. `width`: values in a row.
pub(super) fn deviation(
    found: [&[f64]; 2],
    recorded: [&[f64]; 2],
    values: bool,
    width: usize,
) -> Option<Deviation> {
    let [change, recorded_change] = [found, recorded].map(|[a, b]| minus(b, a));
    let (here, exact) = if values { (found[0], recorded[0]) } else { (&change[..], &recorded_change[..]) };
    let whole = scale(found[0], recorded[0]);
    let moved = norm(&recorded_change) > 1e-9 * norm(recorded[1]);
    let late = norm(&minus(found[1], recorded[0])) < LATE * norm(&recorded_change);
    let late = moved && (late || found[1] == found[0]);
    whole
        .or_else(|| late.then_some(Deviation::Late))
        .or_else(|| if moved || values { scale(here, exact) } else { None })
        .or_else(|| reversed(here, exact))
        .or_else(|| if values { rows(found[0], recorded[0], width) } else { None })
}

/// Faces in groups of which no two share a node.
pub(super) fn groups_without_common_nodes(faces: &[[u32; 4]], nodes: usize) -> Vec<Vec<usize>> {
    let mut groups: Vec<(Vec<usize>, Vec<bool>)> = Vec::new();
    for (k, face) in faces.iter().enumerate() {
        let free = groups.iter().position(|(_, taken)| face.iter().all(|n| !taken[*n as usize]));
        let group = free.unwrap_or_else(|| {
            groups.push((Vec::new(), vec![false; nodes]));
            groups.len() - 1
        });
        groups[group].0.push(k);
        face.iter().for_each(|n| groups[group].1[*n as usize] = true);
    }
    groups.into_iter().map(|(faces, _)| faces).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIRST: [f64; 8] = [1.0, 2.0, -1.0, 0.5, 3.0, -2.0, 1.5, 0.7];
    const SECOND: [f64; 8] = [1.2, 2.3, -0.8, 0.2, 3.3, -2.5, 1.7, 0.8];

    fn judged(found: [&[f64]; 2], values: bool) -> Option<Deviation> {
        deviation(found, [&FIRST, &SECOND], values, 1)
    }

    #[test]
    fn faults_are_told_apart() {
        let times = |a: &[f64], f: f64| a.iter().map(|x| f * x).collect::<Vec<_>>();
        for values in [true, false] {
            assert_eq!(judged([&FIRST, &SECOND], values), None);
            // Another method: 20 % off.
            assert_eq!(judged([&times(&FIRST, 1.2), &times(&SECOND, 1.2)], values), None);
            let Some(Deviation::Scale(ratio)) = judged([&times(&FIRST, 1e3), &times(&SECOND, 1e3)], values)
            else {
                panic!("a factor of 1000");
            };
            assert!((ratio / 1e3 - 1.0).abs() < 1e-12);
            assert_eq!(judged([&FIRST, &FIRST], values), Some(Deviation::Late));
            assert_eq!(judged([&times(&FIRST, 0.9), &times(&FIRST, 0.9)], values), Some(Deviation::Late));
            let turned = [times(&FIRST, -1.0), times(&SECOND, -1.0)];
            let Some(Deviation::Reversed(cosine)) = judged([&turned[0], &turned[1]], values) else {
                panic!("the opposite");
            };
            assert!((cosine + 1.0).abs() < 1e-12);
        }
        let mut one = (FIRST, SECOND);
        (one.0[4], one.1[4]) = (-FIRST[4], -SECOND[4]);
        assert_eq!(judged([&one.0, &one.1], true), Some(Deviation::Rows(vec![4])));
        // A displacement that moves the other way within a shape that agrees.
        let back: Vec<f64> = FIRST.iter().zip(SECOND).map(|(a, b)| 2.0 * a - b).collect();
        assert!(matches!(judged([&FIRST, &back], false), Some(Deviation::Reversed(_))));
        // Nothing moves: no change to compare.
        assert_eq!(deviation([&FIRST, &FIRST], [&FIRST, &FIRST], false, 1), None);
    }

    #[test]
    fn groups_have_each_face_once_and_no_common_node() {
        // A strip of quadrilaterals and triangles.
        let faces = [[0, 1, 3, 2], [2, 3, 5, 4], [4, 5, 6, 6], [6, 5, 7, 7]];
        let groups = groups_without_common_nodes(&faces, 8);
        let mut all: Vec<usize> = groups.concat();
        all.sort_unstable();
        assert_eq!(all, [0, 1, 2, 3]);
        for group in &groups {
            let mut nodes: Vec<u32> = group.iter().flat_map(|f| distinct(&faces[*f])).collect();
            let count = nodes.len();
            nodes.sort_unstable();
            nodes.dedup();
            assert_eq!(nodes.len(), count, "{groups:?}");
        }
    }

    fn distinct(face: &[u32; 4]) -> Vec<u32> {
        let mut nodes = face.to_vec();
        nodes.dedup();
        nodes
    }
}
