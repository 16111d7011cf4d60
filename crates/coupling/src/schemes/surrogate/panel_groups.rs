//! Groups of interface faces (panels), for surrogates with a dense matrix.

use std::collections::{BTreeMap, HashMap};

use crate::geometry::{Vec3, distinct};

/// Smallest cosine between the normals of two groups that are merged.
const MIN_COSINE: f64 = 0.5;

/// Partition of the faces into groups. With one face per group all means are the faces' own values.
#[derive(Clone, Debug)]
pub(crate) struct PanelGroups {
    /// Group of each face.
    pub of: Vec<u32>,
    /// Area of each face relative to its group.
    pub share: Vec<f64>,
    /// Added length of the motion of faces relative to their group, m: see [`PanelGroups::new`].
    pub short_wave_length: Vec<f64>,
    /// Edges of each group's outline, oriented like its faces.
    pub outlines: Vec<Vec<[u32; 2]>>,
}

impl PanelGroups {
    /// At most `most` groups of neighbours, compact and of even size, by pairwise merging. `None` where creases and
    /// gaps leave more.
    ///
    /// A smooth motion sampled in groups of size $`H`$ leaves a sawtooth of period $`H`$. Its first wave,
    /// $`k = 2\pi/H`$, adds the mass $`2\rho/k`$ to both sides of the surface: `short_wave_length` is $`H/\pi`$.
    pub fn new(
        positions: &[Vec3],
        faces: &[[u32; 4]],
        areas: &[Vec3],
        normals: &[Vec3],
        most: usize,
    ) -> Option<Self> {
        let mut of: Vec<u32> = (0..faces.len() as u32).collect();
        let mut count = faces.len();
        let canopy = Canopy { positions, faces, areas, normals };
        while count > most {
            let before = count;
            count = canopy.merge(&mut of, count, most);
            if count == before {
                return None;
            }
        }
        let mut whole = vec![0.0; count];
        of.iter().zip(areas).for_each(|(&g, a)| whole[g as usize] += a.norm());
        let share = of.iter().zip(areas).map(|(&g, a)| part(a.norm(), whole[g as usize])).collect();
        let short_wave_length = whole.iter().map(|a| a.sqrt() / std::f64::consts::PI).collect();
        Some(Self { outlines: outlines(faces, &of, count), of, share, short_wave_length })
    }

    /// Groups.
    pub fn len(&self) -> usize {
        self.short_wave_length.len()
    }

    /// Areas of the groups, m2, from the area vectors of the faces.
    pub fn areas(&self, faces: &[Vec3]) -> Vec<f64> {
        let mut sums = vec![0.0; self.len()];
        self.of.iter().zip(faces).for_each(|(&g, a)| sums[g as usize] += a.norm());
        sums
    }

    /// Means over the groups, by area.
    pub fn means(&self, values: &[f64]) -> Vec<f64> {
        let mut means = vec![0.0; self.len()];
        for ((&g, share), value) in self.of.iter().zip(&self.share).zip(values) {
            means[g as usize] += share * value;
        }
        means
    }
}

/// `a` relative to `whole`, which may be zero.
fn part(a: f64, whole: f64) -> f64 {
    if a == whole { 1.0 } else { a / whole.max(f64::MIN_POSITIVE) }
}

/// Edges of a face, in its orientation.
fn edges(face: &[u32; 4]) -> impl Iterator<Item = [u32; 2]> {
    let nodes = distinct(face);
    (0..nodes.len()).map(move |k| [nodes[k], nodes[(k + 1) % nodes.len()]])
}

/// Outline of each group: edges that it does not share with itself.
fn outlines(faces: &[[u32; 4]], of: &[u32], count: usize) -> Vec<Vec<[u32; 2]>> {
    let mut owner: HashMap<[u32; 2], u32> = HashMap::new();
    for (face, &g) in faces.iter().zip(of) {
        edges(face).for_each(|e| {
            owner.insert(e, g);
        });
    }
    let mut outlines = vec![Vec::new(); count];
    for (face, &g) in faces.iter().zip(of) {
        let outer = edges(face).filter(|&[a, b]| owner.get(&[b, a]) != Some(&g));
        outlines[g as usize].extend(outer);
    }
    outlines
}

/// Geometry of the canopy for merging.
struct Canopy<'a> {
    positions: &'a [Vec3],
    faces: &'a [[u32; 4]],
    areas: &'a [Vec3],
    normals: &'a [Vec3],
}

/// Groups before a round of merging.
struct Round {
    area: Vec<f64>,
    /// Length of the outline, m.
    around: Vec<f64>,
    /// Sum of the normals by area.
    normal: Vec<Vec3>,
    /// Length of the common outline of two groups, stored under both.
    shared: Vec<BTreeMap<u32, f64>>,
}

