//! Searches for edges by points of paths, and the order of points by the number of their searches. With this order,
//! threads of a warp make equally many searches and do not wait for each other.

use softray_kernels::cube::*;

use super::device::GROUP;
use super::job::{Outputs, PathAt};
use super::jumps::{Searches, searches_of};
use super::loss::Loss;
use super::records::Room;
use softray_kernels::sampling::Stream;
use softray_kernels::trace::{NONE, OF_EDGES, PointGradient, REFLECTS, Scene, sampler};

/// Returns the number of searches that a point of a path makes.
#[cube]
fn count(
    scene: &Scene,
    numbers: &Stream,
    bounce: u32,
    counts: f32,
    #[comptime] of_light: bool,
) -> u32 {
    let mut count = 0u32;
    let mut all = Searches::new(searches_of(scene, counts, of_light));
    all.next(scene, numbers, bounce, of_light);
    while all.made {
        count += 1;
        all.next(scene, numbers, bounce, of_light);
    }
    count
}

/// Number of classes of points by the number of their searches. The first class has points with this many searches or
/// more, and each further class has points with one search fewer.
const CLASSES: u32 = 9;

/// Returns the class of a point with `searches` searches, or the number of classes if it makes none.
#[cube]
fn class_of(searches: u32) -> u32 {
    CLASSES - searches.min(CLASSES)
}

/// Number of bits for a point's searches for shadow edges. The bits above store its searches for edges in reflected
/// light.
const OF_LIGHT: u32 = 16;

/// Number of workgroups whose points have an order of their own. A workgroup sums the counts of each such block.
const OF_BLOCK: u32 = 256;
/// Number of words of a block: counts, their total, and space for the threads of [`add_before`].
const BLOCK_WORDS: u32 = 2 * CLASSES * OF_BLOCK + 1 + GROUP;

/// Returns the number of blocks of `points` points.
pub(super) fn blocks_of(points: usize) -> usize {
    points.div_ceil((GROUP * OF_BLOCK) as usize)
}

/// Returns the number of words that the order of `points` points takes behind the records of paths.
pub(super) fn words_of_order(points: usize) -> usize {
    points.next_multiple_of(GROUP as usize) + blocks_of(points) * BLOCK_WORDS as usize
}

/// Returns the numbers of searches of points in the two orders of each block, from the words behind the records. Points
/// without searches are left out.
pub(super) fn in_order(words: &[u32], points: usize) -> Vec<Vec<u32>> {
    let blocks = words[..points].chunks((GROUP * OF_BLOCK) as usize);
    let orders = blocks.flat_map(|block| [0, OF_LIGHT].map(|shift| (block, shift)));
    let of_order = |(block, shift): (&[u32], u32)| {
        let searches = block.iter().map(|n| (n >> shift) & 0xffff);
        let mut searches: Vec<u32> = searches.filter(|&n| n > 0).collect();
        searches.sort_by_key(|&n| CLASSES - n.min(CLASSES));
        searches
    };
    orders.map(of_order).collect()
}

/// Two orders of points behind the records: by searches for shadow edges, and by searches for edges in reflected
/// light. Points are numbered over all paths of a launch: the first points of all paths, then the second ones, each in
/// workgroups of their own. Each block of [`OF_BLOCK`] workgroups (with one thread per point) has its own orders, so that
/// workgroups sum the counts of all blocks in parallel.
///
/// First come the numbers of searches of each point. Then comes, for each block, order, class and workgroup, the
/// number of the workgroup's points in the class, which [`add_before`] replaces by the number of the block's points
/// before them; and after each block the total and space for the threads of [`add_before`].
#[apply(record!)]
pub(super) struct Order {
    first: u32,
    /// The number of workgroups, and how many of them take the points of one number of all paths.
    groups: u32,
    across: u32,
}

/// The counts of a block: its first word, and its number of workgroups.
#[apply(record!)]
struct Block {
    first: u32,
    groups: u32,
}

#[cube]
impl Order {
    /// Returns the orders of paths of at most `points` points.
    pub fn new(room: &Room, points: u32) -> Order {
        let across = room.threads.div_ceil(GROUP);
        Order {
            first: room.words(),
            groups: points * across,
            across,
        }
    }

    /// Returns the path of a point, and its number among the points of the path.
    pub fn path(&self, point: u32) -> (u32, u32) {
        let across = self.across * GROUP;
        (point % across, point / across)
    }

