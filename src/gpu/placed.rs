//! Tensors of meshes, materials, lights and environments that the device places into the lists of scenes, from the row of
//! all tracked tensors. The host reads later how far vertices have moved and how much light has changed, and the values on
//! request.

use std::collections::HashSet;
use std::future::poll_fn;
use std::ops::Range;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, Waker};

use burn::backend::Cube;
use burn::cubecl::bytes::Bytes;
use burn::cubecl::future::block_on;
use burn::tensor::Tensor;
use glam::DVec3;

use softray_kernels::cube::*;

use super::device::{List, floats, launch};
use crate::geometry::detached;
use softray_kernels::host::{CHANNELS, Channel, LightPart, ParameterId};
use softray_kernels::kernel::{KernelScene, View};
use softray_kernels::model::delta_light::{OF_LIGHT, OF_STRENGTH};
use softray_kernels::model::numbers::{is_finite, magnitude};
use softray_kernels::model::texture::Texture;
use softray_kernels::model::triangle::AREA;
use softray_kernels::trace::{HEADER, HeaderWord};

/// The ranges of a view's tensors in the row, and in its gradient.
pub(crate) type TensorPlaces<'a> = &'a [(ParameterId, Range<usize>)];

/// A view, and the ranges of the tensors of its scene and of its camera.
pub(crate) type ViewPlaces<'a> = (&'a View, TensorPlaces<'a>, TensorPlaces<'a>);

/// Number of words of a tensor in the table: the number of elements before it in the table, its first element in the
/// row, its first place in the buffer, and [`OF_VERTICES`] or the distance between its elements there. The bits of numbers
/// follow: the origin of the elements as two numbers per axis, the factor by which they are multiplied, and 1 over the unit
/// of their moves.
const OF_TENSOR: usize = 12;
const CENTER: usize = 4;
const REST: usize = 7;
const SCALE: usize = 10;
const PER_MOVE: usize = 11;
/// Marks vertices. Lists store each of their coordinates in the scene's frame, as the sum of two numbers.
const OF_VERTICES: u32 = 0;

/// The largest move of a vertex since the values in use, divided by a typical length of edges. A change of light by the
/// largest value of its tensor counts as much, since emitters and directions are chosen by the values in use.
pub(crate) const FAR_MOVE: f32 = 0.25;

/// The number of triangles by which the typical length of an object's edges is judged, and the number of elements by which
/// the size of light is.
const SOME: usize = 256;
const SOME_ELEMENTS: usize = 4096;

/// The bytes of a list that arrive later, or `None` if the device fails.
type Arriving = Pin<Box<dyn Future<Output = Option<Bytes>> + Send>>;

/// The row of all tracked tensors on a device, from which tensors are placed.
#[derive(Clone)]
pub(crate) struct Row(List);

impl Row {
    /// Takes a row, or returns `None` if it is not on a GPU. If `reads`, also returns its values, which the host gets
    /// later.
    pub fn new(row: &Tensor<1>, reads: bool) -> Option<(Self, Option<Reading>)> {
        let row = detached(row).try_into_primitive::<Cube>().ok()?;
        let (client, list) = floats(row);
        let reading = reads.then(|| Reading::of(&client, &list));
        Some((Self(list), reading))
    }
}

/// A list on a device that the host reads later.
pub(crate) struct Reading(Option<Arriving>);

impl Drop for Reading {
    /// Waits for the device, since CubeCL reuses the memory of copies that are given up while the device writes them.
    fn drop(&mut self) {
        self.0.take().map(block_on);
    }
}

impl Reading {
    /// Queues the copy of a list to the host.
    fn of(client: &Client, list: &List) -> Self {
        let (client, handle) = (client.clone(), list.handle.clone());
        let mut reading: Arriving = Box::pin(async move {
            // This queues the copy. To poll its future waits for it on CUDA.
            let copy = client.read_async(vec![handle]);
            let mut queued = false;
            let polled_again = |_: &mut Context| match std::mem::replace(&mut queued, true) {
                true => Poll::Ready(()),
                false => Poll::Pending,
            };
            poll_fn(polled_again).await;
            copy.await.ok()?.pop()
        });
        let begun = reading.as_mut();
        let begun = begun.poll(&mut Context::from_waker(Waker::noop()));
        debug_assert!(begun.is_pending());
        Self(Some(reading))
    }

    /// Waits for the numbers of the list. Returns `None` if the device has failed.
    pub fn numbers(mut self) -> Option<Vec<f32>> {
        let bytes = block_on(self.0.take()?)?;
        Some(f32::from_bytes(&bytes).to_vec())
    }
}

