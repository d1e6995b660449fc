//! The environment: its radiance along directions, and directions drawn from a map of it.

use super::texture::{Cell, Texels};
use crate::model::V3;
use crate::model::sky::{SkyDensity, place, place_slopes};
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

impl Sky {
    pub fn new(scene: &mut HostScene) -> Self {
        match &mut scene.environment {
            _ if !scene.shines => Self::Black,
            HostTexture::Constant(c) => Self::Constant(glam::DVec3::from(*c).as_vec3()),
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

    /// Adds the derivatives of g·radiance by texels, where they are asked for; returns those by the direction.
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

    /// The number of its colours.
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
        let brightness = |i: usize| f64::from(texels.at(i).abs().element_sum()) / 3.0;
        Self {
            width: w,
            height: h,
            drawn: SkyDensity::new(w, h, brightness),
            texels,
        }
    }

    /// The texels about a direction: columns wrap, rows end at the poles.
    fn cell(&self, d: V3) -> Cell {
        let (w, h) = (self.width, self.height);
        let [x, y] = place(d, w, h);
        Cell::new(x - 0.5, y - 0.5, |i, j| {
            let column = i.rem_euclid(w as i64) as usize;
            let row = j.clamp(0, h as i64 - 1) as usize;
            row * w + column
        })
    }

    /// Radiance along a direction.
    #[inline(never)]
    pub fn at(&self, direction: V3) -> V3 {
        self.cell(direction).colour(&self.texels)
    }

    /// Adds the derivatives of g·radiance by texels, where they are asked for; returns those by the direction.
    #[inline(never)]
    pub fn backward(&self, direction: V3, g: V3, texels: &mut [glam::DVec3]) -> V3 {
        let [by_x, by_y] = self.cell(direction).backward(&self.texels, g, texels);
        let [slope_x, slope_y] = place_slopes(direction, self.width, self.height);
        slope_x * by_x + slope_y * by_y
    }
}
