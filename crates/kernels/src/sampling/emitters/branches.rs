//! Divides emitters into the branches of a light tree, so that bounds of power, position and orientation estimate the
//! light of each branch well.

use super::tree::{BRANCH, IS_LEAF, OF_NODE, PARENT};
use crate::accel::LANES;
use crate::accel::eights::{Divide, NONE, Shape, set};
use crate::model::V3;
use crate::model::light_bounds::{Axes, Sphere};

/// An emitter as an item of the tree.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub emitter: u32,
    /// A bounding box of the emitter over the shutter time.
    pub low: V3,
    pub high: V3,
    /// The normal or direction. The emitter emits up to 90° from it, or in all directions.
    pub axis: V3,
    pub is_isotropic: bool,
    pub power: f32,
    /// Whether the emitter is the only one of its leaf.
    pub alone: bool,
}

impl Sphere {
    pub(super) fn new(items: &[Item]) -> Self {
        let (low, high) = bounds(items);
        let power: f32 = items.iter().map(|i| i.power).sum();
        let axis = |i: &Item| (!i.is_isotropic).then_some(i.axis);
        Self {
            center: (low + high) * 0.5,
            radius: (high - low).length() * (0.5 * (1.0 + 1e-5)),
            axes: Axes::new(items.iter().map(|i| (axis(i), i.power / power))),
            power,
        }
    }
}

fn bounds(items: &[Item]) -> (V3, V3) {
    let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
    for item in items {
        low = low.min(item.low);
        high = high.max(item.high);
    }
    (low, high)
}

/// The number of bins along each axis, between which a branch may be divided.
const BINS: usize = 12;

/// A set of emitters: bounding box, power, and the sum of their axes weighted by power.
#[derive(Clone, Copy, Debug)]
struct Bin {
    low: V3,
    high: V3,
    axis: V3,
    power: f32,
}

impl Bin {
    const EMPTY: Self = Self {
        low: V3 {
            x: f32::MAX,
            y: f32::MAX,
            z: f32::MAX,
        },
        high: V3 {
            x: f32::MIN,
            y: f32::MIN,
            z: f32::MIN,
        },
        axis: V3::ZERO,
        power: 0.0,
    };

    fn of(item: &Item) -> Self {
        Self {
            low: item.low,
            high: item.high,
            axis: if item.is_isotropic {
                V3::ZERO
            } else {
                item.axis * item.power
            },
            power: item.power,
        }
    }

    fn and(&self, o: &Self) -> Self {
        Self {
            low: self.low.min(o.low),
            high: self.high.max(o.high),
            axis: self.axis + o.axis,
            power: self.power + o.power,
        }
    }

    /// Returns a measure of the error of estimates: power times surface of the box times a measure of the spread of
    /// axes.
    fn cost(&self) -> f32 {
        if self.power <= 0.0 {
            return 0.0;
        }
        let size = (self.high - self.low).max(V3::ZERO);
        let surface = size.x * size.y + size.y * size.z + size.z * size.x;
        let spread = 1.0 - self.axis.length() / self.power;
        self.power * surface * (0.25 + spread)
    }
}

/// Divides emitters where the estimates of both halves are best.
struct ByEstimates;

impl Divide<Item> for ByEstimates {
    fn is_leaf(&self, items: &[Item]) -> bool {
        items.len() == 1 || (items.len() <= LANES && !items.iter().any(|i| i.alone))
    }

    fn cost(&self, items: &[Item]) -> f32 {
        let bins = items.iter().map(Bin::of);
        bins.fold(Bin::EMPTY, |sum, bin| sum.and(&bin)).cost()
    }

