//! The random numbers of a path: those of `sampling`, in words of 32 bits.

use crate::cube::*;

use super::edge_layout::SEED_OF_FILM;
use super::integers::{Wide, mix, product, total, wide};
use super::layout::{BLOCKS, HEIGHT_OF_TABLE, SAMPLES_LOG, TABLES, WIDTH};
use super::reading::Scene;
use crate::model::{V2, v2};

/// Four random numbers.
#[apply(record!)]
pub(super) struct Four {
    pub x: f32,
    pub y: f32,
    pub z: f32,
    pub w: f32,
}

/// A source of random numbers for one path.
#[apply(record!)]
pub(super) struct Stream {
    seed: Wide,
    pub pixel: u32,
    pub sample: u32,
    index: u32,
    block: Wide,
    shuffled: u32,
    stage: Wide,
}

/// `sobol_burley::parts::owen_scramble_rev` (Burley 2020, Vegdahl 2021).
#[cube]
fn owen_scramble(n: u32, scramble: u32) -> u32 {
    let a = n ^ product(n, 0x3d20_adeau32);
    let b = product(total(a, scramble), (scramble >> 16) | 1);
    let c = b ^ product(b, 0x0552_6c56u32);
    c ^ product(c, 0x53a2_2864u32)
}

/// In [0, 1), from the upper bits.
#[cube]
fn uniform(n: u32) -> f32 {
    f32::from_bits((n >> 9) | 0x3f80_0000) - 1.0
}

/// The bits of a number below 2¹⁶ with zeros in between.
#[cube]
fn spread(v: u32) -> u32 {
    let a = (v | (v << 8)) & 0x00ff_00ff;
    let b = (a | (a << 4)) & 0x0f0f_0f0f;
    let c = (b | (b << 2)) & 0x3333_3333;
    (c | (c << 1)) & 0x5555_5555
}

/// The stream of the seed at a place of the header.
#[cube]
fn stream(scene: &Scene, seed: Wide, pixel: u32, sample: u32, samples: u32, pixels: u32) -> Stream {
    let mut index = 0u32;
    let mut block = wide(0u32, 0u32);
    let mut shuffled = 0u32;
    let mut stage = wide(0u32, 0u32);
    if comptime!(scene.features.sobol) {
        let x = pixel % scene.header[WIDTH];
        let y = pixel / scene.header[WIDTH];
        let place = wide(
            spread(x & 0xffff) | (spread(y & 0xffff) << 1),
            spread(x >> 16) | (spread(y >> 16) << 1),
        );
        let run = place.low & ((1u32 << pixels) - 1);
        index = (run << samples) | (sample & ((1u32 << samples) - 1));
        block = mix(seed.xor(place.shifted(pixels))).xor(wide(sample >> samples, 0u32));
        stage = mix(block);
        shuffled = owen_scramble(index.reverse_bits(), stage.low);
    }
    Stream {
        seed,
        pixel,
        sample,
        index,
        block,
        shuffled,
        stage,
    }
}

/// The random numbers of a path, of the stream whose seed is at a place of the header.
#[cube]
pub(super) fn numbers_of(scene: &Scene, seed: usize, pixel: u32, sample: u32) -> Stream {
    let seed = wide(scene.header[seed], scene.header[seed + 1]);
    stream(
        scene,
        seed,
        pixel,
        sample,
        scene.header[SAMPLES_LOG],
        scene.header[BLOCKS],
    )
}

/// Those of samples of the film: a sequence as long as there is for one pixel.
#[cube]
pub(super) fn numbers_of_film(scene: &Scene, sample: u32) -> Stream {
    let seed = wide(scene.header[SEED_OF_FILM], scene.header[SEED_OF_FILM + 1]);
    let pixel = 0u32.runtime();
    stream(scene, seed, pixel, sample, 16u32.runtime(), pixel)
}

#[cube]
impl Stream {
    /// A number that is independent of all others, for a purpose at a bounce.
    fn independent(self, bounce: u32, purpose: u32) -> f32 {
        let stage = mix(self.seed.xor(wide(purpose, bounce)));
        let h = mix(stage.xor(wide(self.sample, self.pixel)));
        (h.high >> 8) as f32 * (1.0f32 / 16_777_216.0f32)
    }

