//! Emitters of the tensor program. The code of the kernels chooses the emitter for next-event estimation, on the host.
//! The choice carries no gradient.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use glam::DVec3;
use rayon::iter::Either;
use rayon::prelude::*;

use crate::error::Result;
use crate::geometry::{Context, Vec3, detached, gather_row, host_values, host_vectors};
use crate::scene::{EnvironmentMap, Flattened, LightPlanes, SkyTensors};
use softray_kernels::host::Channel;
use softray_kernels::model::V3;
use softray_kernels::model::delta_light::DeltaLight;
use softray_kernels::model::sky::SkyDensity;
use softray_kernels::model::texture::{Color, Texels, Texture};
use softray_kernels::sampling::{Emitter, EmitterSampling, Emitters, Met, Receiver};

/// The emitters of a scene, for lists of points.
pub(crate) struct Lights {
    pub(super) emitters: Emitters,
}

/// The points for which emitters are chosen.
pub(crate) struct Views {
    pub position: Vec<DVec3>,
    /// The geometric normals on the side that the rays came from.
    pub normal: Vec<DVec3>,
    /// The shutter times, if anything moves.
    pub time: Option<Vec<f64>>,
}

impl Views {
    fn at(&self, i: usize) -> Receiver {
        Receiver {
            position: self.position[i].into(),
            normal: self.normal[i].into(),
            time: self.time.as_ref().map_or(0.0, |t| t[i] as f32),
        }
    }
}

/// A delta light to which a path is connected.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChosenLight {
    pub path: u32,
    /// The index among the delta lights.
    pub light: u32,
    /// The probability of the light among all emitters.
    pub chance: f64,
}

/// A point of an emitter to which a path is connected.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chosen {
    pub path: u32,
    /// The triangle's number in the scene, and the weights of its corners b and c.
    pub emitter: u32,
    pub weights: [f64; 2],
    /// The probability with which light sampling chooses the emitter.
    pub chance: f64,
}

/// The least number of rays in a piece of work.
const PIECE: usize = 512;

impl Lights {
    /// Reads the emitters back from the device.
    pub fn new(scene: &Flattened, sampling: EmitterSampling) -> Result<Self> {
        let moves = scene.triangles.velocity.is_some();
        let size = scene.lights.as_ref().map_or(1.0, |l| l.size);
        let lights = scene.lights.as_ref().map_or(Ok(Vec::new()), read_back)?;
        let emitters = Emitters::new(triangles(scene)?, lights, (moves, size), sampling);
        Ok(Self { emitters })
    }

    /// Returns a point of an emitter, or a delta light, for each pair of random numbers.
    pub(super) fn choose(
        &self,
        views: Option<&Views>,
        u: &[f64],
        v: &[f64],
    ) -> (Vec<Chosen>, Vec<ChosenLight>) {
        let pieces = u.par_iter().zip(v).enumerate().with_min_len(PIECE);
        let one = |room: &mut Vec<u32>, (i, (&u, &v)): (usize, (&f64, &f64))| {
            let nowhere = Receiver {
                position: V3::ZERO,
                normal: V3::ZERO,
                time: 0.0,
            };
            let at = views.map_or(nowhere, |v| v.at(i));
            let (k, chance, rest) = self.emitters.choose(&at, u as f32, room);
            if let Some(light) = self.emitters.light(k) {
                return Either::Right(ChosenLight {
                    path: i as u32,
                    light: light as u32,
                    chance: chance.into(),
                });
            }
            let root = f64::from(rest).sqrt();
            Either::Left(Chosen {
                path: i as u32,
                emitter: self.emitters.get(k).triangle,
                weights: [root * (1.0 - v), root * v],
                chance: chance.into(),
            })
        };
        pieces
            .map_init(Vec::new, one)
            .partition_map(|either| either)
    }

    /// Returns the points where rays hit the fronts of emitters, regardless of occluders. Directions of 0 hit nothing.
    pub(super) fn intersect(&self, views: &Views, directions: &[DVec3]) -> Vec<Chosen> {
        let emitters = &self.emitters;
        let one = |i: usize| {
            let (mut hits, mut room) = (Vec::new(), Vec::new());
            if directions[i] == DVec3::ZERO {
                return hits;
            }
            let (at, mut met) = (views.at(i), Met::default());
            emitters.each_hit_of_all(&at, directions[i].into(), &mut met, |hit| {
                hits.push(Chosen {
                    path: i as u32,
                    emitter: emitters.get(hit.emitter as usize).triangle,
                    weights: [hit.weights.x, hit.weights.y].map(f64::from),
                    chance: emitters.chance(&at, hit.emitter as usize, &mut room).into(),
                });
            });
            hits
        };
        let paths = (0..directions.len()).into_par_iter().with_min_len(PIECE);
        paths.flat_map_iter(one).collect()
    }
}