    fn block(&self, block: u32) -> Block {
        let before = block * OF_BLOCK;
        Block {
            first: self.first + self.groups * GROUP + block * BLOCK_WORDS,
            groups: (self.groups - before.min(self.groups)).min(OF_BLOCK),
        }
    }

    /// Returns the index of the numbers of searches of a point.
    fn of_point(&self, point: u32) -> usize {
        (self.first + point) as usize
    }

    /// Returns the class of a point in an order.
    fn class(&self, records: &mut [u32], point: u32, #[comptime] of_light: bool) -> u32 {
        let mut searches = records[self.of_point(point)];
        if of_light {
            searches = searches & ((1u32 << OF_LIGHT) - 1);
        } else {
            searches = searches >> OF_LIGHT;
        }
        class_of(searches)
    }

    /// Returns the point at a place in an order, or [`NONE`] where a block has fewer points.
    pub fn point(&self, records: &mut [u32], place: u32, #[comptime] of_light: bool) -> u32 {
        let which = place / (GROUP * OF_BLOCK);
        let block = self.block(which);
        let mut low = 0u32;
        if !of_light {
            low = CLASSES * block.groups;
        }
        let mut past = low + CLASSES * block.groups;
        let index = records[(block.first + low) as usize] + place % (GROUP * OF_BLOCK);
        let mut point = NONE.runtime();
        if block.groups > 0 && index < records[(block.first + past) as usize] {
            // Find the last class and workgroup with at most `index` points before it.
            while past - low > 1 {
                let middle = (low + past) / 2;
                if records[(block.first + middle) as usize] <= index {
                    low = middle;
                } else {
                    past = middle;
                }
            }
            let class = low / block.groups % CLASSES;
            let mut left = index - records[(block.first + low) as usize];
            point = (which * OF_BLOCK + low % block.groups) * GROUP;
            let mut going = true;
            while going {
                let is = self.class(records, point, of_light) == class;
                going = !is || left > 0;
                if going {
                    if is {
                        left -= 1;
                    }
                    point += 1;
                }
            }
        }
        point
    }
}

/// Counts the searches of each point of a recorded path of `points` points. Sets the derivatives from jumps of these
/// points to zero. The threads of a workgroup then count the points of each class.
#[cube]
pub(super) fn count_searches(
    scene: &Scene,
    loss: &Loss,
    records: &mut [u32],
    room: &Room,
    which: PathAt,
    points: u32,
) {
    let all = scene.bounces + 1;
    let order = Order::new(room, all);
    let g = loss.of_row(scene, which.row);
    let group = CUBE_POS as u32;
    for k in 0..all {
        let mut own = 0u32;
        if k < points {
            let arrival = room.arrival(records, k);
            let carried = g.radiance.times(arrival.throughput);
            let counts = loss.counts_of(which.view, carried);
            let bits = scene.bits_of(scene.material_of(arrival.triangle));
            if counts > 0.0 && bits & REFLECTS != 0 {
                let numbers = sampler(scene, OF_EDGES).stream(which.pixel, which.sample);
                own = count(scene, &numbers, k, counts, false) << OF_LIGHT;
                if comptime!(scene.features.emitters) {
                    own += count(scene, &numbers, k, counts, true);
                }
            }
            let channels = comptime!(Outputs::channels_of_radiance(loss.forward));
            for channel in 0..channels {
                room.keep_jumped(records, k, channel, &PointGradient::default());
            }
        }
        if group < order.across {
            let point = (k * order.across + group) * GROUP + UNIT_POS;
            records[order.of_point(point)] = own;
        }
    }
    sync_storage();
    if group < order.across {
        let mut which_class = UNIT_POS;
        while which_class < 2 * CLASSES * all {
            let own = which_class / (2 * CLASSES) * order.across + group;
            let class = which_class % (2 * CLASSES);
            let mut in_class = 0u32;
            for unit in 0..GROUP {
                let point = own * GROUP + unit;
                let mut of_point = order.class(records, point, true);
                if class >= CLASSES {
                    of_point = CLASSES + order.class(records, point, false);
                }
                if of_point == class {
                    in_class += 1;
                }
            }
            let block = order.block(own / OF_BLOCK);
            let place = block.first + class * block.groups + own % OF_BLOCK;
            records[place as usize] = in_class;
            which_class += GROUP;
        }
    }
}

