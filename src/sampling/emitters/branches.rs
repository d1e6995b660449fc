//! Emitters divided into branches of a tree: bounds of some of them, and where estimates of both halves are best.

use crate::accel::LANES;
use crate::model::V3;

/// What a tree knows of an emitter.
#[derive(Clone, Copy, Debug)]
pub(super) struct Item {
    pub emitter: u32,
    /// A box around it, over the shutter.
    pub low: V3,
    pub high: V3,
    /// Its normal or direction; light goes up to 90° from there, or in all directions.
    pub axis: V3,
    pub all_round: bool,
    pub power: f32,
    /// Whether it is a leaf of its own.
    pub alone: bool,
}

/// How the axes n of emitters lie, weighted by power.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Axes {
    /// Their mean a.
    pub mean: V3,
    /// The mean of their products, M = E[n nᵀ]: xx, yy, zz, xy, xz, yz.
    pub moments: [f32; 6],
}

impl Axes {
    /// Of axes with their shares of the power; none where light goes in all directions.
    pub fn new(all: impl Iterator<Item = (Option<V3>, f32)>) -> Self {
        let mut this = Self::default();
        for (axis, share) in all {
            let products = match axis {
                None => [4.0, 4.0, 4.0, 0.0, 0.0, 0.0],
                Some(n) => {
                    this.mean += n * share;
                    let (
                        V3 { x, y, z },
                        V3 {
                            x: x2,
                            y: y2,
                            z: z2,
                        },
                    ) = (n, n * n);
                    [x2, y2, z2, x * y, x * z, y * z]
                }
            };
            for (sum, product) in this.moments.iter_mut().zip(products) {
                *sum += product * share;
            }
        }
        this
    }

    /// About the mean of max(n·d, 0) = (n·d + |n·d|)/2, that is (a·d + √(dᵀM d))/2: nothing is under it. `spread` is what
    /// directions differ by, squared.
    #[inline(always)]
    pub fn facing(&self, d: V3, spread: f32) -> f32 {
        let [xx, yy, zz, xy, xz, yz] = self.moments;
        let products = xx * d.x * d.x + yy * d.y * d.y + zz * d.z * d.z;
        let crossed = xy * d.x * d.y + xz * d.x * d.z + yz * d.y * d.z;
        let square = (products + 2.0 * crossed + spread).max(0.0);
        (0.5 * (self.mean.dot(d) + square.sqrt())).max(0.0)
    }
}

/// Some emitters: a sphere around them, their axes and power.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sphere {
    pub centre: V3,
    pub radius: f32,
    pub axes: Axes,
    pub power: f32,
}

impl Sphere {
    pub fn new(items: &[Item]) -> Self {
        let (low, high) = bounds(items);
        let power: f32 = items.iter().map(|i| i.power).sum();
        let axis = |i: &Item| (!i.all_round).then_some(i.axis);
        Self {
            centre: (low + high) * 0.5,
            radius: (high - low).length() * (0.5 * (1.0 + 1e-5)),
            axes: Axes::new(items.iter().map(|i| (axis(i), i.power / power))),
            power,
        }
    }
}

/// Divides emitters into up to eight parts, of which the one whose estimate is worst is divided next.
pub(super) fn parts(items: &mut [Item]) -> Vec<&mut [Item]> {
    let cost = |part: &[Item]| match part.len() {
        1 => -1.0,
        _ => part
            .iter()
            .fold(Bin::EMPTY, |sum, i| sum.and(&Bin::of(i)))
            .cost(),
    };
    let (mut costs, mut parts) = (vec![cost(items)], vec![items]);
    while parts.len() < LANES {
        let worst = (0..costs.len()).max_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        let Some(worst) = worst.filter(|&i| parts[i].len() > 1) else {
            break;
        };
        costs.swap_remove(worst);
        let (left, right) = split(parts.swap_remove(worst));
        costs.extend([cost(left), cost(right)]);
        parts.extend([left, right]);
    }
    parts
}

fn bounds(items: &[Item]) -> (V3, V3) {
    let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
    for item in items {
        low = low.min(item.low);
        high = high.max(item.high);
    }
    (low, high)
}

/// Parts that a branch may be divided between.
const BINS: usize = 12;

/// Some emitters: a box, their power, and the sum of their axes times it.
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
            axis: if item.all_round {
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

    /// Power times surface times a measure of how much axes spread: what makes estimates wrong.
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

/// Divides emitters in two where estimates of both halves are best.
fn split(items: &mut [Item]) -> (&mut [Item], &mut [Item]) {
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
    items.split_at_mut(count)
}
