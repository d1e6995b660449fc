//! Records that a path leaves for its way back.

use crate::cube::*;

use crate::model::{V3, v3};
use crate::trace::{Point, PointGradient, Scene, point_at};

/// Words of a record of a path's point: where it arrived ([`Arrival`]), what was seen from it, and the probability with
/// which the path went on.
pub(super) const RECORD: u32 = 13;
pub(super) const OF_TRIANGLE: u32 = 0;
pub(super) const OF_BITS: u32 = 11;
pub(super) const OF_SURVIVAL: u32 = 12;
/// What was seen from a point, bit by bit: the emitter that was drawn, those along the way on (one bit each, as
/// many as there is room for), the map in the direction that was drawn and in that of the way on; whether the
/// path went on, and whether it ended in the environment.
pub(super) const SAW_EMITTER: u32 = 1;
pub(super) const SAW_ALONG: u32 = 2;
pub(super) const MOST_ALONG: u32 = 26;
pub(super) const SAW_MAP: u32 = 1 << 28;
pub(super) const SAW_MAP_ALONG: u32 = 1 << 29;
pub(super) const WENT_ON: u32 = 1 << 30;
pub(super) const ESCAPED: u32 = 1 << 31;
/// Words that a path leaves beside its records: the number of its points, and for each what jumps add.
pub(super) const JUMPED: u32 = 14;

/// Where the words of a path are: one word of all threads after another.
#[apply(record!)]
pub(super) struct Room {
    thread: u32,
    threads: u32,
    bounces: u32,
}

/// A surface point that a path came to: a triangle, what it was hit by, and the throughput that arrives.
#[apply(record!)]
pub(super) struct Arrival {
    pub triangle: u32,
    pub distance: f32,
    pub origin: V3,
    pub incoming: V3,
    pub throughput: V3,
}

#[cube]
impl Arrival {
    /// The point at a time in the shutter.
    pub fn point(&self, scene: &Scene, time: f32) -> Point {
        let t = self.distance;
        let direction = self.incoming;
        let near = self.origin + direction * t;
        point_at(scene, self.triangle, near, t, direction, time)
    }
}

#[cube]
impl Room {
    pub fn new(thread: u32, threads: u32, bounces: u32) -> Room {
        Room {
            thread,
            threads,
            bounces,
        }
    }

    /// The place of a word of a point's record. That of the first point that a path does not come to has the number of
    /// its points, and what jumps add.
    pub fn at(&self, point: u32, word: u32) -> usize {
        ((point * RECORD + word) * self.threads + self.thread) as usize
    }

    /// The place of the number of a path's points.
    pub fn points(&self) -> usize {
        self.at(self.bounces + 1, 0u32)
    }

    /// Words of the records of all paths, with what jumps add.
    pub fn words(&self) -> u32 {
        let points = self.bounces + 1;
        (points * (RECORD + JUMPED) + 1) * self.threads
    }

    fn keep_vector(&self, records: &mut [u32], point: u32, word: u32, v: V3) {
        records[self.at(point, word)] = v.x.to_bits();
        records[self.at(point, word + 1)] = v.y.to_bits();
        records[self.at(point, word + 2)] = v.z.to_bits();
    }

    pub fn number(&self, records: &mut [u32], point: u32, word: u32) -> f32 {
        f32::from_bits(records[self.at(point, word)])
    }

    fn vector(&self, records: &mut [u32], point: u32, word: u32) -> V3 {
        v3(
            self.number(records, point, word),
            self.number(records, point, word + 1),
            self.number(records, point, word + 2),
        )
    }

    pub fn keep_arrival(&self, records: &mut [u32], point: u32, a: &Arrival) {
        records[self.at(point, OF_TRIANGLE)] = a.triangle;
        records[self.at(point, 1u32)] = a.distance.to_bits();
        self.keep_vector(records, point, 2u32, a.origin);
        self.keep_vector(records, point, 5u32, a.incoming);
        self.keep_vector(records, point, 8u32, a.throughput);
    }

    pub fn arrival(&self, records: &mut [u32], point: u32) -> Arrival {
        Arrival {
            triangle: records[self.at(point, OF_TRIANGLE)],
            distance: self.number(records, point, 1u32),
            origin: self.vector(records, point, 2u32),
            incoming: self.vector(records, point, 5u32),
            throughput: self.vector(records, point, 8u32),
        }
    }

    /// Keeps what jumps add at a point.
    pub fn keep_jumped(&self, records: &mut [u32], point: u32, by: &PointGradient) {
        let last = self.bounces + 1;
        let first = 1 + point * JUMPED;
        self.keep_vector(records, last, first, by.position);
        self.keep_vector(records, last, first + 3, by.geometric);
        self.keep_vector(records, last, first + 6, by.shading.normal);
        self.keep_vector(records, last, first + 9, by.shading.incoming);
        records[self.at(last, first + 12)] = by.shading.exponent.to_bits();
        // The index of refraction turns what passes a surface.
        records[self.at(last, first + 13)] = by.shading.specular.x.to_bits();
    }

    /// Adds what jumps added at a point.
    pub fn add_jumped(&self, records: &mut [u32], point: u32, by: &mut PointGradient) {
        let last = self.bounces + 1;
        let first = 1 + point * JUMPED;
        by.position += self.vector(records, last, first);
        by.geometric += self.vector(records, last, first + 3);
        by.shading.normal += self.vector(records, last, first + 6);
        by.shading.incoming += self.vector(records, last, first + 9);
        by.shading.exponent += self.number(records, last, first + 12);
        by.shading.specular.x += self.number(records, last, first + 13);
    }
}
