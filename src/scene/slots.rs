//! Tensors and long lists of a scene beside its bytes. Serialization writes their numbers in place of their values, so
//! that a server receives tensors as handles, and the faces of meshes once.

use std::cell::RefCell;
use std::collections::HashMap;
use std::fmt::Display;
use std::sync::Arc;

use burn::backend::tensor::FloatTensor;
use burn::backend::{DispatchTensor, Remote};
use burn::tensor::{Device, Tensor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::geometry::detached;

/// The lists of integers of some scenes.
#[derive(Clone, Default)]
pub(crate) struct Topology {
    pub faces: Vec<Arc<Vec<[u32; 3]>>>,
    pub indices: Vec<Arc<Vec<u32>>>,
}

/// What serialization collects.
#[derive(Default)]
pub(crate) struct Written {
    pub topology: Topology,
    /// The tensors on the remote device, without autodiff.
    pub tensors: Vec<FloatTensor<Remote>>,
    /// Flat copies of the tracked tensors, in the order of `tensors`.
    pub tracked: Vec<Tensor<1>>,
    lists: HashMap<usize, u32>,
    untracked: HashMap<u64, u32>,
}

/// What deserialization is given, and collects.
pub(crate) struct Read {
    pub topology: Arc<Topology>,
    /// The tensors on a device of the server, without autodiff.
    pub tensors: Vec<DispatchTensor>,
    /// Leaf tensors `[N]` of a graph in place of the tracked tensors, by their numbers.
    pub leaves: Vec<(u32, Tensor<1>)>,
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

/// Tensors: twice their number, and 1 more if they are tracked.
pub(crate) mod tensor {
    use super::*;

    pub fn serialize<const D: usize, S: Serializer>(
        tensor: &Tensor<D>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let number = writing(|own, device| {
            let tracked = tensor.is_tracked();
            let own_device = detached(tensor).to_device(device);
            let handle = own_device.try_into_primitive::<Remote>();
            let handle = handle.map_err(|e| format!("{e:?}"))?;
            let id = handle.clone().into_ir().id.value();
            let next = own.tensors.len() as u32;
            let number = match tracked {
                true => next,
                false => *own.untracked.entry(id).or_insert(next),
            };
            if number == next {
                own.tensors.push(handle);
            }
            if tracked {
                let count = tensor.shape().num_elements();
                own.tracked.push(tensor.clone().reshape([count]));
            }
            Ok(2 * number + u32::from(tracked))
        })?;
        serializer.serialize_u32(number)
    }

    pub fn deserialize<'de, const D: usize, De: Deserializer<'de>>(
        deserializer: De,
    ) -> Result<Tensor<D>, De::Error> {
        let number = u32::deserialize(deserializer)?;
        reading(|own| {
            let tensor = item(&own.tensors, number / 2, "tensor")?;
            let shape = burn::backend::TensorMetadata::shape(&tensor);
            let shape: [usize; D] = shape
                .to_vec()
                .try_into()
                .map_err(|dims| format!("a tensor has the shape {dims:?}, expected {D} axes"))?;
            let tensor = Tensor::<D>::from_dispatch(tensor);
            if number.is_multiple_of(2) {
                return Ok(tensor);
            }
            let leaf = tensor.reshape([shape.iter().product::<usize>()]);
            let leaf: Tensor<1> = leaf.autodiff().require_grad();
            own.leaves.push((number / 2, leaf.clone()));
            Ok(leaf.reshape(shape))
        })
    }
}
