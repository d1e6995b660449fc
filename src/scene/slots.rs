//! Tensors and long lists of a scene beside its bytes. Serialization writes their numbers in place of their values, so
//! that a server receives tensors as handles, and the faces of meshes once.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::fmt::Display;
use std::sync::{Arc, Weak};

use burn::backend::tensor::FloatTensor;
use burn::backend::{BackendTensor, DispatchTensor, DispatchTensorKind, Remote, TensorMetadata};
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::geometry::detached;

/// The lists of integers of some scenes.
#[derive(Clone, Default)]
pub(crate) struct Topology {
    pub faces: Vec<Arc<Vec<[u32; 3]>>>,
    pub indices: Vec<Arc<Vec<u32>>>,
}

impl Topology {
    /// The places of the lists in memory.
    pub fn places(&self) -> Places {
        Places {
            faces: self.faces.iter().map(Arc::downgrade).collect(),
            indices: self.indices.iter().map(Arc::downgrade).collect(),
        }
    }
}

/// Lists by their places in memory, which no other list takes while this is kept. A list that has such a place does not
/// change.
#[derive(Clone)]
pub(crate) struct Places {
    faces: Vec<Weak<Vec<[u32; 3]>>>,
    indices: Vec<Weak<Vec<u32>>>,
}

impl PartialEq for Places {
    fn eq(&self, other: &Self) -> bool {
        fn same<T>(a: &[Weak<T>], b: &[Weak<T>]) -> bool {
            a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.ptr_eq(b))
        }
        same(&self.faces, &other.faces) && same(&self.indices, &other.indices)
    }
}

/// What serialization collects.
#[derive(Default)]
pub(crate) struct Written {
    pub topology: Topology,
    /// The tensors on the remote device, without autodiff.
    pub tensors: Vec<FloatTensor<Remote>>,
    /// The tracked tensors, in the order of `tensors`.
    pub tracked: Vec<DispatchTensor>,
    lists: HashMap<usize, u32>,
    numbers: HashMap<Identity, u32>,
}

/// What copies of a tensor have in common: their node of the graph, or the values of a constant.
#[derive(PartialEq, Eq, Hash)]
enum Identity {
    Tracked(u64),
    Constant(u64),
}

/// What deserialization is given, and collects.
pub(crate) struct Read {
    pub topology: Arc<Topology>,
    /// The tensors on a device of the server, without autodiff.
    pub tensors: Vec<DispatchTensor>,
    /// Leaf tensors `[N]` of a graph, by the numbers of the tracked tensors, which they replace in `tensors`.
    pub leaves: BTreeMap<u32, Tensor<1>>,
}

enum Slots {
    Written(Written, Device),
    Read(Read),
}

thread_local! {
    static SLOTS: RefCell<Option<Slots>> = const { RefCell::new(None) };
}

/// Serializes scenes on a remote device with `f`, and returns what stands beside the bytes.
pub(crate) fn write<T>(device: &Device, f: impl FnOnce() -> T) -> (T, Written) {
    let written = Slots::Written(Written::default(), device.clone());
    match within(written, f) {
        (result, Some(Slots::Written(written, _))) => (result, written),
        _ => unreachable!("a thread serializes one batch at a time"),
    }
}

/// Deserializes scenes with `f`, given what stood beside the bytes.
pub(crate) fn read<T>(read: Read, f: impl FnOnce() -> T) -> (T, Read) {
    match within(Slots::Read(read), f) {
        (result, Some(Slots::Read(read))) => (result, read),
        _ => unreachable!("a thread deserializes one batch at a time"),
    }
}

fn within<T>(slots: Slots, f: impl FnOnce() -> T) -> (T, Option<Slots>) {
    SLOTS.with_borrow_mut(|own| *own = Some(slots));
    let result = f();
    (result, SLOTS.take())
}

/// Calls `f` with what this thread has written so far.
fn writing<T, E: serde::ser::Error>(
    f: impl FnOnce(&mut Written, &Device) -> Result<T, String>,
) -> Result<T, E> {
    SLOTS.with_borrow_mut(|slots| match slots {
        Some(Slots::Written(written, device)) => f(written, device).map_err(E::custom),
        _ => Err(E::custom(
            "a scene is serialized only for a server; Scene::write writes files",
        )),
    })
}

/// Calls `f` with what this thread reads.
fn reading<T, E: serde::de::Error>(f: impl FnOnce(&mut Read) -> Result<T, String>) -> Result<T, E> {
    SLOTS.with_borrow_mut(|slots| match slots {
        Some(Slots::Read(read)) => f(read).map_err(E::custom),
        _ => Err(E::custom(
            "a scene is deserialized only by a server; Scene::load reads files",
        )),
    })
}

/// Returns the number of a list, which is added unless it is one of the list's copies.
fn number_of<T>(
    list: &Arc<Vec<T>>,
    all: &mut Vec<Arc<Vec<T>>>,
    lists: &mut HashMap<usize, u32>,
) -> u32 {
    let key = Arc::as_ptr(list).addr();
    *lists.entry(key).or_insert_with(|| {
        all.push(list.clone());
        all.len() as u32 - 1
    })
}