    /// A set of four dimensions of the sequence of the path's block.
    fn of_sequence(self, scene: &Scene, set: u32) -> Four {
        let later = set / HEIGHT_OF_TABLE;
        let mut shuffled = self.shuffled;
        let mut stage = self.stage;
        if later > 0 {
            stage = mix(self.block.xor(wide(0u32, later)));
            shuffled = owen_scramble(self.index.reverse_bits(), stage.low);
        }
        let first = scene.header[TABLES] + (set % HEIGHT_OF_TABLE) * 256;
        let a = first + (shuffled >> 28) * 4;
        let b = first + 64 + ((shuffled >> 24) & 15) * 4;
        let c = first + 128 + ((shuffled >> 20) & 15) * 4;
        let d = first + 192 + ((shuffled >> 16) & 15) * 4;
        let one = mix(stage.xor(wide(set + 1, 0u32)));
        let two = mix(one);
        Four {
            x: dimension(scene, a, b, c, d, one.low),
            y: dimension(scene, a + 1, b + 1, c + 1, d + 1, one.high),
            z: dimension(scene, a + 2, b + 2, c + 2, d + 2, two.low),
            w: dimension(scene, a + 3, b + 3, c + 3, d + 3, two.high),
        }
    }

    /// Film x and y, and for an emitter and a point on it, seen from the first surface.
    pub fn film(self, scene: &Scene) -> Four {
        if comptime!(scene.features.sobol) {
            self.of_sequence(scene, 0u32)
        } else {
            Four {
                x: self.independent(0u32, 0u32),
                y: self.independent(0u32, 1u32),
                z: self.independent(0u32, 6u32),
                w: self.independent(0u32, 7u32),
            }
        }
    }

    /// Lens radius and angle, and time.
    pub fn lens_and_time(self, scene: &Scene) -> Four {
        if comptime!(scene.features.sobol) {
            self.of_sequence(scene, 1u32)
        } else {
            Four {
                x: self.independent(0u32, 2u32),
                y: self.independent(0u32, 3u32),
                z: self.independent(0u32, 4u32),
                w: 0.0f32.runtime(),
            }
        }
    }

    /// For a direction, and for an emitter and a point on it, seen from where it leads.
    pub fn direction(self, scene: &Scene, bounce: u32) -> Four {
        if comptime!(scene.features.sobol) {
            self.of_sequence(scene, 2 + 2 * bounce)
        } else {
            Four {
                x: self.independent(bounce, 11u32),
                y: self.independent(bounce, 12u32),
                z: self.independent(bounce + 1, 6u32),
                w: self.independent(bounce + 1, 7u32),
            }
        }
    }

    /// For the choice of a lobe, for survival, and for a direction to the environment.
    pub fn choices(self, scene: &Scene, bounce: u32) -> Four {
        if comptime!(scene.features.sobol) {
            self.of_sequence(scene, 3 + 2 * bounce)
        } else {
            Four {
                x: self.independent(bounce, 10u32),
                y: self.independent(bounce, 13u32),
                z: self.independent(bounce, 8u32),
                w: self.independent(bounce, 9u32),
            }
        }
    }

    /// Four numbers of a stream that serves one purpose.
    pub fn set(self, scene: &Scene, set: u32) -> Four {
        if comptime!(scene.features.sobol) {
            self.of_sequence(scene, set)
        } else {
            Four {
                x: self.independent(set, 16u32),
                y: self.independent(set, 17u32),
                z: self.independent(set, 18u32),
                w: self.independent(set, 19u32),
            }
        }
    }
}

/// A scrambled coordinate of a point: the sum, without carry, of those of the parts of its index.
#[cube]
fn dimension(scene: &Scene, a: u32, b: u32, c: u32, d: u32, scramble: u32) -> f32 {
    let point = scene.words[a as usize]
        ^ scene.words[b as usize]
        ^ scene.words[c as usize]
        ^ scene.words[d as usize];
    uniform(owen_scramble(point, scramble).reverse_bits())
}

/// A pair of numbers as a point of the unit disk.
#[cube]
pub(super) fn on_disk(radius: f32, angle: f32) -> V2 {
    let turn = crate::model::frame::sin_cos_of_turns(angle);
    v2(radius.sqrt() * turn.cos, radius.sqrt() * turn.sin)
}
