//! The environment: its radiance along directions, and directions drawn from a map of it.

use std::f32::consts::{PI, TAU};

use crate::model::{V3, v3};
use crate::scene::{HostScene, HostTexture};

pub(crate) enum Sky {
    Black,
    Constant(V3),
    Map(Box<SkyMap>),
}

/// An equirectangular map, and the density that directions are drawn with: by texel, in proportion to
/// mean radiance about it times the solid angle.
pub(crate) struct SkyMap {
    width: usize,
    height: usize,
    texels: Vec<V3>,
    /// Probability of each texel.
    chance: Vec<f32>,
    /// Sums over rows so far, and within each row.
    rows: Vec<f32>,
    columns: Vec<f32>,
}

/// The share of directions that are drawn uniformly over the texels: a black part may still have a
/// gradient.
const UNIFORM: f64 = 0.02;

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
    pub fn new(scene: &HostScene) -> Self {
        match &scene.environment {
            _ if !scene.shines => Self::Black,
            HostTexture::Constant(c) => Self::Constant((*c).into()),
            HostTexture::Image {
                texels,
                width,
                height,
                ..
            } => Self::Map(Box::new(SkyMap::new(texels, *width, *height))),
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
    fn new(list: &[[f32; 3]], w: usize, h: usize) -> Self {
        let texels: Vec<V3> = list.iter().map(|t| v3(t[0], t[1], t[2])).collect();
        let at = |x: usize, y: usize| {
            let t = texels[y * w + x];
            f64::from(t.x.abs() + t.y.abs() + t.z.abs()) / 3.0
        };
        let solid = |y: usize| (std::f64::consts::PI * (y as f64 + 0.5) / h as f64).sin();
        let mut chance = vec![0.0; w * h];
        for y in 0..h {
            for x in 0..w {
                // Bilinear look-up spreads a texel over its neighbours.
                let mut sum = 0.0;
                for v in y.saturating_sub(1)..(y + 2).min(h) {
                    for u in [(x + w - 1) % w, x, (x + 1) % w] {
                        sum += at(u, v);
                    }
                }
                chance[y * w + x] = (sum / 9.0 + 0.5 * at(x, y)) * solid(y);
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
            width: w,
            height: h,
            texels,
            chance: chance.into_iter().map(|p| p as f32).collect(),
            rows,
            columns,
        }
    }

    /// Column and row, in texels.
    fn place(&self, d: V3) -> [f32; 2] {
        let x = (0.5 + d.x.atan2(-d.z) / TAU) * self.width as f32;
        let y = d.y.clamp(-1.0, 1.0).acos() / PI * self.height as f32;
        [x, y]
    }

    fn look_up(&self, d: V3) -> LookUp {
        let (w, h) = (self.width, self.height);
        let around = (d.x * d.x + d.z * d.z).max(1e-12);
        let [x, y] = self.place(d);
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
            sum += self.texels[t] * w;
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
        let [a, b, p, q] = l.texels.map(|t| self.texels[t].dot(g));
        let by_x = (1.0 - l.at[1]) * (b - a) + l.at[1] * (q - p);
        let by_y = (1.0 - l.at[0]) * (p - a) + l.at[0] * (q - b);
        l.slope[0] * by_x + l.slope[1] * by_y
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
        let d = v3(sine * turn.sin(), polar.cos(), -sine * turn.cos()).normalized();
        (d, self.density(d))
    }

    /// The density per solid angle with which a direction is drawn.
    pub fn density(&self, d: V3) -> f32 {
        let (w, h) = (self.width, self.height);
        let [x, y] = self.place(d);
        let (x, y) = ((x as usize).min(w - 1), (y as usize).min(h - 1));
        let sine = (1.0 - d.y * d.y).max(1e-12).sqrt();
        self.chance[y * w + x] * (w * h) as f32 / (TAU * PI * sine)
    }
}