    fn split<'a>(&self, items: &'a mut [Item], _: usize) -> [&'a mut [Item]; 2] {
        let middle = |item: &Item| ((item.low + item.high) * 0.5).to_array();
        let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
        for item in items.iter() {
            for (axis, m) in middle(item).into_iter().enumerate() {
                low[axis] = low[axis].min(m);
                high[axis] = high[axis].max(m);
            }
        }
        let bin_of = |item: &Item, axis: usize| {
            let place = (middle(item)[axis] - low[axis]) / (high[axis] - low[axis]);
            ((place * BINS as f32) as usize).min(BINS - 1)
        };
        let mut best = (f32::INFINITY, 0, 0);
        for axis in 0..3 {
            if high[axis] <= low[axis] {
                continue;
            }
            let mut bins = [Bin::EMPTY; BINS];
            for item in items.iter() {
                let bin = &mut bins[bin_of(item, axis)];
                *bin = bin.and(&Bin::of(item));
            }
            let mut after = [0.0; BINS];
            let mut sum = Bin::EMPTY;
            for i in (1..BINS).rev() {
                sum = sum.and(&bins[i]);
                after[i] = sum.cost();
            }
            let mut sum = Bin::EMPTY;
            for i in 1..BINS {
                sum = sum.and(&bins[i - 1]);
                let cost = sum.cost() + after[i];
                if cost < best.0 {
                    best = (cost, axis, i);
                }
            }
        }
        let (_, axis, bin) = best;
        let mut count = 0;
        if bin > 0 {
            items.sort_by_key(|item| bin_of(item, axis) >= bin);
            count = items.iter().filter(|item| bin_of(item, axis) < bin).count();
        }
        if count == 0 || count == items.len() {
            count = items.len() / 2;
        }
        items.split_at_mut(count).into()
    }
}

/// The lists of a [`LightTree`](super::tree::LightTree).
#[derive(Default)]
pub(super) struct Lists {
    pub branches: Vec<f32>,
    pub nodes: Vec<u32>,
    pub places: Vec<[u32; 2]>,
}

impl Lists {
    /// Divides emitters and sorts them into the order of the tree's leaves.
    pub fn shape(items: &mut [Item]) -> Shape {
        if items.is_empty() {
            return Shape::default();
        }
        Shape::of(0, items, &ByEstimates)
    }

    /// Makes the lists of divided emitters, whose numbers are less than `count`.
    pub fn new(shape: &Shape, items: &[Item], count: usize) -> Self {
        let inner = shape.nodes.len();
        // Leaves are numbered after the other nodes.
        let node = |child: u32| child as usize / 2 + inner * (child as usize % 2);
        let mut of_nodes = vec![0..0; inner];
        of_nodes.extend_from_slice(&shape.leaves);
        for (at, children) in shape.nodes.iter().enumerate().rev() {
            let parts = children
                .iter()
                .filter(|c| **c != NONE)
                .map(|&c| &of_nodes[node(c)]);
            let first = parts.clone().map(|p| p.start).min();
            let past = parts.map(|p| p.end).max();
            of_nodes[at] = first.unwrap_or(0)..past.unwrap_or(0);
        }
        let mut lists = Self {
            branches: vec![0.0; LANES * BRANCH * (of_nodes.len() + 1)],
            nodes: vec![NONE; OF_NODE * of_nodes.len()],
            places: vec![[NONE, 0]; count],
        };
        let blocks = lists.branches.chunks_mut(LANES * BRANCH);
        for (at, block) in blocks.enumerate() {
            let mut set = |i, items| set(block, i, Sphere::new(items).numbers());
            let first = OF_NODE * at;
            if at == of_nodes.len() {
                set(0, items);
            } else if at >= inner {
                lists.nodes[first + IS_LEAF] = 1;
                for (i, item) in items[of_nodes[at].clone()].iter().enumerate() {
                    set(i, std::slice::from_ref(item));
                    lists.nodes[first + i] = item.emitter;
                    lists.places[item.emitter as usize] = [at as u32, i as u32];
                }
            } else {
                lists.nodes[first + IS_LEAF] = 0;
                let children = shape.nodes[at].iter().filter(|c| **c != NONE);
                for (i, child) in children.map(|&c| node(c)).enumerate() {
                    set(i, &items[of_nodes[child].clone()]);
                    lists.nodes[first + i] = child as u32;
                    let parent = OF_NODE * child + PARENT;
                    lists.nodes[parent..parent + 2].copy_from_slice(&[at as u32, i as u32]);
                }
            }
        }
        lists
    }
}