/// The tensors to place into the lists of a group of views.
pub(super) struct Placing {
    row: Row,
    table: Vec<u32>,
    elements: usize,
    /// The ranges of the lists in which they are placed.
    pub ranges: Vec<Range<usize>>,
    /// Words that are replaced, each behind its place.
    words: Vec<[u32; 2]>,
    /// Whether vertices are among the tensors.
    pub moves: bool,
}

impl Placing {
    /// Lists the tensors of the views' scenes, whose lists begin where `header` says, and words to replace. Returns `None`
    /// if there is nothing to do.
    pub fn new(
        row: &Row,
        views: &[ViewPlaces],
        header: &[u32],
        words: Vec<[u32; 2]>,
    ) -> Option<Self> {
        let mut this = Self {
            row: row.clone(),
            table: Vec::new(),
            elements: 0,
            ranges: Vec::new(),
            words,
            moves: false,
        };
        let mut known = HashSet::new();
        for (&(view, places, _), header) in views.iter().zip(header.chunks(HEADER)) {
            // Views of one scene share its lists. Lists without elements may begin at one place.
            if known.insert((
                Arc::as_ptr(&view.scene),
                header[HeaderWord::vertices as usize],
            )) {
                for (id, range) in places {
                    this.add(&view.scene, *id, [range.start, range.len()], header);
                }
            }
        }
        (this.elements + this.words.len() > 0).then_some(this)
    }

    fn add(
        &mut self,
        scene: &KernelScene,
        id: ParameterId,
        [start, length]: [usize; 2],
        header: &[u32],
    ) {
        let Some(place) = place_of(scene, id, length) else {
            return;
        };
        let (to, apart) = (
            header[place.list as usize] + place.first as u32,
            place.apart,
        );
        self.moves |= apart == OF_VERTICES;
        let of_list = match apart {
            OF_VERTICES => 2 * length,
            _ => apart as usize * length,
        };
        self.ranges.push(to as usize..to as usize + of_list);
        let before = self.elements as u32;
        self.table.extend([before, start as u32, to, apart]);
        let coarse = place.origin.as_vec3();
        let rest = (place.origin - coarse.as_dvec3()).as_vec3();
        let numbers = [coarse, rest].map(|v| v.to_array());
        let per_move = match id {
            ParameterId::Vertices(i) => 1.0 / typical_edge(scene, i).max(f32::MIN_POSITIVE),
            ParameterId::Environment
            | ParameterId::Material(_, Channel::Emission)
            | ParameterId::Light(_, LightPart::Intensity | LightPart::Irradiance) => {
                FAR_MOVE / largest(scene, &place, length).max(f32::MIN_POSITIVE)
            }
            _ => 0.0,
        };
        let factors = [place.scale as f32, per_move];
        let numbers = numbers.as_flattened().iter().chain(&factors);
        self.table.extend(numbers.map(|x| x.to_bits()));
        self.elements += length;
    }

    /// Places the tensors into the lists of floats, and replaces words. Returns the longest move of a vertex, divided by a
    /// typical length of its object's edges, or the largest change of light, times [`FAR_MOVE`] and divided by the tensor's
    /// largest value in use, if that is larger. It is infinite or NaN if a value is not finite.
    pub fn place(&self, client: &Client, floats: &List, words: &List) -> Reading {
        let table = [&self.table, self.words.as_flattened()].concat();
        let [table, found] = List::send(client, [u32::as_bytes(&table), &[0; 4]]);
        launch!(
            client,
            self.elements.max(self.words.len()),
            place_tensors(
                floats,
                words,
                &self.row.0,
                &table,
                &found,
                (self.table.len() / OF_TENSOR) as u32,
                self.elements as u32
            )
        );
        Reading::of(client, &found)
    }
}

/// Where a tensor is placed.
struct Place {
    list: HeaderWord,
    /// Its first place in the list, and [`OF_VERTICES`] or the distance between its elements.
    first: usize,
    apart: u32,
    /// Elements are stored relative to the origin, times the scale.
    origin: DVec3,
    scale: f64,
}

