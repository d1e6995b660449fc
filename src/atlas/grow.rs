//! Charts: connected sets of faces with similar normals.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use glam::DVec3;

use super::surface::{NONE, Surface};

/// The weight of a face's distance from the seed of its chart, against the deviation of its normal.
const COMPACT: f64 = 0.25;
/// The weight of the length that a face adds to the border of its chart.
const STRAIGHT: f64 = 0.1;
/// How often charts grow again from the middles of the last ones.
const ROUNDS: usize = 3;
/// The smallest part of a chart's border that must be shared with the chart into which it is merged.
const SHARED: f64 = 0.2;
/// Charts are not merged across edges with a smaller cosine between the smoothed normals.
const SHARP: f64 = 0.6;

/// A face that may join a chart; the heap returns the smallest cost first.
struct Candidate {
    cost: f64,
    face: u32,
    chart: u32,
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Candidate {}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        let by_cost = other.cost.total_cmp(&self.cost);
        by_cost.then((other.face, other.chart).cmp(&(self.face, self.chart)))
    }
}

/// A chart while it grows.
#[derive(Clone, Copy)]
struct Seed {
    face: u32,
    /// The sum of normals times areas.
    normal: DVec3,
    /// The typical distance from the seed.
    radius: f64,
}

/// Charts that grow: the chart of each face, [`NONE`] before one has it.
struct Growth<'a> {
    surface: &'a Surface,
    of_face: Vec<u32>,
    seeds: Vec<Seed>,
    heap: BinaryHeap<Candidate>,
    /// The largest 1 − cos of the angle between a normal and the mean normal of its chart.
    limit: f64,
    /// Whether mean normals follow the faces that join.
    follow: bool,
}

/// Returns the faces of each chart. The normal of a face, smoothed over its neighbors, deviates from the mean normal
/// of its chart by about `angle` radians at most. Faces without area are charts of their own.
///
/// A first set of charts grows one after the other. Their middles are the seeds of charts that grow at the same time
/// (the proxies of Cohen-Steiner et al. 2004, *Variational Shape Approximation*), a few times. Charts that fit
/// together are merged.
pub(super) fn charts(surface: &Surface, angle: f64) -> Vec<Vec<u32>> {
    let faces = surface.corners.len();
    let mut growth = Growth {
        surface,
        of_face: vec![NONE; faces],
        seeds: Vec::new(),
        heap: BinaryHeap::new(),
        limit: 1.0 - (0.85 * angle).cos(),
        follow: true,
    };
    growth.fill();
    growth.merge(angle);
    for _ in 0..ROUNDS {
        growth.again(1.0 - angle.cos());
        growth.fill();
        growth.merge(angle);
    }
    let mut lists = growth.lists();
    lists.retain(|list| !list.is_empty());
    lists
}

