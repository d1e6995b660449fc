//! Lists by ray, and rays in pieces for the cores.

/// A list for each ray.
#[derive(Clone, Debug)]
pub(super) struct Lists<T> {
    items: Vec<T>,
    /// The beginnings of the lists, and the end.
    starts: Vec<usize>,
}

impl<T> Default for Lists<T> {
    fn default() -> Self {
        Self {
            items: Vec::new(),
            starts: vec![0],
        }
    }
}

impl<T: Copy> Lists<T> {
    /// Adds the list of one more ray.
    pub fn push(&mut self, items: &[T]) {
        self.items.extend_from_slice(items);
        self.starts.push(self.items.len());
    }

    /// Adds the lists of more rays.
    pub fn join(&mut self, other: Self) {
        let base = self.items.len();
        self.items.extend(other.items);
        let starts = other.starts[1..].iter().map(|s| base + s);
        self.starts.extend(starts);
    }

    pub fn of(&self, ray: usize) -> &[T] {
        &self.items[self.starts[ray]..self.starts[ray + 1]]
    }

    pub fn rays(&self) -> usize {
        self.starts.len() - 1
    }
}

/// Rays of a piece.
pub(super) const RAYS_A_PIECE: usize = 512;

/// Rays in pieces for the cores: as many whatever the machine, so that sums come out the same.
pub(super) fn pieces(n: usize) -> Vec<std::ops::Range<usize>> {
    (0..n.div_ceil(RAYS_A_PIECE))
        .map(|i| i * RAYS_A_PIECE..((i + 1) * RAYS_A_PIECE).min(n))
        .collect()
}