/// Replaces each count of a block by the sum of the block's counts before it, and writes the total behind them. One
/// workgroup per block runs it, and its threads use the space behind the total. `first` is the first word of the order.
#[cube(launch)]
pub(super) fn add_before(list: &mut [u32], first: u32, points: u32) {
    let groups = points.div_ceil(GROUP);
    let order = Order {
        first,
        groups,
        across: groups,
    };
    let block = order.block(CUBE_POS as u32);
    let count = 2 * CLASSES * block.groups;
    let each = count.div_ceil(GROUP);
    let from = (UNIT_POS * each).min(count);
    let past = (from + each).min(count);
    let mut own = 0u32;
    for i in from..past {
        own += list[(block.first + i) as usize];
    }
    // On a software driver, all elements of CubeCL's shared memory are the same, so threads share a part of the list.
    let room = block.first + count + 1;
    if count > 0 {
        list[(room + UNIT_POS) as usize] = own;
    }
    sync_storage();
    let mut before = 0u32;
    for unit in 0..UNIT_POS {
        before += list[(room + unit) as usize];
    }
    for i in from..past {
        let at = (block.first + i) as usize;
        let sum = before + list[at];
        list[at] = before;
        before = sum;
    }
    if count > 0 && UNIT_POS == GROUP - 1 {
        list[(block.first + count) as usize] = before;
    }
}

#[cfg(test)]
mod tests {
    use super::super::device::{List, client_of, launch};
    use super::*;

    /// Writes the points at all places of an order.
    #[cube(launch)]
    fn list_points(
        records: &mut [u32],
        found: &mut [u32],
        points: u32,
        #[comptime] of_light: bool,
    ) {
        let groups = points.div_ceil(GROUP);
        let order = Order {
            first: 0u32,
            groups,
            across: groups,
        };
        if ABSOLUTE_POS < found.len() {
            found[ABSOLUTE_POS] = order.point(records, ABSOLUTE_POS as u32, of_light);
        }
    }

    /// Each point with searches has one place in its block, and points with more searches come first.
    #[test]
    fn points_in_the_order_of_their_searches() {
        let client = client_of(&crate::device::of_tests()).expect("a GPU");
        let of_block = (GROUP * OF_BLOCK) as usize;
        let points = of_block + 1000;
        let groups = points.div_ceil(GROUP as usize);
        let searches = |point: usize| [point * 7 % 3, point * 5 % 13 % 11].map(|n| n as u32);
        let mut words = vec![0; words_of_order(points)];
        for point in 0..points {
            let [light, reflected] = searches(point);
            words[point] = light | (reflected << OF_LIGHT);
            let (block, group) = (point / of_block, point % of_block / GROUP as usize);
            let own = (groups - block * OF_BLOCK as usize).min(OF_BLOCK as usize);
            let first = groups * GROUP as usize + block * BLOCK_WORDS as usize;
            for (order, n) in [light, reflected].into_iter().enumerate() {
                if n > 0 {
                    let class = (order as u32 * CLASSES + CLASSES - n.min(CLASSES)) as usize;
                    words[first + class * own + group] += 1;
                }
            }
        }
        let [records] = List::send(&client, [u32::as_bytes(&words)]);
        let threads = GROUP as usize * blocks_of(points);
        launch!(&client, threads, add_before(&records, 0, points as u32));
        for (order, of_light) in [(0, true), (1, false)] {
            let found = List::room(&client, points);
            launch!(
                &client,
                points,
                list_points(&records, &found, points as u32, of_light)
            );
            let bytes = client.read_one(found.handle).expect("points");
            let found: &[u32] = u32::from_bytes(&bytes);
            let of = |point: &u32| searches(*point as usize)[order];
            for (block, found) in found.chunks(of_block).enumerate() {
                let first = block * of_block;
                let mut wanted: Vec<u32> = (first as u32..(first + found.len()) as u32).collect();
                wanted.retain(|point| of(point) > 0);
                wanted.sort_by_key(|point| CLASSES - of(point).min(CLASSES));
                let (own, rest) = found.split_at(wanted.len());
                assert_eq!(own, wanted, "{of_light}");
                assert!(rest.iter().all(|&point| point == NONE));
            }
        }
    }
}