/// Reads back the emitting triangles.
fn triangles(scene: &Flattened) -> Result<Vec<Emitter>> {
    let index = &scene.emitters;
    if index.is_empty() {
        return Ok(Vec::new());
    }
    let row = scene.context.index_row(index);
    let vectors = |v: &Vec3| host_vectors(&v.gather(&row));
    let corners = &scene.triangles.corners;
    let (a, b) = (vectors(&corners.a)?, vectors(&corners.b)?);
    let c = vectors(&corners.c)?;
    let velocity = scene.triangles.velocity.as_ref().map(vectors).transpose()?;
    let valid = host_values(&scene.triangles.valid.clone().float())?;
    let channel = scene.materials.channel(Channel::Emission.place());
    let emission = host_vectors(&channel.constant)?;
    let mut texels = Texels::default();
    let mut uvs = None;
    if let (Some(atlas), Some(corners)) = (&channel.atlas, &scene.uvs) {
        let atlas = host_vectors(atlas)?;
        let numbers = atlas.iter().flat_map(|t| t.to_array()).map(|v| v as f32);
        texels.push(Arc::new(numbers.collect()));
        uvs = Some([
            vectors(&corners.a)?,
            vectors(&corners.b)?,
            vectors(&corners.c)?,
        ]);
    }
    let radiance = |i: usize, material: usize| {
        let slot = channel.texture[material].as_ref();
        let color = Color {
            constant: emission[material].into(),
            texture: slot.map(|s| Texture::new(s.offset, [s.width, s.height], s.wrap)),
        };
        let uv = |v: DVec3| [v.x as f32, v.y as f32];
        let uvs = uvs
            .as_ref()
            .map(|uvs: &[Vec<DVec3>; 3]| uvs.each_ref().map(|c| uv(c[i])));
        color.mean_over(&texels, uvs.unwrap_or_default())
    };
    let one = |(i, &k): (usize, &u32)| {
        let cross = (b[i] - a[i]).cross(c[i] - a[i]);
        let material = scene.topology.material[k as usize] as usize;
        let valid = valid[k as usize] > 0.0;
        Emitter {
            triangle: k,
            object: scene.topology.object[k as usize],
            corners: [a[i], b[i], c[i]].map(|v| v.into()),
            normal: cross.normalize_or_zero().into(),
            area: if valid { 0.5 * cross.length() } else { 0.0 } as f32,
            velocity: velocity.as_ref().map_or(V3::ZERO, |v| v[i].into()),
            radiance: radiance(i, material),
            group: 0,
        }
    };
    let all = index.iter().enumerate().map(one);
    Ok(all.filter(|e| e.area > 0.0).collect())
}

/// Reads back the delta lights.
fn read_back(planes: &LightPlanes) -> Result<Vec<DeltaLight>> {
    let (position, axis) = (host_vectors(&planes.position)?, host_vectors(&planes.axis)?);
    let strength = host_vectors(&planes.strength)?;
    let (inner, outer) = (
        host_values(&planes.cos_inner)?,
        host_values(&planes.cos_outer)?,
    );
    let one = |i: usize| DeltaLight {
        position: position[i].into(),
        axis: axis[i].into(),
        strength: strength[i].into(),
        kind: planes.kinds[i] as u32,
        cos_inner: inner[i] as f32,
        cos_outer: outer[i] as f32,
    };
    Ok((0..position.len()).map(one).collect())
}

/// An environment: a constant radiance, or a map with its tables on the host.
pub(crate) enum Sky {
    /// `[1, 1]` planes.
    Constant(Vec3),
    Map(SkyMap),
}

pub(crate) struct SkyMap {
    tensors: EnvironmentMap,
    /// RGB of each texel.
    values: Vec<DVec3>,
    drawn: SkyDensity,
}

/// The position of a direction in a map: texels, bilinear weights, and their derivatives with respect to the direction.
struct LookUp {
    texels: [usize; 4],
    weights: [f64; 4],
    /// ∂(column, row)/∂direction, in texels.
    slope: [DVec3; 2],
    at: [f64; 2],
}

impl Sky {
    /// Reads the map back, if there is one. Returns `None` for a scene without an environment.
    pub fn new(scene: &Flattened) -> Result<Option<Self>> {
        match &scene.environment {
            None => Ok(None),
            Some(SkyTensors::Constant(radiance)) => Ok(Some(Self::Constant(radiance.clone()))),
            Some(SkyTensors::Map(map)) => Ok(Some(Self::Map(SkyMap::new(map)?))),
        }
    }

    /// Returns the map, if the environment is one.
    pub fn map(&self) -> Option<&SkyMap> {
        match self {
            Self::Constant(_) => None,
            Self::Map(map) => Some(map),
        }
    }

    /// Returns the radiance along directions, tracked with texels and directions: planes `[1, N]`, or `[1, 1]` if it is
    /// the same for all.
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

    /// Returns the radiance along directions `[1, N]`, tracked with texels and directions.
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

    /// Samples directions with pairs of random numbers. Returns them with their densities per solid angle.
    pub fn choose(&self, u: &[f64], v: &[f64]) -> (Vec<DVec3>, Vec<f64>) {
        let one = |(&u, &v): (&f64, &f64)| {
            let (d, density) = self.drawn.choose(u as f32, v as f32);
            (DVec3::from(d).normalize(), f64::from(density))
        };
        u.iter().zip(v).map(one).unzip()
    }

    /// Returns the density per solid angle with which a direction is sampled.
    pub fn density(&self, d: DVec3) -> f64 {
        self.drawn.density(d.into()).into()
    }
}

/// Returns the indices of light that is not black.
pub(crate) fn nonzero(light: &Vec3) -> Result<Vec<u32>> {
    let sum = detached(&light.x).abs() + detached(&light.y).abs() + detached(&light.z).abs();
    let values = host_values(&sum)?;
    Ok((0..values.len() as u32)
        .filter(|&i| values[i as usize] != 0.0)
        .collect())
}
