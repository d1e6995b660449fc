//! The environment: its radiance in a direction, and importance sampling of an environment map.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;

use super::frame::{arc_tangent_of, sin_cos_of_turns};
use super::lists::first_over;
use super::texture::{AROUND, Cell, Texture};
use super::{V2, V3, v2, v3};
use crate::cube::*;
use crate::host::{HostScene, HostTexture};

/// The environment: black if empty, one constant color, or the texels of a map, which directions are sampled from.
#[derive(Default)]
pub struct Sky {
    pub values: Vec<f32>,
    pub drawn: Option<SkyDensity>,
}

impl Sky {
    pub fn new(scene: &mut HostScene) -> Self {
        if !scene.shines {
            return Self::default();
        }
        match &mut scene.environment {
            HostTexture::Constant(c) => Self {
                values: c.map(|v| v as f32).to_vec(),
                drawn: None,
            },
            HostTexture::Image {
                texels,
                width,
                height,
                ..
            } => {
                let values = Arc::unwrap_or_clone(std::mem::take(texels));
                let brightness = |i: usize| {
                    let texel = &values[3 * i..3 * i + 3];
                    texel.iter().map(|&v| f64::from(v.abs())).sum::<f64>() / 3.0
                };
                Self {
                    drawn: Some(SkyDensity::new(*width, *height, brightness)),
                    values,
                }
            }
        }
    }
}

/// An equirectangular map, whose columns repeat and whose rows end at the poles.
///
/// The list that directions are sampled by stores the cumulative probabilities of rows, the cumulative probabilities
/// within each row, and the probability of each texel.
#[apply(record!)]
pub struct Map {
    pub width: u32,
    pub height: u32,
}

#[cfg_attr(feature = "gpu", cube)]
impl Map {
    /// Returns column and row of a direction, in texels.
    #[inline(always)]
    pub fn place(&self, d: V3) -> V2 {
        let around = (d.x * d.x + d.z * d.z).sqrt();
        v2(
            (0.5 + arc_tangent_of(d.x, -d.z) / TAU) * self.width as f32,
            arc_tangent_of(around, d.y) / PI * self.height as f32,
        )
    }

    /// Returns the cell of texels around a direction.
    #[inline(always)]
    pub fn cell(&self, direction: V3) -> Cell {
        let place = self.place(direction);
        let image = Texture {
            first: 0,
            width: self.width,
            height: self.height,
            wrap: AROUND,
        };
        image.cell(place.x - 0.5, place.y - 0.5)
    }

    /// Turns derivatives with respect to column and row into those with respect to the direction.
    #[inline(always)]
    pub fn by_direction(&self, d: V3, by: V2) -> V3 {
        let around = max(d.x * d.x + d.z * d.z, 1e-12);
        let columns = self.width as f32 / TAU;
        let rows = self.height as f32 / PI;
        v3(-d.z, 0.0, d.x) * (by.x * columns / around)
            - v3(0.0, 1.0, 0.0) * (by.y * rows / around.sqrt())
    }

    /// Returns the solid-angle density with which [`Map::choose`] samples a direction.
    #[inline(always)]
    pub fn density(&self, list: &[f32], d: V3) -> f32 {
        let place = self.place(d);
        let x = (max(place.x, 0.0) as u32).min(self.width - 1);
        let y = (max(place.y, 0.0) as u32).min(self.height - 1);
        let sine = max(1.0 - d.y * d.y, 1e-12).sqrt();
        let chance = list[(self.height + (self.height + y) * self.width + x) as usize];
        chance * (self.width * self.height) as f32 / (TAU * PI * sine)
    }

    /// Samples a direction for a pair of uniform numbers.
    #[inline(always)]
    pub fn choose(&self, list: &[f32], u: f32, v: f32) -> V3 {
        let wanted = v * list[(self.height - 1) as usize];
        let y = first_over(list, 0u32, self.height, 1u32, wanted);
        let row = self.height + y * self.width;
        let along = u * list[(row + self.width - 1) as usize];
        let x = first_over(list, row, self.width, 1u32, along);
        let turn = (x as f32 + between(list, row, x, along)) / self.width as f32 - 0.5;
        let polar = (y as f32 + between(list, 0u32, y, wanted)) / self.height as f32;
        let around = sin_cos_of_turns(turn - turn.floor());
        let down = sin_cos_of_turns(0.5 * polar);
        let sine = max(down.sin, 1e-6);
        v3(sine * around.sin, down.cos, -sine * around.cos).normalize()
    }
}

/// Returns the position of a value between entries k − 1 and k of a list, 0 … 1.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
fn between(list: &[f32], first: u32, k: u32, value: f32) -> f32 {
    let mut before = 0.0f32;
    if k > 0 {
        before = list[(first + k - 1) as usize];
    }
    let past = list[(first + k) as usize];
    min(max((value - before) / (past - before), 0.0), 1.0)
}

/// The density with which directions to a map are sampled. The probability of a texel is proportional to its solid
/// angle times a brightness: the mean over the 3 × 3 texels around it, plus half of its own.
pub struct SkyDensity {
    pub map: Map,
    pub list: Vec<f32>,
}

/// Fraction of directions that are sampled uniformly, since a black part may still have a gradient.
const UNIFORM: f64 = 0.02;

impl SkyDensity {
    /// Builds the density of a map from the brightness of its texels, row after row from the top.
    pub fn new(width: usize, height: usize, brightness: impl Fn(usize) -> f64) -> Self {
        let (w, h) = (width, height);
        let solid = |y: usize| (std::f64::consts::PI * (y as f64 + 0.5) / h as f64).sin();
        let mut chance = vec![0.0; w * h];
        for y in 0..h {
            for x in 0..w {
                // Bilinear lookup spreads a texel over its neighbors.
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
                columns.push(row);
            }
            passed += row;
            rows.push(passed);
        }
        let map = Map {
            width: w as u32,
            height: h as u32,
        };
        let list = rows.into_iter().chain(columns).chain(chance);
        let list = list.map(|p: f64| p as f32).collect();
        Self { map, list }
    }

    /// Samples a direction for a pair of uniform numbers; returns it with its solid-angle density.
    #[inline(never)]
    pub fn choose(&self, u: f32, v: f32) -> (V3, f32) {
        let d = self.map.choose(&self.list, u, v);
        (d, self.density(d))
    }

    /// Returns the solid-angle density with which a direction is sampled.
    #[inline(never)]
    pub fn density(&self, d: V3) -> f32 {
        self.map.density(&self.list, d)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The radiance of a map against central differences in the direction, along the sphere.
    #[test]
    fn derivatives_of_light() {
        let texels: Vec<f32> = (0..96).map(|i| (0.7 * i as f32).sin()).collect();
        let map = Map {
            width: 8,
            height: 4,
        };
        let g = v3(0.3, -0.8, 0.5);
        for d in [
            v3(0.48, -0.6, 0.64),
            v3(-0.1, 0.7, 0.7),
            v3(0.02, 0.1, 0.99),
        ] {
            let d = d.normalize();
            let at = |d: V3| g.dot(map.cell(d.normalize()).color(&texels, 0));
            let by_direction = map.by_direction(d, map.cell(d).slopes(&texels, 0, g));
            for step in V3::AXES {
                let h = step.reject_from_normalized(d) * 1e-3;
                let wanted = (at(d + h) - at(d - h)) / 2.0;
                assert!(
                    (by_direction.dot(h) - wanted).abs() < 2e-5,
                    "{d:?}: {wanted}"
                );
            }
        }
    }

    /// Sampled directions have the returned density: the mean of its reciprocal is 4π.
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
