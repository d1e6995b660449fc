//! The environment: its radiance along rays, and directions drawn from a map of it.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

use crate::error::Result;
use crate::geometry::{Context, Vec3, detached, gather_row, host_values, host_vectors};
use crate::model::sky::SkyDensity;
use crate::scene::{EnvironmentMap, Flattened, SkyTensors};

/// An environment, with the host-side tables of a map.
pub(crate) enum Sky {
    /// `[1, 1]` planes.
    Constant(Vec3),
    Map(SkyMap),
}

/// A map.
pub(crate) struct SkyMap {
    tensors: EnvironmentMap,
    /// RGB of each texel.
    values: Vec<DVec3>,
    drawn: SkyDensity,
}

/// The place of a direction in a map: texels, bilinear weights, and their derivatives by it.
struct LookUp {
    texels: [usize; 4],
    weights: [f64; 4],
    /// ∂(column, row)/∂direction, in texels.
    slope: [DVec3; 2],
    at: [f64; 2],
}

impl Sky {
    /// Reads the map back, if there is one. None where nothing shines.
    ///
    /// # Errors
    /// If it can't be read.
    pub fn new(scene: &Flattened) -> Result<Option<Self>> {
        match &scene.environment {
            None => Ok(None),
            Some(SkyTensors::Constant(radiance)) => Ok(Some(Self::Constant(radiance.clone()))),
            Some(SkyTensors::Map(map)) => Ok(Some(Self::Map(SkyMap::new(map)?))),
        }
    }

    /// The map, if it is one.
    pub fn map(&self) -> Option<&SkyMap> {
        match self {
            Self::Constant(_) => None,
            Self::Map(map) => Some(map),
        }
    }

    /// Radiance along directions: planes `[1, N]`, or `[1, 1]` where it is the same for all; in the
    /// graph for texels and directions.
    ///
    /// # Errors
    /// If directions can't be read back.
    pub fn radiance(&self, context: &Context, direction: &Vec3) -> Result<Vec3> {
        match self {
            Self::Constant(radiance) => Ok(radiance.clone()),
            Self::Map(map) => map.radiance(context, direction),
        }
    }
}

impl SkyMap {
    fn new(map: &EnvironmentMap) -> Result<Self> {
        let values = host_vectors(&map.texels)?;
        let (w, h) = (map.width, map.height);
        let drawn = SkyDensity::new(w, h, |i| values[i].abs().element_sum() / 3.0);
        Ok(Self {
            tensors: map.clone(),
            values,
            drawn,
        })
    }

    fn look_up(&self, d: DVec3) -> LookUp {
        let (w, h) = (self.tensors.width, self.tensors.height);
        let around = (d.x * d.x + d.z * d.z).max(1e-12);
        let x = (0.5 + d.x.atan2(-d.z) / TAU) * w as f64 - 0.5;
        let y = d.y.clamp(-1.0, 1.0).acos() / PI * h as f64 - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = (x - left, y - top);
        let column = |i: i64| i.rem_euclid(w as i64) as usize;
        let row = |j: i64| j.clamp(0, h as i64 - 1) as usize;
        let texel = |i: i64, j: i64| row(top as i64 + j) * w + column(left as i64 + i);
        LookUp {
            texels: [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)],
            weights: [
                (1.0 - fx) * (1.0 - fy),
                fx * (1.0 - fy),
                (1.0 - fx) * fy,
                fx * fy,
            ],
            slope: [
                DVec3::new(-d.z, 0.0, d.x) * (w as f64 / TAU / around),
                DVec3::new(0.0, -(h as f64) / PI / around.sqrt(), 0.0),
            ],
            at: [fx, fy],
        }
    }

    /// Radiance along directions `[1, N]`, in the graph for texels and directions.
    ///
    /// # Errors
    /// If directions can't be read back.
    pub fn radiance(&self, context: &Context, direction: &Vec3) -> Result<Vec3> {
        let host = host_vectors(direction)?;
        let found: Vec<LookUp> = host.iter().map(|&d| self.look_up(d)).collect();
        let texels = &self.tensors.texels;
        let mut radiance = if texels.is_tracked() {
            let corner = |c: usize| {
                let index: Vec<u32> = found.iter().map(|l| l.texels[c] as u32).collect();
                let weights: Vec<f64> = found.iter().map(|l| l.weights[c]).collect();
                let (index, weights) = (context.index_row(&index), context.row(&weights));
                texels.map(|t| gather_row(t, &index) * weights.clone())
            };
            (1..4).fold(corner(0), |sum, c| sum.add(&corner(c)))
        } else {
            let sum = |l: &LookUp| -> DVec3 {
                let corners = l.texels.iter().zip(l.weights);
                corners.map(|(&t, w)| self.values[t] * w).sum()
            };
            Vec3::from_host(context, &found.iter().map(sum).collect::<Vec<_>>())
        };
        if direction.is_tracked() {
            let change = direction.sub(&direction.detached());
            let plane = |c: usize| {
                let slope = |l: &LookUp| {
                    let [a, b, p, q] = l.texels.map(|t| self.values[t][c]);
                    let by_x = (1.0 - l.at[1]) * (b - a) + l.at[1] * (q - p);
                    let by_y = (1.0 - l.at[0]) * (p - a) + l.at[0] * (q - b);
                    l.slope[0] * by_x + l.slope[1] * by_y
                };
                let slopes: Vec<DVec3> = found.iter().map(slope).collect();
                change.dot(&Vec3::from_host(context, &slopes))
            };
            radiance = radiance.add(&Vec3::new(plane(0), plane(1), plane(2)));
        }
        Ok(radiance)
    }

    /// Directions for pairs of random numbers, with their densities per solid angle.
    pub fn choose(&self, u: &[f64], v: &[f64]) -> (Vec<DVec3>, Vec<f64>) {
        let one = |(&u, &v): (&f64, &f64)| {
            let (d, density) = self.drawn.choose(u as f32, v as f32);
            (DVec3::from(d).normalize(), f64::from(density))
        };
        u.iter().zip(v).map(one).unzip()
    }

    /// The density per solid angle with which a direction is drawn.
    pub fn density(&self, d: DVec3) -> f64 {
        self.drawn.density(d.as_vec3()).into()
    }
}

/// The indices of light that is not black.
pub(crate) fn nonzero(light: &Vec3) -> Result<Vec<u32>> {
    let sum = detached(&light.x).abs() + detached(&light.y).abs() + detached(&light.z).abs();
    let values = host_values(&sum)?;
    Ok((0..values.len() as u32)
        .filter(|&i| values[i as usize] != 0.0)
        .collect())
}
