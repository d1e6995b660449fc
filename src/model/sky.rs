//! The environment: its radiance along directions, and directions drawn from a map of it.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use glam::DVec3;

use super::texture::{Cell, Texels};
use super::{V3, v3};
use crate::scene::{HostScene, HostTexture};

pub(crate) enum Sky {
    Black,
    Constant(V3),
    Map(Box<SkyMap>),
}

pub(crate) struct SkyMap {
    pub width: usize,
    pub height: usize,
    pub texels: Texels,
    pub drawn: SkyDensity,
}

impl Sky {
    pub fn new(scene: &mut HostScene) -> Self {
        match &mut scene.environment {
            _ if !scene.shines => Self::Black,
            HostTexture::Constant(c) => Self::Constant(DVec3::from(*c).into()),
            HostTexture::Image {
                texels,
                width,
                height,
                ..
            } => {
                let texels = Arc::unwrap_or_clone(std::mem::take(texels));
                Self::Map(Box::new(SkyMap::new(texels, *width, *height)))
            }
        }
    }

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
    pub fn backward(&self, direction: V3, g: V3, texels: &mut [DVec3]) -> V3 {
        match self {
            Self::Black => V3::ZERO,
            Self::Constant(_) => {
                if let Some(sum) = texels.first_mut() {
                    *sum += DVec3::from(g);
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
        let texels = Texels(list);
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

    #[inline(never)]
    pub fn at(&self, direction: V3) -> V3 {
        self.cell(direction).colour(&self.texels)
    }

    /// Adds the derivatives of g·radiance by texels, where they are asked for; returns those by the direction.
    #[inline(never)]
    pub fn backward(&self, direction: V3, g: V3, texels: &mut [DVec3]) -> V3 {
        let [by_x, by_y] = self.cell(direction).backward(&self.texels, g, texels);
        let [slope_x, slope_y] = place_slopes(direction, self.width, self.height);
        slope_x * by_x + slope_y * by_y
    }
}

/// The density with which directions to an equirectangular map are drawn: by texel, in proportion to the
/// mean radiance about it times the solid angle.
pub(crate) struct SkyDensity {
    width: usize,
    height: usize,
    /// Probability of each texel.
    pub chance: Vec<f32>,
    /// Sums over rows so far, and within each row.
    pub rows: Vec<f32>,
    pub columns: Vec<f32>,
}

/// The share of directions that are drawn uniformly: a black part may still have a gradient.
const UNIFORM: f64 = 0.02;

impl SkyDensity {
    /// The density for a map whose texels have a brightness, row after row from the top.
    pub fn new(width: usize, height: usize, brightness: impl Fn(usize) -> f64) -> Self {
        let (w, h) = (width, height);
        let solid = |y: usize| (std::f64::consts::PI * (y as f64 + 0.5) / h as f64).sin();
        let mut chance = vec![0.0; w * h];
        for y in 0..h {
            for x in 0..w {
                // Bilinear look-up spreads a texel over its neighbours.
                let mut sum = 0.0;
                for v in y.saturating_sub(1)..(y + 2).min(h) {
                    for u in [(x + w - 1) % w, x, (x + 1) % w] {
                        sum += brightness(v * w + u);
                    }
                }
                let own = brightness(y * w + x);
                chance[y * w + x] = (sum / 9.0 + 0.5 * own) * solid(y);
            }
        }
        let total: f64 = chance.iter().sum();
        let area: f64 = (0..h).map(|y| solid(y) * w as f64).sum();
        let (mut rows, mut columns) = (Vec::with_capacity(h), Vec::with_capacity(w * h));
        let mut passed = 0.0;
        for y in 0..h {
            let mut row = 0.0;
            for p in &mut chance[y * w..(y + 1) * w] {
                let uniform = solid(y) / area;
                let share = if total > 0.0 { *p / total } else { uniform };
                *p = (1.0 - UNIFORM) * share + UNIFORM * uniform;
                row += *p;
                columns.push(row as f32);
            }
            passed += row;
            rows.push(passed as f32);
        }
        Self {
            width,
            height,
            chance: chance.into_iter().map(|p| p as f32).collect(),
            rows,
            columns,
        }
    }

    /// A direction for a pair of random numbers, with its density per solid angle.
    pub fn choose(&self, u: f32, v: f32) -> (V3, f32) {
        let (w, h) = (self.width, self.height);
        let total = self.rows[h - 1];
        let y = self.rows.partition_point(|&p| p <= v * total).min(h - 1);
        let before = if y == 0 { 0.0 } else { self.rows[y - 1] };
        let fy = (v * total - before) / (self.rows[y] - before);
        let row = &self.columns[y * w..(y + 1) * w];
        let x = row.partition_point(|&p| p <= u * row[w - 1]).min(w - 1);
        let before = if x == 0 { 0.0 } else { row[x - 1] };
        let fx = (u * row[w - 1] - before) / (row[x] - before);
        let polar = PI * (y as f32 + fy.clamp(0.0, 1.0)) / h as f32;
        let turn = TAU * ((x as f32 + fx.clamp(0.0, 1.0)) / w as f32 - 0.5);
        let sine = polar.sin().max(1e-6);
        let d = v3(sine * turn.sin(), polar.cos(), -sine * turn.cos()).normalize();
        (d, self.density(d))
    }

    /// The density per solid angle with which a direction is drawn.
    pub fn density(&self, d: V3) -> f32 {
        let (w, h) = (self.width, self.height);
        let [x, y] = place(d, w, h);
        let (x, y) = ((x as usize).min(w - 1), (y as usize).min(h - 1));
        let sine = (1.0 - d.y * d.y).max(1e-12).sqrt();
        self.chance[y * w + x] * (w * h) as f32 / (TAU * PI * sine)
    }
}

/// Column and row of a direction in a map, in texels.
pub(crate) fn place(d: V3, width: usize, height: usize) -> [f32; 2] {
    let x = (0.5 + d.x.atan2(-d.z) / TAU) * width as f32;
    let y = d.y.clamp(-1.0, 1.0).acos() / PI * height as f32;
    [x, y]
}

/// Derivatives of column and row by the direction, in texels.
pub(crate) fn place_slopes(d: V3, width: usize, height: usize) -> [V3; 2] {
    let around = (d.x * d.x + d.z * d.z).max(1e-12);
    [
        v3(-d.z, 0.0, d.x) * (width as f32 / TAU / around),
        v3(0.0, -(height as f32) / PI / around.sqrt(), 0.0),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivatives_of_places() {
        let d = v3(0.48, -0.6, 0.64);
        let slopes = place_slopes(d, 16, 8);
        // Along the sphere: the row is that of a unit vector.
        for step in [v3(1.0, 0.0, 0.0), v3(0.0, 1.0, 0.0), v3(0.0, 0.0, 1.0)] {
            let h = step.reject_from_normalized(d) * 2e-3;
            let (up, down) = (
                place((d + h).normalize(), 16, 8),
                place((d - h).normalize(), 16, 8),
            );
            for k in 0..2 {
                let wanted = (up[k] - down[k]) / 2.0;
                assert!((slopes[k].dot(h) - wanted).abs() < 2e-5, "{k}");
            }
        }
    }

    /// Light of a map, by texels and by the direction along the sphere.
    #[test]
    fn derivatives_of_light() {
        let texels: Vec<f32> = (0..96).map(|i| (0.7 * i as f32).sin()).collect();
        let map = SkyMap::new(texels, 8, 4);
        let g = v3(0.3, -0.8, 0.5);
        for d in [
            v3(0.48, -0.6, 0.64),
            v3(-0.1, 0.7, 0.7),
            v3(0.02, 0.1, 0.99),
        ] {
            let d = d.normalize();
            let mut by_texel = vec![DVec3::ZERO; map.texels.len()];
            let by_direction = map.backward(d, g, &mut by_texel);
            for step in V3::AXES {
                let h = step.reject_from_normalized(d) * 1e-3;
                let at = |d: V3| g.dot(map.at(d.normalize()));
                let wanted = (at(d + h) - at(d - h)) / 2.0;
                assert!(
                    (by_direction.dot(h) - wanted).abs() < 2e-5,
                    "{d:?}: {wanted}"
                );
            }
            // The colour is linear in the texels.
            let mut sum = 0.0;
            for (t, by) in by_texel.iter().enumerate() {
                sum += by.dot(map.texels.at(t).into());
            }
            assert!((sum - f64::from(g.dot(map.at(d)))).abs() < 1e-5, "{d:?}");
        }
    }

    /// Uniform random numbers give directions with the density that is told: its inverse has the mean 4π.
    #[test]
    fn density_of_drawn_directions() {
        let (w, h) = (16, 8);
        let density = SkyDensity::new(w, h, |i| if i % 7 == 0 { 5.0 } else { 0.1 });
        let n = 400;
        let mut mean = 0.0;
        for i in 0..n * n {
            let (u, v) = ((i % n) as f32 + 0.5, (i / n) as f32 + 0.5);
            let (d, p) = density.choose(u / n as f32, v / n as f32);
            assert!((d.length() - 1.0).abs() < 1e-5);
            mean += 1.0 / f64::from(p) / f64::from(n * n);
        }
        let sphere = 4.0 * std::f64::consts::PI;
        assert!((mean / sphere - 1.0).abs() < 2e-3, "{mean}");
    }
}
