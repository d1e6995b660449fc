//! Maps that forget the entries that were used least recently.

use std::collections::VecDeque;

/// The least weight of an entry whose weight is its bytes: a tensor's handle or a list takes more than few words.
pub(crate) const LEAST_WEIGHT: usize = 1 << 16;

/// Entries with weights, of a maximum total weight. The newest entry stays whatever it weighs.
pub(crate) struct Bounded<K, V> {
    /// From the least recently used entry to the most recently used one.
    entries: VecDeque<(K, V, usize)>,
    limit: usize,
}

impl<K: PartialEq, V: Clone> Bounded<K, V> {
    pub const fn new(limit: usize) -> Self {
        Self {
            entries: VecDeque::new(),
            limit,
        }
    }

    pub fn get(&mut self, key: &K) -> Option<V> {
        let entry = self.take(key)?;
        let value = entry.1.clone();
        self.entries.push_back(entry);
        Some(value)
    }

    #[cfg(any(test, feature = "remote-server"))]
    pub fn remove(&mut self, key: &K) -> Option<V> {
        self.take(key).map(|entry| entry.1)
    }

    pub fn insert(&mut self, key: K, value: V, weight: usize) {
        self.take(&key);
        self.entries.push_back((key, value, weight));
        let mut total: usize = self.entries.iter().map(|entry| entry.2).sum();
        while total > self.limit && self.entries.len() > 1 {
            total -= self.entries.pop_front().map_or(0, |entry| entry.2);
        }
    }

    fn take(&mut self, key: &K) -> Option<(K, V, usize)> {
        let place = self.entries.iter().position(|entry| entry.0 == *key)?;
        self.entries.remove(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_that_are_used_stay() {
        let mut all = Bounded::new(10);
        for (key, weight) in [(1, 4), (2, 4)] {
            all.insert(key, key * 10, weight);
        }
        assert_eq!(all.get(&1), Some(10));
        all.insert(3, 30, 4);
        assert_eq!(
            [1, 2, 3].map(|key| all.get(&key)),
            [Some(10), None, Some(30)]
        );
        all.insert(4, 40, 99);
        assert_eq!([1, 3, 4].map(|key| all.get(&key)), [None, None, Some(40)]);
        assert_eq!((all.remove(&4), all.get(&4)), (Some(40), None));
    }
}