fn item<T: Clone>(all: &[T], number: u32, of: impl Display) -> Result<T, String> {
    let found = all.get(number as usize).cloned();
    found.ok_or_else(|| format!("there is no {of} of the number {number}"))
}

/// Faces of meshes and attributes.
pub(super) mod faces {
    use super::*;

    pub fn serialize<S: Serializer>(
        faces: &Arc<Vec<[u32; 3]>>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let number = writing(|own, _| {
            let all = &mut own.topology.faces;
            Ok(number_of(faces, all, &mut own.lists))
        })?;
        serializer.serialize_u32(number)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Arc<Vec<[u32; 3]>>, D::Error> {
        let number = u32::deserialize(deserializer)?;
        reading(|own| item(&own.topology.faces, number, "list of faces"))
    }
}

/// Materials of faces.
pub(super) mod indices {
    use super::*;

    pub fn serialize<S: Serializer>(
        indices: &Arc<Vec<u32>>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let number = writing(|own, _| {
            let all = &mut own.topology.indices;
            Ok(number_of(indices, all, &mut own.lists))
        })?;
        serializer.serialize_u32(number)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Arc<Vec<u32>>, D::Error> {
        let number = u32::deserialize(deserializer)?;
        reading(|own| item(&own.topology.indices, number, "list of indices"))
    }
}

/// Small vectors, for which serde has no implementation of any length.
pub(super) mod numbers {
    use super::*;

    pub fn serialize<const C: usize, S: Serializer>(
        numbers: &[f64; C],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        numbers.as_slice().serialize(serializer)
    }

    pub fn deserialize<'de, const C: usize, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<[f64; C], D::Error> {
        let numbers = Vec::<f64>::deserialize(deserializer)?;
        let count = numbers.len();
        let fixed = numbers.try_into();
        fixed.map_err(|_| serde::de::Error::invalid_length(count, &"another number of values"))
    }
}

/// The node of a tracked tensor on a server.
fn node(tensor: &DispatchTensor) -> Option<u64> {
    let DispatchTensorKind::Autodiff(inner) = &tensor.kind else {
        return None;
    };
    match &**inner {
        DispatchTensorKind::Remote(BackendTensor::Autodiff(tensor)) => Some(tensor.id().value),
        _ => None,
    }
}

/// Tensors: twice their number, and 1 more if they are tracked. Copies of a tensor have the same number.
pub(crate) mod tensor {
    use super::*;

    pub fn serialize<const D: usize, S: Serializer>(
        tensor: &Tensor<D>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let number = writing(|own, device| {
            let tracked = tensor.is_tracked().then(|| tensor.clone().into_dispatch());
            let own_device = detached(tensor).to_device(device);
            let handle = own_device.try_into_primitive::<Remote>();
            let handle = handle.map_err(|e| format!("{e:?}"))?;
            let identity = match &tracked {
                Some(tensor) => {
                    Identity::Tracked(node(tensor).ok_or("a tensor of another device")?)
                }
                None => Identity::Constant(handle.id().value()),
            };
            let next = own.tensors.len() as u32;
            let number = *own.numbers.entry(identity).or_insert(next);
            let mark = u32::from(tracked.is_some());
            if number == next {
                own.tensors.push(handle);
                own.tracked.extend(tracked);
            }
            Ok(2 * number + mark)
        })?;
        serializer.serialize_u32(number)
    }

    pub fn deserialize<'de, const D: usize, De: Deserializer<'de>>(
        deserializer: De,
    ) -> Result<Tensor<D>, De::Error> {
        let number = u32::deserialize(deserializer)?;
        let (number, tracked) = (number / 2, number % 2 == 1);
        reading(|own| {
            let tensor = item(&own.tensors, number, "tensor")?;
            let shape: [usize; D] =
                tensor.shape().to_vec().try_into().map_err(|dims| {
                    format!("a tensor has the shape {dims:?}, expected {D} axes")
                })?;
            let tensor = Tensor::<D>::from_dispatch(tensor);
            if !tracked || own.leaves.contains_key(&number) {
                return Ok(tensor);
            }
            let leaf = tensor.reshape([shape.iter().product::<usize>()]);
            let leaf: Tensor<1> = leaf.autodiff().require_grad();
            let tensor = leaf.clone().reshape(shape);
            own.leaves.insert(number, leaf);
            own.tensors[number as usize] = tensor.clone().into_dispatch();
            Ok(tensor)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_known_by_their_places() {
        let list = || Topology {
            faces: vec![Arc::new(vec![[0, 1, 2]])],
            indices: Vec::new(),
        };
        let first = list();
        let places = first.places();
        assert!(places == first.clone().places());
        assert!(places != list().places());
        // A list that changes moves to another place, and no other list takes the one that it leaves.
        let mut changed = first.clone();
        drop(first);
        Arc::make_mut(&mut changed.faces[0]).push([2, 1, 0]);
        assert!(places != changed.places());
        assert!((0..100).all(|_| places != list().places()));
    }
}
