//! Which global entities a rank owns and which it only reads.

/// Local numbering of one kind of entity (nodes, cells) on one rank.
///
/// Local indices `0..n_owned` are owned here; `n_owned..n_local` are ghosts,
/// owned elsewhere and refreshed by a [`crate::Halo`].
#[derive(Clone, Debug, Default)]
pub struct Numbering {
    /// Global index of each local entity, owned first, then ghosts.
    pub global: Vec<u64>,
    /// Number of owned entities.
    pub n_owned: usize,
    /// Owner rank of each ghost, in the order of `global[n_owned..]`.
    pub ghost_owner: Vec<u32>,
    /// Local indices in the order of their global ones.
    sorted: Vec<u32>,
}

impl Numbering {
    /// `owned` global indices, then `ghosts` as (global index, owner rank).
    /// Ghosts are ordered by owner and index so that received values are contiguous.
    pub fn new(owned: Vec<u64>, mut ghosts: Vec<(u64, u32)>) -> Self {
        ghosts.sort_unstable_by_key(|&(g, owner)| (owner, g));
        ghosts.dedup();
        let n_owned = owned.len();
        let ghost_owner = ghosts.iter().map(|&(_, owner)| owner).collect();
        let mut global = owned;
        global.extend(ghosts.iter().map(|&(g, _)| g));
        let mut sorted: Vec<u32> = (0..global.len() as u32).collect();
        sorted.sort_unstable_by_key(|&i| global[i as usize]);
        Self { global, n_owned, ghost_owner, sorted }
    }

    /// Owned and ghost entities together.
    pub fn n_local(&self) -> usize {
        self.global.len()
    }

    /// Local index of a global entity, if this rank knows it.
    pub fn local(&self, global: u64) -> Option<usize> {
        let place = self.sorted.binary_search_by_key(&global, |&i| self.global[i as usize]).ok()?;
        Some(self.sorted[place] as usize)
    }

    /// Global indices of the owned entities.
    pub fn owned(&self) -> &[u64] {
        &self.global[..self.n_owned]
    }
}
