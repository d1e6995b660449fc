//! The environment: its radiance along directions, and directions drawn from a map of it.

use std::f32::consts::{PI, TAU};

use super::scene::Texels;
use crate::model::sky::{SkyDensity, place};
use crate::model::{V3, v3};
use crate::scene::{HostScene, HostTexture};

pub(crate) enum Sky {
    Black,
    Constant(V3),
    Map(Box<SkyMap>),
}

/// An equirectangular map.
pub(crate) struct SkyMap {
    width: usize,
    height: usize,
    texels: Texels,
    pub drawn: SkyDensity,
}

/// Where a direction meets a map: texels, bilinear weights, and how its place changes with it.
struct LookUp {
    texels: [usize; 4],
    at: [f32; 2],
    /// ∂(column, row)/∂direction, in texels.
    slope: [V3; 2],
}

impl LookUp {
    fn weights(&self) -> [f32; 4] {
        let [x, y] = self.at;
        [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y]
    }
}

impl Sky {
    pub fn new(scene: &mut HostScene) -> Self {
        match &mut scene.environment {
            _ if !scene.shines => Self::Black,
            HostTexture::Constant(c) => Self::Constant((*c).into()),
            HostTexture::Image {
                texels,
                width,
                height,
                ..
            } => Self::Map(Box::new(SkyMap::new(
                std::mem::take(texels),
                *width,
                *height,
            ))),
        }
    }

    /// Radiance along a direction.
    #[inline(always)]
    pub fn at(&self, direction: V3) -> V3 {
        match self {
            Self::Black => V3::ZERO,
            Self::Constant(radiance) => *radiance,
            Self::Map(map) => map.at(direction),
        }
    }

    /// Adds the derivatives of g·radiance by texels, where they are asked for; returns that by the direction.
    #[inline(always)]
    pub fn backward(&self, direction: V3, g: V3, texels: &mut [glam::DVec3]) -> V3 {
        match self {
            Self::Black => V3::ZERO,
            Self::Constant(_) => {
                if let Some(sum) = texels.first_mut() {
                    *sum += glam::DVec3::from(g);
                }
                V3::ZERO
            }
            Self::Map(map) => map.backward(direction, g, texels),
        }
    }

    pub fn map(&self) -> Option<&SkyMap> {
        match self {
            Self::Map(map) => Some(map),
            _ => None,
        }
    }

    pub fn is_black(&self) -> bool {
        matches!(self, Self::Black)
    }

    /// How many colours it has.
    pub fn len(&self) -> usize {
        match self {
            Self::Black => 0,
            Self::Constant(_) => 1,
            Self::Map(map) => map.texels.len(),
        }
    }
}

impl SkyMap {
    fn new(list: Vec<f32>, w: usize, h: usize) -> Self {
        let texels = Texels::new(list);
        let brightness = |i: usize| {
            let t = texels.at(i);
            f64::from(t.x.abs() + t.y.abs() + t.z.abs()) / 3.0
        };
        Self {
            width: w,
            height: h,
            drawn: SkyDensity::new(w, h, brightness),
            texels,
        }
    }

    fn look_up(&self, d: V3) -> LookUp {
        let (w, h) = (self.width, self.height);
        let around = (d.x * d.x + d.z * d.z).max(1e-12);
        let [x, y] = place(d, w, h);
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let column = |i: i64| i.rem_euclid(w as i64) as usize;
        let row = |j: i64| j.clamp(0, h as i64 - 1) as usize;
        let texel = |i: i64, j: i64| row(top as i64 + j) * w + column(left as i64 + i);
        LookUp {
            texels: [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)],
            at: [x - left, y - top],
            slope: [
                v3(-d.z, 0.0, d.x) * (w as f32 / TAU / around),
                v3(0.0, -(h as f32) / PI / around.sqrt(), 0.0),
            ],
        }
    }

    /// Radiance along a direction.
    #[inline(never)]
    pub fn at(&self, direction: V3) -> V3 {
        let l = self.look_up(direction);
        let mut sum = V3::ZERO;
        for (&t, w) in l.texels.iter().zip(l.weights()) {
            sum += self.texels.at(t) * w;
        }
        sum
    }

    /// Adds the derivatives of g·radiance by texels, where they are asked for; returns that by the direction.
    #[inline(never)]
    pub fn backward(&self, direction: V3, g: V3, texels: &mut [glam::DVec3]) -> V3 {
        let l = self.look_up(direction);
        if !texels.is_empty() {
            for (&t, w) in l.texels.iter().zip(l.weights()) {
                texels[t] += glam::DVec3::from(g * w);
            }
        }
        let [a, b, p, q] = l.texels.map(|t| self.texels.at(t).dot(g));
        let by_x = (1.0 - l.at[1]) * (b - a) + l.at[1] * (q - p);
        let by_y = (1.0 - l.at[0]) * (p - a) + l.at[0] * (q - b);
        l.slope[0] * by_x + l.slope[1] * by_y
    }
}
