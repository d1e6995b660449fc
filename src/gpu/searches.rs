//! Searches for edges by points of paths, and points in the order of how many they make: threads of a warp that make as
//! many as each other don't wait.

use crate::cube::*;

use super::device::GROUP;
use super::job::Paths;
use super::jumps::{Searches, searches_of};
use super::loss::Loss;
use super::records::Room;
use crate::model::numbers::is_nonzero;
use crate::sampling::Stream;
use crate::trace::{NONE, OF_EDGES, PointGradient, REFLECTS, Scene, sampler};

/// The number of searches that a point of a path makes.
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

/// Points are in classes by the number of their searches, those with the most first: one for each number, and one for so
/// many and more.
const CLASSES: u32 = 9;

/// The class of a point that makes so many; the number of classes where it makes none.
#[cube]
fn class_of(searches: u32) -> u32 {
    CLASSES - searches.min(CLASSES)
}

/// Bits of the number of a point's searches for edges of shadows; the others are that of those for edges that it reflects.
const OF_LIGHT: u32 = 16;

/// Words behind the records of paths that the order of so many points takes.
pub(super) fn words_of_order(points: usize) -> usize {
    let groups = points.div_ceil(GROUP as usize);
    groups * (2 * CLASSES + GROUP) as usize + 1 + GROUP as usize
}

/// The numbers of points of classes that [`add_before`] adds up, where the order of so many points is behind so many
/// words: the first of these numbers, and how many they are.
pub(super) fn places_of_order(records: usize, points: usize) -> (u32, u32) {
    let groups = points.div_ceil(GROUP as usize) as u32;
    (records as u32, 2 * CLASSES * groups)
}

/// The numbers of searches of points in their orders, from the words behind records.
pub(super) fn in_order(words: &[u32], points: usize) -> [Vec<u32>; 2] {
    let (_, places) = places_of_order(0, points);
    let counted = &words[(places + 1 + GROUP) as usize..][..points];
    [0, OF_LIGHT].map(|shift| {
        let searches = counted.iter().map(|n| (n >> shift) & 0xffff);
        let mut searches: Vec<u32> = searches.filter(|&n| n > 0).collect();
        searches.sort_by_key(|&n| CLASSES - n.min(CLASSES));
        searches
    })
}

/// Where two orders of points lie behind records, by their searches for edges of shadows and for edges that they reflect:
/// for each order, class and workgroup of threads, one a point, how many of its points are in the class, which become the
/// number of points before these; then the number of all, room for the threads that add these up, and the numbers of
/// searches of each point.
#[apply(record!)]
pub(super) struct Order {
    first: u32,
    /// Workgroups.
    groups: u32,
}

#[cube]
impl Order {
    pub fn new(room: &Room, points: u32) -> Order {
        Order {
            first: room.words(),
            groups: points.div_ceil(GROUP),
        }
    }

    /// The place of the number of a workgroup's points in a class; those of the second order are behind the first's.
    fn place(&self, class: u32, group: u32) -> usize {
        (self.first + class * self.groups + group) as usize
    }

    /// The place of the numbers of searches of a point.
    fn of_point(&self, point: u32) -> usize {
        (self.first + 2 * CLASSES * self.groups + 1 + GROUP + point) as usize
    }

    /// The class of a point in an order.
    fn class(&self, records: &mut [u32], point: u32, #[comptime] of_light: bool) -> u32 {
        let mut searches = records[self.of_point(point)];
        if of_light {
            searches = searches & ((1u32 << OF_LIGHT) - 1);
        } else {
            searches = searches >> OF_LIGHT;
        }
        class_of(searches)
    }

