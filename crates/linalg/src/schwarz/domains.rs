//! Subdomains of a rank: compact parts of its rows, each with some layers around it.

/// Rows of one subdomain.
#[derive(Debug, PartialEq)]
pub(super) struct Domain {
    /// Local rows: first those that belong to it alone, then the layers around.
    pub rows: Vec<u32>,
    /// Rows of the first kind.
    pub n_core: usize,
}

/// Cuts the first `n_owned` rows of a pattern into parts of about `size` rows, each
/// grown by `layers` of neighbours among all rows. One part holds all rows.
pub(super) fn cut(
    row_ptr: &[usize],
    cols: &[u32],
    n_owned: usize,
    size: usize,
    layers: usize,
) -> Vec<Domain> {
    let n = row_ptr.len() - 1;
    let parts = (n_owned as f64 / size.max(1) as f64).round().max(1.0) as usize;
    if parts == 1 {
        return vec![Domain { rows: (0..n as u32).collect(), n_core: n_owned }];
    }
    let mut order: Vec<u32> = (0..n_owned as u32).collect();
    let mut graph = Graph { row_ptr, cols, part: vec![0; n], seen: vec![u32::MAX; n], visits: 0 };
    graph.part[n_owned..].fill(u32::MAX);
    let mut domains = Vec::new();
    graph.bisect(&mut order, parts, 0, &mut domains);
    let mut inside = vec![u32::MAX; n];
    for (d, domain) in domains.iter_mut().enumerate() {
        domain.rows.iter().for_each(|&i| inside[i as usize] = d as u32);
        let mut ring = 0..domain.rows.len();
        for _ in 0..layers {
            for k in ring.clone() {
                let i = domain.rows[k] as usize;
                for &j in &cols[row_ptr[i]..row_ptr[i + 1]] {
                    if inside[j as usize] != d as u32 {
                        inside[j as usize] = d as u32;
                        domain.rows.push(j);
                    }
                }
            }
            ring = ring.end..domain.rows.len();
        }
    }
    domains
}

struct Graph<'a> {
    row_ptr: &'a [usize],
    cols: &'a [u32],
    /// First part that a row is among, while parts are cut.
    part: Vec<u32>,
    /// Visit that saw a row last.
    seen: Vec<u32>,
    visits: u32,
}

impl Graph<'_> {
    /// Cuts `rows`, marked with the part `first`, into `parts` across their longest way.
    fn bisect(&mut self, rows: &mut [u32], parts: usize, first: u32, out: &mut Vec<Domain>) {
        if parts == 1 {
            rows.sort_unstable();
            out.push(Domain { rows: rows.to_vec(), n_core: rows.len() });
            return;
        }
        // From the far end of the far end of any row.
        for _ in 0..3 {
            self.by_distance(rows, first);
            rows.reverse();
        }
        let near = parts / 2;
        let (low, high) = rows.split_at_mut(rows.len() * near / parts);
        high.iter().for_each(|&i| self.part[i as usize] = first + near as u32);
        self.bisect(low, near, first, out);
        self.bisect(high, parts - near, first + near as u32, out);
    }

    /// Orders `rows` by their distance from the first of them; rows that are not
    /// connected with it follow, in the same order.
    fn by_distance(&mut self, rows: &mut [u32], part: u32) {
        self.visits += 1;
        let visit = self.visits;
        let mut found: Vec<u32> = Vec::with_capacity(rows.len());
        let mut at = 0;
        for &start in rows.iter() {
            if self.seen[start as usize] == visit {
                continue;
            }
            self.seen[start as usize] = visit;
            found.push(start);
            while at < found.len() {
                let i = found[at] as usize;
                at += 1;
                for &j in &self.cols[self.row_ptr[i]..self.row_ptr[i + 1]] {
                    if self.part[j as usize] == part && self.seen[j as usize] != visit {
                        self.seen[j as usize] = visit;
                        found.push(j);
                    }
                }
            }
        }
        rows.copy_from_slice(&found);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet of m x m rows, each coupled to its eight neighbours.
    fn sheet(m: usize) -> (Vec<usize>, Vec<u32>) {
        let (mut row_ptr, mut cols) = (vec![0], Vec::new());
        for i in 0..m {
            for j in 0..m {
                for p in i.saturating_sub(1)..(i + 2).min(m) {
                    cols.extend((j.saturating_sub(1)..(j + 2).min(m)).map(|q| (p * m + q) as u32));
                }
                row_ptr.push(cols.len());
            }
        }
        (row_ptr, cols)
    }

    #[test]
    fn parts_are_compact_and_hold_each_row_once() {
        let m = 40;
        let (row_ptr, cols) = sheet(m);
        let domains = cut(&row_ptr, &cols, m * m, 200, 2);
        assert_eq!(domains.len(), 8);
        let mut owner = vec![usize::MAX; m * m];
        for (d, domain) in domains.iter().enumerate() {
            assert_eq!(domain.n_core, 200);
            for &i in &domain.rows[..domain.n_core] {
                assert_eq!(std::mem::replace(&mut owner[i as usize], d), usize::MAX);
            }
            // Two layers around a square of 14 x 14 are 128 rows; a strip of 5 x 40 has 200.
            assert!(domain.rows.len() < 370, "{}", domain.rows.len());
            let near = |i: u32| {
                domain.rows[..domain.n_core].iter().any(|&j| {
                    let apart = |a: u32, b: u32| a.abs_diff(b) <= 2;
                    apart(i / m as u32, j / m as u32) && apart(i % m as u32, j % m as u32)
                })
            };
            assert!(domain.rows[domain.n_core..].iter().all(|&i| near(i)));
            assert!((0..(m * m) as u32).filter(|&i| near(i)).count() == domain.rows.len());
        }
        assert!(owner.iter().all(|&d| d != usize::MAX));
    }

    #[test]
    fn a_small_matrix_is_one_part_and_loose_rows_have_one_too() {
        let (row_ptr, cols) = sheet(5);
        assert_eq!(cut(&row_ptr, &cols, 20, 100, 2), [Domain { rows: (0..25).collect(), n_core: 20 }]);
        let diagonal: Vec<usize> = (0..=90).collect();
        let columns: Vec<u32> = (0..90).collect();
        let domains = cut(&diagonal, &columns, 90, 30, 1);
        assert_eq!(domains.iter().map(|d| d.rows.len()).collect::<Vec<_>>(), [30, 30, 30]);
    }
}