impl Canopy<'_> {
    /// Merges pairs of neighbours until `most` groups are left or no pair remains; renumbers the groups. Returns
    /// their number.
    fn merge(&self, of: &mut [u32], count: usize, most: usize) -> usize {
        let partner = self.measure(of, count).partners(most);
        renumber(of, &partner)
    }

    /// Sizes, normals and shared outlines of the groups.
    fn measure(&self, of: &[u32], count: usize) -> Round {
        let (mut area, mut around) = (vec![0.0; count], vec![0.0; count]);
        let mut normal = vec![Vec3::zeros(); count];
        let mut owner: HashMap<[u32; 2], u32> = HashMap::new();
        for (((face, &g), a), n) in self.faces.iter().zip(of).zip(self.areas).zip(self.normals) {
            area[g as usize] += a.norm();
            normal[g as usize] += n * a.norm();
            edges(face).for_each(|e| {
                owner.insert(e, g);
            });
        }
        let mut shared: Vec<BTreeMap<u32, f64>> = vec![BTreeMap::new(); count];
        for (face, &g) in self.faces.iter().zip(of) {
            for [a, b] in edges(face) {
                let length = (self.positions[b as usize] - self.positions[a as usize]).norm();
                match owner.get(&[b, a]) {
                    Some(&other) if other == g => continue,
                    Some(&other) => *shared[g as usize].entry(other).or_default() += length,
                    None => {}
                }
                around[g as usize] += length;
            }
        }
        Round { area, around, normal, shared }
    }
}

impl Round {
    /// Partners until `most` groups would be left: small groups choose first, and take the partner with which they
    /// are most compact, that is with the largest ratio of area to squared outline.
    fn partners(&self, most: usize) -> Vec<Option<usize>> {
        let count = self.area.len();
        let mut order: Vec<usize> = (0..count).collect();
        // Sizes in steps of a factor of sqrt 2, so that round-off does not decide the order of equal ones.
        let step = |g: usize| (2.0 * self.area[g].max(f64::MIN_POSITIVE).log2()).round();
        order.sort_by(|&a, &b| step(a).total_cmp(&step(b)).then(a.cmp(&b)));
        let mut partner: Vec<Option<usize>> = vec![None; count];
        let mut left = count;
        for &g in &order {
            if left <= most {
                break;
            }
            if partner[g].is_some() {
                continue;
            }
            if let Some(o) = self.roundest(g, &partner) {
                (partner[g], partner[o]) = (Some(o), Some(g));
                left -= 1;
            }
        }
        partner
    }

    /// The unpaired neighbour with which group `g` is most compact.
    fn roundest(&self, g: usize, partner: &[Option<usize>]) -> Option<usize> {
        let mut best: Option<(f64, usize)> = None;
        for (&other, length) in &self.shared[g] {
            let o = other as usize;
            let area = self.area[g] * self.area[o];
            let cosine = self.normal[g].dot(&self.normal[o]) / area.max(f64::MIN_POSITIVE);
            if partner[o].is_some() || cosine < MIN_COSINE {
                continue;
            }
            let outline = self.around[g] + self.around[o] - 2.0 * length;
            let round = (self.area[g] + self.area[o]) / outline.powi(2);
            if best.is_none_or(|(b, _)| round > b * (1.0 + 1e-9)) {
                best = Some((round, o));
            }
        }
        best.map(|(_, o)| o)
    }
}

/// Renumbers groups and their partners; returns the number of groups.
fn renumber(of: &mut [u32], partner: &[Option<usize>]) -> usize {
    let mut number = vec![u32::MAX; partner.len()];
    let mut next = 0;
    for g in 0..partner.len() {
        if number[g] == u32::MAX {
            number[g] = next;
            if let Some(o) = partner[g] {
                number[o] = next;
            }
            next += 1;
        }
    }
    of.iter_mut().for_each(|g| *g = number[*g as usize]);
    next as usize
}

#[cfg(test)]
mod tests {
    use crate::schemes::surrogate::vortex_lattice::VortexLattice;
    use crate::schemes::test_support::plate;

    #[test]
    fn square_grid_is_merged_into_blocks() {
        let (positions, faces) = plate(16);
        let lattice = VortexLattice::new(&positions, &faces, 64, 0.0).expect("enough neighbours");
        let groups = &lattice.groups;
        assert_eq!(groups.len(), 64);
        // Four faces each, nearly all in blocks of two by two with eight outline edges.
        let mut faces_of = vec![0; 64];
        groups.of.iter().for_each(|&g| faces_of[g as usize] += 1);
        assert!(faces_of.iter().all(|&n| n == 4), "{faces_of:?}");
        let blocks = groups.outlines.iter().filter(|o| o.len() == 8).count();
        assert!(blocks >= 60, "{blocks}");
        // Four faces of side 1/16: the side of a group over pi.
        let side = 2.0 / 16.0 / std::f64::consts::PI;
        assert!(
            groups.short_wave_length.iter().all(|f| (f - side).abs() < 1e-14),
            "{:?}",
            groups.short_wave_length
        );
        let means = groups.means(&vec![0.7; faces.len()]);
        assert!(means.iter().all(|m| (m - 0.7).abs() < 1e-14));
    }

    #[test]
    fn creases_and_gaps_are_not_merged() {
        // Two squares that share an edge at a right angle, and one by itself.
        let positions = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            [1.0, 0.0, 1.0],
            [1.0, 1.0, 1.0],
            [5.0, 0.0, 0.0],
            [6.0, 0.0, 0.0],
            [6.0, 1.0, 0.0],
            [5.0, 1.0, 0.0],
        ];
        let faces = [[0, 1, 2, 3], [1, 4, 5, 2], [6, 7, 8, 9]];
        assert!(VortexLattice::new(&positions, &faces, 2, 0.0).is_none());
        assert!(VortexLattice::new(&positions, &faces, 3, 0.0).is_some_and(|l| l.groups.len() == 3));
    }
}
