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
    /// Which image of its entity each ghost is, in the order of `global[n_owned..]`: 0 is the entity itself, other numbers are its images
    /// in a periodic domain, which a rank may have of its own entities too.
    pub image: Vec<u32>,
    /// Local indices in the order of their global ones.
    sorted: Vec<u32>,
}

impl Numbering {
    /// `owned` global indices, then `ghosts` as (global index, owner rank).
    /// Ghosts are ordered by owner and index so that received values are contiguous.
    pub fn new(owned: Vec<u64>, ghosts: Vec<(u64, u32)>) -> Self {
        Self::with_images(owned, ghosts.into_iter().map(|(g, owner)| (g, owner, 0)).collect())
    }

    /// As [`Numbering::new`] with `ghosts` as (global index, owner rank, number of the image).
    pub fn with_images(owned: Vec<u64>, mut ghosts: Vec<(u64, u32, u32)>) -> Self {
        ghosts.sort_unstable_by_key(|&(g, owner, image)| (owner, g, image));
        ghosts.dedup();
        let n_owned = owned.len();
        let mut global = owned;
        global.extend(ghosts.iter().map(|&(g, ..)| g));
        let ghost_owner = ghosts.iter().map(|&(_, owner, _)| owner).collect();
        let image = ghosts.iter().map(|&(.., image)| image).collect();
        let mut this = Self { global, n_owned, ghost_owner, image, sorted: Vec::new() };
        let mut sorted: Vec<u32> = (0..this.global.len() as u32).collect();
        sorted.sort_unstable_by_key(|&i| this.key(i));
        this.sorted = sorted;
        this
    }

    /// Global index and image of a local entity.
    fn key(&self, local: u32) -> (u64, u32) {
        let local = local as usize;
        let image = local.checked_sub(self.n_owned).map_or(0, |ghost| self.image[ghost]);
        (self.global[local], image)
    }

    /// Owned and ghost entities together.
    pub fn n_local(&self) -> usize {
        self.global.len()
    }

    /// Local index of a global entity, if this rank knows it.
    pub fn local(&self, global: u64) -> Option<usize> {
        self.local_image(global, 0)
    }

    /// Local index of an image of a global entity, if this rank knows it.
    pub fn local_image(&self, global: u64, image: u32) -> Option<usize> {
        let place = self.sorted.binary_search_by_key(&(global, image), |&i| self.key(i)).ok()?;
        Some(self.sorted[place] as usize)
    }

    /// Global indices of the owned entities.
    pub fn owned(&self) -> &[u64] {
        &self.global[..self.n_owned]
    }
}