    /// The point at a place in an order; past the last place a number that no point has.
    pub fn point(&self, records: &mut [u32], place: u32, #[comptime] of_light: bool) -> u32 {
        let mut low = 0u32;
        if !of_light {
            low = CLASSES * self.groups;
        }
        let mut past = low + CLASSES * self.groups;
        let index = records[(self.first + low) as usize] + place;
        let mut point = NONE.runtime();
        if index < records[(self.first + past) as usize] {
            // The last class and workgroup before which are not more.
            while past - low > 1 {
                let middle = (low + past) / 2;
                if records[(self.first + middle) as usize] <= index {
                    low = middle;
                } else {
                    past = middle;
                }
            }
            let class = low / self.groups % CLASSES;
            let mut left = index - records[(self.first + low) as usize];
            point = low % self.groups * GROUP;
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

/// Counts the searches of each point of the paths that left records, and points of each class. Points without any have
/// nothing from jumps.
#[cube(launch)]
pub(super) fn count_searches(paths: Paths, loss: Loss, records: &mut [u32], points: u32) {
    let threads = paths.piece.threads();
    let thread = ABSOLUTE_POS as u32 % threads;
    let k = ABSOLUTE_POS as u32 / threads;
    let which = paths.of_thread(thread);
    let scene = paths.views.scene(which.view);
    let room = Room::new(thread, threads, scene.bounces);
    let g = loss.of_row(&scene, which.row);
    let mut own = 0u32;
    // Paths have fewer points than there are threads for.
    if is_nonzero(g.size()) && k < records[room.points()] {
        let arrival = room.arrival(records, k);
        let carried = g.radiance.times(arrival.throughput);
        let counts = loss.counts_of(which.view, carried);
        let bits = scene.bits_of(scene.material_of(arrival.triangle));
        if counts > 0.0 && bits & REFLECTS != 0 {
            let numbers = sampler(&scene, OF_EDGES).stream(which.pixel, which.sample);
            own = count(&scene, &numbers, k, counts, false) << OF_LIGHT;
            if comptime!(scene.features.emitters) {
                own += count(&scene, &numbers, k, counts, true);
            }
        }
        room.keep_jumped(records, k, &PointGradient::default());
    }
    let order = Order::new(&room, points);
    let group = CUBE_POS as u32;
    if group < order.groups {
        records[order.of_point(ABSOLUTE_POS as u32)] = own;
    }
    sync_storage();
    if group < order.groups && UNIT_POS < 2 * CLASSES {
        let mut in_class = 0u32;
        for unit in 0..GROUP {
            let point = group * GROUP + unit;
            let mut class = order.class(records, point, true);
            if UNIT_POS >= CLASSES {
                class = CLASSES + order.class(records, point, false);
            }
            if class == UNIT_POS {
                in_class += 1;
            }
        }
        records[order.place(UNIT_POS, group)] = in_class;
    }
}

/// Turns numbers in a list into the sums of those before them, and the word behind them into their sum; by one workgroup,
/// whose threads have room behind that.
#[cube(launch)]
pub(super) fn add_before(list: &mut [u32], first: u32, count: u32) {
    let each = count.div_ceil(GROUP);
    let from = (UNIT_POS * each).min(count);
    let past = (from + each).min(count);
    let mut own = 0u32;
    for i in from..past {
        own += list[(first + i) as usize];
    }
    // Elements of CubeCL's shared memory are one on a software driver, so threads share a part of the list.
    let room = first + count + 1;
    list[(room + UNIT_POS) as usize] = own;
    sync_storage();
    let mut before = 0u32;
    for unit in 0..UNIT_POS {
        before += list[(room + unit) as usize];
    }
    for i in from..past {
        let at = (first + i) as usize;
        let sum = before + list[at];
        list[at] = before;
        before = sum;
    }
    if UNIT_POS == GROUP - 1 {
        list[(first + count) as usize] = before;
    }
}

#[cfg(test)]
mod tests {
    use burn::backend::DispatchDevice;

    use super::super::device::{List, launch};
    use super::*;

    /// The points at all places of an order.
    #[cube(launch)]
    fn list_points(
        records: &mut [u32],
        found: &mut [u32],
        points: u32,
        #[comptime] of_light: bool,
    ) {
        let order = Order::new(&Room::new(0u32, 0u32, 0u32), points);
        if ABSOLUTE_POS < found.len() {
            found[ABSOLUTE_POS] = order.point(records, ABSOLUTE_POS as u32, of_light);
        }
    }

    /// Each point that makes searches is at one place, those that make more before those that make fewer.
    #[test]
    fn points_in_the_order_of_their_searches() {
        let name = match std::env::var("SOFTRAY_WGPU_KIND").as_deref() {
            Ok("cpu") => "wgpu:cpu",
            _ => "wgpu",
        };
        let device = crate::device::named(Some(name)).expect("a device");
        let DispatchDevice::Cube(cube) = device.inner().as_dispatch().clone() else {
            panic!("no GPU")
        };
        let client = cube.client();
        let points = 1000;
        let groups = points.div_ceil(GROUP as usize);
        let searches = |point: usize| [point * 7 % 3, point * 5 % 13 % 11].map(|n| n as u32);
        let (first, count) = places_of_order(0, points);
        let mut words = vec![0; words_of_order(points)];
        for point in 0..points {
            let [light, reflected] = searches(point);
            words[(count + 1 + GROUP) as usize + point] = light | (reflected << OF_LIGHT);
            for (order, n) in [light, reflected].into_iter().enumerate() {
                if n > 0 {
                    let class = (order as u32 * CLASSES + CLASSES - n.min(CLASSES)) as usize;
                    words[class * groups + point / GROUP as usize] += 1;
                }
            }
        }
        let [records] = List::send(&client, [u32::as_bytes(&words)]);
        launch!(&client, 1, add_before(&records, first, count));
        for (order, of_light) in [(0, true), (1, false)] {
            let found = List::room(&client, points);
            launch!(
                &client,
                points,
                list_points(&records, &found, points as u32, of_light)
            );
            let bytes = client.read_one(found.handle).expect("points");
            let found: &[u32] = u32::from_bytes(&bytes);
            let mut wanted: Vec<u32> = (0..points as u32).collect();
            let of = |point: &u32| searches(*point as usize)[order];
            wanted.retain(|point| of(point) > 0);
            wanted.sort_by_key(|point| CLASSES - of(point).min(CLASSES));
            let (own, rest) = found.split_at(wanted.len());
            assert_eq!(own, wanted, "{of_light}");
            assert!(rest.iter().all(|&point| point == NONE));
        }
    }
}
