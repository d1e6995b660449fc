//! Bytes as tensors of 32-bit integers, which every device has.

use std::sync::Arc;

use burn::tensor::{DType, Device, Int, Tensor, TensorData};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};
use crate::scene::slots::Topology;

/// A cryptographic hash, since a server keeps lists for all of its clients.
pub(crate) type Hash = [u64; 4];

pub(crate) fn hash(words: &[u32]) -> Hash {
    let mut hasher = blake3::Hasher::new();
    let mut bytes = Vec::with_capacity(4 * words.len().min(1 << 14));
    for some in words.chunks(1 << 14) {
        bytes.clear();
        bytes.extend(some.iter().flat_map(|word| word.to_le_bytes()));
        hasher.update(&bytes);
    }
    let digest = hasher.finalize();
    let (all, _) = digest.as_bytes().as_chunks::<8>();
    std::array::from_fn(|i| u64::from_le_bytes(all[i]))
}

/// Packs bytes: their number, and four in each further word.
pub(crate) fn pack(bytes: &[u8]) -> Vec<u32> {
    let (whole, rest) = bytes.as_chunks::<4>();
    let mut last = [0; 4];
    last[..rest.len()].copy_from_slice(rest);
    let length = [bytes.len() as u32];
    let words = whole.iter().map(|&four| u32::from_le_bytes(four));
    let last = (!rest.is_empty()).then_some(u32::from_le_bytes(last));
    length.into_iter().chain(words).chain(last).collect()
}

pub(crate) fn unpack(words: &[u32]) -> Option<Vec<u8>> {
    let (&length, words) = words.split_first()?;
    let mut bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    (length as usize <= bytes.len()).then(|| bytes.truncate(length as usize))?;
    Some(bytes)
}

/// An error of the two programs rather than of a scene.
pub(crate) fn malformed(reason: impl ToString) -> Error {
    Error::invalid(
        "message between a client and a server of softray",
        "content",
        format!("malformed ({})", reason.to_string()),
        "one of the same version of softray",
    )
}

pub(crate) fn encode(value: &impl Serialize) -> Result<Vec<u8>> {
    rmp_serde::to_vec(value).map_err(malformed)
}

pub(crate) fn decode<T: DeserializeOwned>(words: &[u32]) -> Result<T> {
    let bytes = unpack(words).ok_or_else(|| malformed("too short"))?;
    rmp_serde::from_slice(&bytes).map_err(malformed)
}

pub(crate) fn tensor(words: Vec<u32>, device: &Device) -> Tensor<1, Int> {
    let words: Vec<i32> = words.into_iter().map(|word| word as i32).collect();
    let count = words.len();
    Tensor::from_data(TensorData::new(words, [count]), (device, DType::I32))
}

impl Topology {
    /// The lists as words: the number of lists of faces, the number of other lists, the length of each, and all values.
    pub fn words(&self) -> Vec<u32> {
        let counts = [self.faces.len() as u32, self.indices.len() as u32];
        let faces = self.faces.iter().map(|list| list.len() as u32);
        let lengths = faces.chain(self.indices.iter().map(|list| list.len() as u32));
        let mut words: Vec<u32> = counts.into_iter().chain(lengths).collect();
        for list in &self.faces {
            words.extend_from_slice(list.as_flattened());
        }
        for list in &self.indices {
            words.extend_from_slice(list);
        }
        words
    }

    /// Returns None for words that are not those of lists.
    pub fn of_words(words: &[u32]) -> Option<Self> {
        let (&[of_faces, of_indices], rest) = words.split_first_chunk()?;
        let lists = (of_faces as usize).checked_add(of_indices as usize)?;
        let (lengths, mut values) = rest.split_at_checked(lists)?;
        let (of_faces, of_indices) = lengths.split_at_checked(of_faces as usize)?;
        let mut take = |count: usize| {
            let (some, rest) = values.split_at_checked(count)?;
            values = rest;
            Some(some)
        };
        let faces = of_faces.iter().map(|&count| {
            let (faces, _) = take(3 * count as usize)?.as_chunks::<3>();
            Some(Arc::new(faces.to_vec()))
        });
        let faces = faces.collect::<Option<_>>()?;
        let indices = of_indices.iter();
        let indices = indices.map(|&count| Some(Arc::new(take(count as usize)?.to_vec())));
        let indices = indices.collect::<Option<_>>()?;
        values.is_empty().then_some(Self { faces, indices })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_come_back() {
        for count in 0..9u8 {
            let bytes: Vec<u8> = (1..=count).collect();
            assert_eq!(unpack(&pack(&bytes)), Some(bytes));
        }
        assert_eq!(unpack(&[]), None);
        assert_eq!(unpack(&[5, 1]), None);
    }

    #[test]
    fn lists_come_back() {
        let lists = Topology {
            faces: vec![Arc::new(vec![[0, 1, 2], [2, 1, 3]]), Arc::default()],
            indices: vec![Arc::new(vec![7])],
        };
        let words = lists.words();
        let read = Topology::of_words(&words).expect("lists");
        assert_eq!((read.faces, read.indices), (lists.faces, lists.indices));
        for cut in 0..words.len() {
            assert!(Topology::of_words(&words[..cut]).is_none(), "{cut} words");
        }
        assert_ne!(hash(&words), hash(&words[1..]));
    }
}