impl Growth<'_> {
    /// The cost of a face in a chart, if its normal is within the limit.
    fn cost(&self, face: u32, chart: u32) -> Option<f64> {
        let (seed, s) = (&self.seeds[chart as usize], self.surface);
        let normal = seed.normal.normalize_or_zero();
        let deviation = 1.0 - normal.dot(s.smooth[face as usize]);
        if deviation > self.limit {
            return None;
        }
        let distance = s.middle(face).distance(s.middle(seed.face)) / seed.radius;
        let mut border = 0.0;
        let mut around = 0.0;
        for (i, &g) in s.across[face as usize].iter().enumerate() {
            let length = s.edge(face, i);
            let inside = g != NONE && self.of_face[g as usize] == chart;
            border += if inside { -length } else { length };
            around += length;
        }
        let border = border / around.max(f64::MIN_POSITIVE);
        Some(deviation + COMPACT * distance + STRAIGHT * border)
    }

    /// Adds a face to a chart, and its neighbors to the heap.
    fn take(&mut self, face: u32, chart: u32) {
        self.of_face[face as usize] = chart;
        if self.follow {
            let s = self.surface;
            self.seeds[chart as usize].normal += s.smooth[face as usize] * s.areas[face as usize];
        }
        for g in self.surface.across[face as usize] {
            if g != NONE
                && self.of_face[g as usize] == NONE
                && let Some(cost) = self.cost(g, chart)
            {
                let face = g;
                self.heap.push(Candidate { cost, face, chart });
            }
        }
    }

    /// Lets all charts of the heap grow.
    fn grow(&mut self) {
        while let Some(next) = self.heap.pop() {
            if self.of_face[next.face as usize] == NONE
                && self.cost(next.face, next.chart).is_some()
            {
                self.take(next.face, next.chart);
            }
        }
    }

    /// Makes charts of all faces that have none, one after the other.
    fn fill(&mut self) {
        let (follow, limit) = (self.follow, self.limit);
        self.follow = true;
        let total: f64 = self.surface.areas.iter().sum();
        for face in 0..self.of_face.len() as u32 {
            if self.of_face[face as usize] != NONE {
                continue;
            }
            let chart = self.seeds.len() as u32;
            let radius = (0.2 * total).sqrt().max(f64::MIN_POSITIVE);
            let normal = DVec3::ZERO;
            self.seeds.push(Seed {
                face,
                normal,
                radius,
            });
            self.take(face, chart);
            self.grow();
        }
        (self.follow, self.limit) = (follow, limit);
    }

    /// The faces of each chart.
    fn lists(&self) -> Vec<Vec<u32>> {
        let mut lists = vec![Vec::new(); self.seeds.len()];
        for (face, &chart) in self.of_face.iter().enumerate() {
            lists[chart as usize].push(face as u32);
        }
        lists
    }

    /// The sum of the smoothed normals of faces times their areas.
    fn normal<'a>(&self, faces: impl IntoIterator<Item = &'a u32>) -> DVec3 {
        let s = self.surface;
        let weighted = |&f: &u32| s.smooth[f as usize] * s.areas[f as usize];
        faces.into_iter().map(weighted).sum()
    }

    /// Lets charts grow at the same time from the faces in the middle of the last charts.
    fn again(&mut self, limit: f64) {
        let s = self.surface;
        let lists = self.lists();
        self.seeds.clear();
        for list in lists.iter().filter(|l| !l.is_empty()) {
            let area: f64 = list.iter().map(|&f| s.areas[f as usize]).sum();
            let weighted = |&f: &u32| s.middle(f) * s.areas[f as usize];
            let center = list.iter().map(weighted).sum::<DVec3>() / area.max(f64::MIN_POSITIVE);
            let radius = area.sqrt().max(f64::MIN_POSITIVE);
            let normal = self.normal(list);
            let unit = normal.normalize_or_zero();
            let distance = |f: u32| {
                let deviation = 1.0 - unit.dot(s.smooth[f as usize]);
                deviation + s.middle(f).distance(center) / radius
            };
            let nearest = list
                .iter()
                .min_by(|&&a, &&b| distance(a).total_cmp(&distance(b)));
            if let Some(&face) = nearest {
                self.seeds.push(Seed {
                    face,
                    normal,
                    radius,
                });
            }
        }
        self.of_face.fill(NONE);
        (self.follow, self.limit) = (false, limit);
        for chart in 0..self.seeds.len() as u32 {
            let face = self.seeds[chart as usize].face;
            self.take(face, chart);
        }
        self.grow();
    }

    /// Merges charts into neighbors, the smallest first, where normals stay within `angle` of their mean.
    fn merge(&mut self, angle: f64) {
        let s = self.surface;
        let mut lists = self.lists();
        let area = |list: &[u32]| list.iter().map(|&f| s.areas[f as usize]).sum::<f64>();
        let mut areas: Vec<f64> = lists.iter().map(|l| area(l)).collect();
        let mut order: Vec<u32> = (0..lists.len() as u32).collect();
        order.sort_by(|&a, &b| areas[a as usize].total_cmp(&areas[b as usize]));
        let mut shared: Vec<(u32, f64)> = Vec::new();
        for chart in order {
            shared.clear();
            for &face in &lists[chart as usize] {
                for (i, &g) in s.across[face as usize].iter().enumerate() {
                    let other = if g == NONE {
                        NONE
                    } else {
                        self.of_face[g as usize]
                    };
                    if other == chart {
                        continue;
                    }
                    let sharp =
                        other != NONE && s.smooth[face as usize].dot(s.smooth[g as usize]) < SHARP;
                    shared.push((if sharp { NONE } else { other }, s.edge(face, i)));
                }
            }
            let border: f64 = shared.iter().map(|e| e.1).sum();
            shared.sort_by_key(|e| e.0);
            let sum = |group: &[(u32, f64)]| (group[0].0, group.iter().map(|e| e.1).sum::<f64>());
            let mut others: Vec<(u32, f64)> = shared.chunk_by(|a, b| a.0 == b.0).map(sum).collect();
            others.retain(|e| e.0 != NONE && e.1 > SHARED * border);
            others.sort_by(|a, b| b.1.total_cmp(&a.1));
            // Small charts may bend more.
            let fits = |other: u32| {
                let (a, b) = (&lists[chart as usize], &lists[other as usize]);
                let small = areas[chart as usize] < 0.05 * areas[other as usize];
                let largest = if small { 1.2 * angle } else { angle };
                let mean = self.normal(a.iter().chain(b)).normalize_or_zero();
                let least = largest.min(1.4).cos();
                a.iter()
                    .chain(b)
                    .all(|&f| mean.dot(s.smooth[f as usize]) >= least)
            };
            if let Some(&(other, _)) = others.iter().find(|e| fits(e.0)) {
                let faces = std::mem::take(&mut lists[chart as usize]);
                faces.iter().for_each(|&f| self.of_face[f as usize] = other);
                areas[other as usize] += areas[chart as usize];
                lists[other as usize].extend(faces);
            }
        }
    }
}
