//! Emitters of the tensor program: the choice of the one that a surface point is connected to is the kernels' own,
//! on the host, and carries no gradient.

use rayon::prelude::*;

use crate::error::Result;
use crate::geometry::{Vec3, host_values, host_vectors};
use crate::model::V3;
use crate::sampling::{Emitter, EmitterSampling, Emitters};
use crate::scene::Flattened;

/// The emitters of a scene, for lists of points.
pub(crate) struct Lights(Emitters);

/// The points that emitters are chosen for.
pub(crate) struct Views {
    pub position: Vec<glam::DVec3>,
    /// Time in the shutter, if anything moves.
    pub time: Option<Vec<f64>>,
}

impl Views {
    fn at(&self, i: usize) -> (V3, f32) {
        let time = self.time.as_ref().map_or(0.0, |t| t[i] as f32);
        (self.position[i].as_vec3(), time)
    }
}

/// A hit of a path on an emitter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PathHit {
    pub path: u32,
    /// The triangle of the scene.
    pub emitter: u32,
    /// Weights of corners b and c.
    pub b: f64,
    pub c: f64,
}

/// Rays a piece of work.
const PIECE: usize = 512;

impl Lights {
    /// Reads the emitters back.
    ///
    /// # Errors
    /// If they can't be read.
    pub fn new(scene: &Flattened, sampling: EmitterSampling) -> Result<Self> {
        let index = &scene.emitters;
        let moves = scene.triangles.velocity.is_some();
        if index.is_empty() {
            return Ok(Self(Emitters::new(Vec::new(), moves, sampling)));
        }
        let row = scene.context.index_row(index);
        let vectors = |v: &Vec3| host_vectors(&v.gather(&row));
        let corners = &scene.triangles.corners;
        let (a, b, c) = (
            vectors(&corners.a)?,
            vectors(&corners.b)?,
            vectors(&corners.c)?,
        );
        let velocity = scene.triangles.velocity.as_ref().map(vectors).transpose()?;
        let valid = host_values(&scene.triangles.valid.clone().float())?;
        let emission = host_vectors(scene.materials.emission())?;
        let one = |(i, &k): (usize, &u32)| {
            let cross = (b[i] - a[i]).cross(c[i] - a[i]);
            let material = scene.topology.material[k as usize] as usize;
            let valid = valid[k as usize] > 0.0;
            Emitter {
                triangle: k,
                object: scene.topology.object[k as usize],
                corners: [a[i], b[i], c[i]].map(|v| v.as_vec3()),
                normal: cross.normalize_or_zero().as_vec3(),
                area: if valid { 0.5 * cross.length() } else { 0.0 } as f32,
                velocity: velocity.as_ref().map_or(V3::ZERO, |v| v[i].as_vec3()),
                radiance: (emission[material].abs().element_sum() / 3.0) as f32,
                group: 0,
            }
        };
        let list = index.iter().enumerate().map(one).collect();
        Ok(Self(Emitters::new(list, moves, sampling)))
    }

    /// Whether there is no emitter.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Whether probabilities depend on the point.
    pub fn depends_on_position(&self) -> bool {
        self.0.depends_on_position()
    }

    /// An emitter for each random number: triangles of the scene with their probabilities, and
    /// the rest of the number, uniform again.
    pub fn choose(&self, views: Option<&Views>, random: &[f64]) -> Vec<(u32, f64, f64)> {
        let pieces = random.par_iter().enumerate().with_min_len(PIECE);
        let one = |room: &mut Vec<f32>, (i, &u): (usize, &f64)| {
            let (x, time) = views.map_or((V3::ZERO, 0.0), |v| v.at(i));
            let (k, chance, rest) = self.0.choose(x, time, u as f32, room);
            (self.0.get(k).triangle, f64::from(chance), f64::from(rest))
        };
        pieces.map_init(Vec::new, one).collect()
    }

    /// The probability of the emitter of each hit.
    pub fn chance(&self, views: &Views, hits: &[PathHit]) -> Vec<f64> {
        let mut room = Vec::new();
        let chance = |hit: &PathHit| {
            let (x, time) = views.at(hit.path as usize);
            let k = self.0.of_triangle(hit.emitter);
            k.map_or(0.0, |k| f64::from(self.0.chance(x, time, k, &mut room)))
        };
        hits.iter().map(chance).collect()
    }

    /// The points on the fronts of emitters that rays hit, were nothing in between.
    pub fn intersect(&self, views: &Views, directions: &[glam::DVec3]) -> Vec<PathHit> {
        let one = |i: usize| {
            let mut hits = Vec::new();
            let (x, time) = views.at(i);
            let direction = directions[i].as_vec3();
            self.0.each_hit(self.0.all(), x, time, direction, |hit| {
                hits.push(PathHit {
                    path: i as u32,
                    emitter: self.0.get(hit.emitter).triangle,
                    b: f64::from(hit.weights[0]),
                    c: f64::from(hit.weights[1]),
                });
            });
            hits
        };
        let paths = (0..directions.len()).into_par_iter().with_min_len(PIECE);
        paths.flat_map_iter(one).collect()
    }
}