/// Returns where a tensor with `length` elements is placed, or `None` for tensors that the host takes.
fn place_of(scene: &KernelScene, id: ParameterId, length: usize) -> Option<Place> {
    use HeaderWord as W;
    use ParameterId as Id;
    let objects = &scene.lists.objects;
    let texels = |texture: Texture| {
        // Texels of one channel are stored in the first of three.
        let apart = 3 * texture.width as usize * texture.height as usize / length;
        (W::texels, 3 * texture.first as usize, apart as u32)
    };
    let (center, per_unit) = (scene.frame.center, 1.0 / scene.frame.unit);
    let (mut origin, mut scale) = (DVec3::ZERO, 1.0);
    let (list, first, apart) = match id {
        Id::Vertices(i) => {
            (origin, scale) = (center, per_unit);
            (W::vertices, 6 * objects[i].first_vertex, OF_VERTICES)
        }
        Id::Uvs(i) => (W::uvs, 2 * objects[i].first_uv, 1),
        Id::Normals(i) => (W::normals, 3 * objects[i].first_normal, 1),
        Id::Colors(i) => (W::colors, 3 * objects[i].first_color, 1),
        Id::Tangents(i) => (W::tangents, 4 * objects[i].first_tangent, 1),
        Id::NormalMap(m) => texels(scene.materials[m].normal_map?),
        Id::Material(m, channel) => match scene.materials[m].channels[channel.place()].texture {
            Some(texture) => texels(texture),
            None => (W::materials, 3 * (CHANNELS * m + channel.place()), 1),
        },
        Id::Light(i, LightPart::Position) => {
            (origin, scale) = (center, per_unit);
            (W::lights, OF_LIGHT * i, 1)
        }
        Id::Light(i, part @ (LightPart::Intensity | LightPart::Irradiance)) => {
            if part == LightPart::Intensity {
                scale = per_unit * per_unit;
            }
            (W::lights, OF_LIGHT * i + OF_STRENGTH, 1)
        }
        Id::Environment => (W::sky, 0, 1),
        _ => return None,
    };
    Some(Place {
        list,
        first,
        apart,
        origin,
        scale,
    })
}

/// Returns the largest absolute value in use of a placed tensor, judged by some of its elements.
fn largest(scene: &KernelScene, place: &Place, length: usize) -> f32 {
    let scene = scene.scene();
    let lists = scene.float_lists();
    let list = lists.iter().find(|l| l.0 as usize == place.list as usize);
    let own = list.map_or(&[][..], |l| l.1).iter().skip(place.first);
    let own = own.step_by(place.apart as usize).take(length);
    let some = own.step_by(length.div_ceil(SOME_ELEMENTS));
    some.fold(0.0, |largest, v| largest.max(v.abs()))
}

/// Returns the typical length of an object's edges, from some of its triangles.
fn typical_edge(scene: &KernelScene, object: usize) -> f32 {
    let objects = &scene.lists.objects;
    let past = objects.get(object + 1);
    let past = past.map_or(scene.lists.surfaces.len(), |o| o.first_triangle);
    let own = &scene.lists.surfaces[objects[object].first_triangle..past];
    let some = own.iter().step_by((own.len() / SOME).max(1));
    let (sum, count) = some.fold((0.0, 0), |(sum, count), s| (sum + s[AREA], count + 1));
    (2.0 * sum / count.max(1) as f32).sqrt()
}

/// Places the elements of `tensors` tensors into the lists of floats, one per thread, and finds the longest move. Replaces
/// the words that stand behind the tensors in the table.
#[cube(launch)]
fn place_tensors(
    lists: &mut [f32],
    words: &mut [u32],
    row: &[f32],
    table: &[u32],
    found: &[Atomic<u32>],
    tensors: u32,
    elements: u32,
) {
    let replaced = tensors as usize * OF_TENSOR + 2 * ABSOLUTE_POS;
    if replaced < table.len() {
        words[table[replaced] as usize] = table[replaced + 1];
    }
    if ABSOLUTE_POS < elements as usize {
        // Find the last tensor that begins at or before the element.
        let mut tensor = 0usize;
        let mut past = tensors as usize;
        while past - tensor > 1 {
            let middle = (tensor + past) / 2;
            if table[middle * OF_TENSOR] as usize <= ABSOLUTE_POS {
                tensor = middle;
            } else {
                past = middle;
            }
        }
        let of = tensor * OF_TENSOR;
        let i = ABSOLUTE_POS as u32 - table[of];
        let value = row[(table[of + 1] + i) as usize];
        let first = table[of + 2];
        let axis = (i % 3) as usize;
        let center = f32::from_bits(table[of + CENTER + axis]);
        let rest_of_center = f32::from_bits(table[of + REST + axis]);
        let scale = f32::from_bits(table[of + SCALE]);
        // The difference from the origin.
        let away = value - center;
        let mut to = (first + i * table[of + 3]) as usize;
        let mut new = (away - rest_of_center) * scale;
        if table[of + 3] == OF_VERTICES {
            // Its rounding error.
            let back = away - value;
            let error = (value - (away - back)) - (center + back);
            let rest = error - rest_of_center;
            let rounded = away + rest;
            let remainder = rest - (rounded - away);
            to = (first + 6 * (i / 3)) as usize + axis;
            new = rounded * scale;
            lists[to + 3] = remainder * scale;
        }
        let moved = magnitude((new - lists[to]) * f32::from_bits(table[of + PER_MOVE]));
        lists[to] = new;
        // The bits of any number that is not finite are above all others.
        let bits = select(is_finite(value), moved, magnitude(value));
        let most = &found[0];
        if most.load() < bits {
            most.fetch_max(bits);
        }
    }
}
