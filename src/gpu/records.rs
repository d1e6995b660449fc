//! Records that a path leaves for its way back.

use crate::cube::*;

use crate::model::{V3, v3};
use crate::trace::PointGradient;

/// Words of a record of a path's point: its triangle, what it was hit by (distance, origin, direction), the
/// throughput that arrives, what was seen from it, and the probability with which the path went on.
pub(super) const RECORD: u32 = 13;
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

/// Words that a path keeps for its way back, one word of all threads after another.
#[apply(record!)]
pub(super) struct Room {
    pub thread: u32,
    pub threads: u32,
}

/// The place of a word of a point's record.
#[cube]
pub(super) fn record_at(room: Room, point: u32, word: u32) -> usize {
    ((point * RECORD + word) * room.threads + room.thread) as usize
}

#[cube]
pub(super) fn keep_vector(records: &mut [u32], room: Room, point: u32, word: u32, v: V3) {
    records[record_at(room, point, word)] = v.x.to_bits();
    records[record_at(room, point, word + 1)] = v.y.to_bits();
    records[record_at(room, point, word + 2)] = v.z.to_bits();
}

#[cube]
pub(super) fn kept(records: &mut [u32], room: Room, point: u32, word: u32) -> f32 {
    f32::from_bits(records[record_at(room, point, word)])
}

#[cube]
pub(super) fn kept_vector(records: &mut [u32], room: Room, point: u32, word: u32) -> V3 {
    v3(
        kept(records, room, point, word),
        kept(records, room, point, word + 1),
        kept(records, room, point, word + 2),
    )
}

/// Words that a path leaves beside its records: the number of its points, and for each what jumps add.
pub(super) const JUMPED: u32 = 14;

/// The place of the number of a path's points.
#[cube]
pub(super) fn points_at(bounces: u32, room: Room) -> usize {
    ((bounces + 1) * RECORD * room.threads + room.thread) as usize
}

/// The place of a word of what jumps add at a point.
#[cube]
pub(super) fn jumped_at(bounces: u32, room: Room, point: u32, word: u32) -> usize {
    let before = (bounces + 1) * RECORD + 1;
    ((before + point * JUMPED + word) * room.threads + room.thread) as usize
}

#[cube]
pub(super) fn get(bounces: u32, records: &mut [u32], room: Room, point: u32, word: u32) -> V3 {
    v3(
        f32::from_bits(records[jumped_at(bounces, room, point, word)]),
        f32::from_bits(records[jumped_at(bounces, room, point, word + 1)]),
        f32::from_bits(records[jumped_at(bounces, room, point, word + 2)]),
    )
}

/// What jumps added at a point of a path.
#[cube]
pub(super) fn jumped(
    bounces: u32,
    records: &mut [u32],
    room: Room,
    point: u32,
    by: &mut PointGradient,
) {
    by.position += get(bounces, records, room, point, 0u32);
    by.geometric += get(bounces, records, room, point, 3u32);
    by.shading.normal += get(bounces, records, room, point, 6u32);
    by.shading.incoming += get(bounces, records, room, point, 9u32);
    by.shading.exponent += f32::from_bits(records[jumped_at(bounces, room, point, 12u32)]);
    // The index of refraction turns what passes a surface.
    by.shading.specular.x += f32::from_bits(records[jumped_at(bounces, room, point, 13u32)]);
}

#[cube]
pub(super) fn put(bounces: u32, records: &mut [u32], room: Room, point: u32, word: u32, v: V3) {
    records[jumped_at(bounces, room, point, word)] = v.x.to_bits();
    records[jumped_at(bounces, room, point, word + 1)] = v.y.to_bits();
    records[jumped_at(bounces, room, point, word + 2)] = v.z.to_bits();
}
