//! Records that a path stores for its backward pass.

use softray_kernels::cube::*;

use softray_kernels::model::{V3, v3};
use softray_kernels::trace::{Point, PointGradient, Scene, point_at};

/// Number of words in the record of a path's point: the arrival ([`Arrival`]), the bits of visible lights, and the
/// probability with which the path continued.
pub(super) const RECORD: u32 = 13;
pub(super) const OF_TRIANGLE: u32 = 0;
pub(super) const OF_BITS: u32 = 11;
pub(super) const OF_SURVIVAL: u32 = 12;
/// Bits of a record. They mark visible lights: the sampled emitter, emitters along the BSDF direction (one bit each,
/// up to [`MAX_BIT_ALONG`]), and the map in the sampled direction and in the BSDF direction. The last two bits mark
/// that the path continued, and that it ended in the environment.
pub(super) const SAW_EMITTER: u32 = 1;
pub(super) const SAW_ALONG: u32 = 2;
pub(super) const MAX_BIT_ALONG: u32 = 26;
pub(super) const SAW_MAP: u32 = 1 << 28;
pub(super) const SAW_MAP_ALONG: u32 = 1 << 29;
pub(super) const WENT_ON: u32 = 1 << 30;
pub(super) const ESCAPED: u32 = 1 << 31;
/// Number of words of a point's derivatives from jumps, for each channel of radiance of forward mode. They lie behind the
/// path's records, the number of its points and its light.
pub(super) const JUMPED: u32 = 14;
/// Number of words of a path: the number of its points, and its light.
pub(super) const OF_PATH: u32 = 4;

/// The layout of the words of a path: each word is stored for all threads, then the next word.
#[apply(record!)]
pub(super) struct Room {
    thread: u32,
    pub threads: u32,
    bounces: u32,
    /// The number of derivatives from jumps of each point.
    channels: u32,
}

/// A surface point that a path reached: the triangle, the ray that hit it, and the throughput at the point.
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
    /// Returns the surface point at a shutter time, after `bounce` bounces.
    pub fn point(&self, scene: &Scene, time: f32, bounce: u32) -> Point {
        let t = self.distance;
        let direction = self.incoming;
        let near = self.origin + direction * t;
        point_at(scene, self.triangle, near, t, direction, time, bounce)
    }
}

#[cube]
impl Room {
    pub fn new(thread: u32, threads: u32, bounces: u32, channels: u32) -> Room {
        Room {
            thread,
            threads,
            bounces,
            channels,
        }
    }

    /// Returns the index of a word of a point's record. The record after the last possible point stores the number of
    /// points, the path's light and the derivatives from jumps.
    pub fn at(&self, point: u32, word: u32) -> usize {
        ((point * RECORD + word) * self.threads + self.thread) as usize
    }

    /// Returns the index of the number of a path's points.
    pub fn points(&self) -> usize {
        self.at(self.bounces + 1, 0u32)
    }

    /// Returns the number of words of the records of all paths, including the derivatives from jumps.
    pub fn words(&self) -> u32 {
        let points = self.bounces + 1;
        (points * (RECORD + self.channels * JUMPED) + OF_PATH) * self.threads
    }

    /// Stores the number of a path's points and its light.
    pub fn keep_path(&self, records: &mut [u32], points: u32, light: V3) {
        records[self.points()] = points;
        self.keep_vector(records, self.bounces + 1, 1u32, light);
    }

    /// Returns the light of a path.
    pub fn light(&self, records: &mut [u32]) -> V3 {
        self.vector(records, self.bounces + 1, 1u32)
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

    /// Returns the first word of the derivatives of a channel from jumps at a point.
    fn jumped(&self, point: u32, channel: u32) -> u32 {
        OF_PATH + (point * self.channels + channel) * JUMPED
    }

    /// Stores the derivatives of a channel from jumps at a point.
    pub fn keep_jumped(&self, records: &mut [u32], point: u32, channel: u32, by: &PointGradient) {
        let last = self.bounces + 1;
        let first = self.jumped(point, channel);
        self.keep_vector(records, last, first, by.position);
        self.keep_vector(records, last, first + 3, by.geometric);
        self.keep_vector(records, last, first + 6, by.shading.normal);
        self.keep_vector(records, last, first + 9, by.shading.incoming);
        records[self.at(last, first + 12)] = by.shading.exponent.to_bits();
        // In dielectrics this is the index of refraction, which turns refracted directions.
        records[self.at(last, first + 13)] = by.shading.specular.x.to_bits();
    }

    /// Adds the stored derivatives of a channel from jumps at a point to `by`.
    pub fn add_jumped(
        &self,
        records: &mut [u32],
        point: u32,
        channel: u32,
        by: &mut PointGradient,
    ) {
        let last = self.bounces + 1;
        let first = self.jumped(point, channel);
        by.position += self.vector(records, last, first);
        by.geometric += self.vector(records, last, first + 3);
        by.shading.normal += self.vector(records, last, first + 6);
        by.shading.incoming += self.vector(records, last, first + 9);
        by.shading.exponent += self.number(records, last, first + 12);
        by.shading.specular.x += self.number(records, last, first + 13);
    }
}
