//! The choice of the emitter that a surface point is connected to, on the host: it carries no gradient.

use glam::DVec3;
use rayon::prelude::*;

use super::strategies::EmitterSampling;
use crate::accel::HostTriangle;
use crate::error::Result;
use crate::geometry::{Vec3, host_values, host_vectors};
use crate::scene::Flattened;

/// The emitter triangles of a scene.
pub(crate) struct Lights {
    triangles: Vec<HostTriangle>,
    /// The triangle of the scene that each is.
    index: Vec<u32>,
    /// Mean radiance of each, not 0: one that is black for now may have a gradient.
    radiance: Vec<f64>,
    /// Probabilities that do not depend on the point.
    fixed: Vec<f64>,
    by_solid_angle: bool,
}

/// The points that emitters are chosen for.
pub(crate) struct Views {
    pub position: Vec<DVec3>,
    /// Time in the shutter, if anything moves.
    pub time: Option<Vec<f64>>,
}

impl Views {
    fn at(&self, i: usize) -> (DVec3, f64) {
        (self.position[i], self.time.as_ref().map_or(0.0, |t| t[i]))
    }
}

/// A hit of a path on an emitter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EmitterHit {
    pub path: u32,
    pub emitter: u32,
    /// Weights of corners b and c.
    pub b: f64,
    pub c: f64,
}

/// Up to here each emitter's solid angle is computed at every point.
const FEW: usize = 64;
/// Emitters under a glancing angle are chosen with at least this share of their power's
/// probability: their light is small there, but its derivative is not.
const BY_POWER: f64 = 0.1;
/// Rays a piece of work.
const PIECE: usize = 512;

impl Lights {
    /// Reads the emitters back.
    ///
    /// # Errors
    /// If they can't be read.
    pub fn new(scene: &Flattened, sampling: EmitterSampling) -> Result<Self> {
        let index = scene.emitters.clone();
        if index.is_empty() {
            return Ok(Self {
                triangles: Vec::new(),
                index,
                radiance: Vec::new(),
                fixed: Vec::new(),
                by_solid_angle: false,
            });
        }
        let row = scene.context.index_row(&index);
        let vectors = |v: &Vec3| host_vectors(&v.gather(&row));
        let corners = &scene.triangles.corners;
        let (a, b, c) = (
            vectors(&corners.a)?,
            vectors(&corners.b)?,
            vectors(&corners.c)?,
        );
        let velocity = scene.triangles.velocity.as_ref().map(vectors).transpose()?;
        let valid = host_values(&scene.triangles.valid.clone().float())?;
        let triangles: Vec<HostTriangle> = (0..index.len())
            .map(|i| {
                let shift = velocity.as_ref().map_or(DVec3::ZERO, |v| v[i]);
                let valid = valid[index[i] as usize] > 0.0;
                HostTriangle::new([a[i], b[i], c[i]], shift, valid)
            })
            .collect();
        let emission = host_vectors(scene.materials.emission())?;
        let radiance: Vec<f64> = index
            .iter()
            .map(|&k| emission[scene.topology.material[k as usize] as usize])
            .map(|e| e.abs().element_sum() / 3.0)
            .collect();
        let largest = radiance.iter().copied().fold(0.0, f64::max);
        let least = if largest > 0.0 { 1e-3 * largest } else { 1.0 };
        let radiance: Vec<f64> = radiance.iter().map(|r| r.max(least)).collect();
        let count = index.len();
        let power = triangles.iter().zip(&radiance).map(|(t, r)| t.area() * r);
        let power: Vec<f64> = power.map(|p| if p.is_finite() { p } else { 0.0 }).collect();
        let total: f64 = power.iter().sum();
        // From anywhere, emitters of one plane are seen about as their areas are.
        let plane = |t: &HostTriangle| t.normal.extend(-t.normal.dot(t.corners[0]));
        let first = plane(&triangles[0]);
        let apart = |t: &HostTriangle| (plane(t) - first).abs().max_element() > 1e-5;
        let spread = triangles.iter().any(apart) || velocity.is_some();
        let uniform = sampling == EmitterSampling::Uniform || total <= 0.0;
        let fixed = if uniform {
            vec![1.0 / count as f64; count]
        } else {
            power.iter().map(|p| p / total).collect()
        };
        Ok(Self {
            by_solid_angle: sampling == EmitterSampling::SolidAngle
                && (2..=FEW).contains(&count)
                && spread
                && !uniform,
            triangles,
            index,
            radiance,
            fixed,
        })
    }

    /// Whether there is no emitter.
    pub fn is_empty(&self) -> bool {
        self.index.is_empty()
    }

    /// Whether probabilities depend on the point.
    pub fn depends_on_position(&self) -> bool {
        self.by_solid_angle
    }

    /// Probabilities of the emitters at a point; `out` is room for them.
    #[inline(always)]
    fn probabilities<'a>(&'a self, view: Option<(DVec3, f64)>, out: &'a mut Vec<f64>) -> &'a [f64] {
        match (self.by_solid_angle, view) {
            (true, Some(view)) => self.seen_from(view, out),
            _ => &self.fixed,
        }
    }

    /// Those that depend on the point.
    fn seen_from<'a>(&'a self, (x, time): (DVec3, f64), out: &'a mut Vec<f64>) -> &'a [f64] {
        out.clear();
        let seen = |t: &HostTriangle| t.solid_angle(x - t.velocity * time).max(0.0);
        out.extend(
            self.triangles
                .iter()
                .zip(&self.radiance)
                .map(|(t, r)| r * seen(t)),
        );
        let total: f64 = out.iter().sum();
        if total <= 0.0 || !total.is_finite() {
            return &self.fixed;
        }
        for (p, fixed) in out.iter_mut().zip(&self.fixed) {
            *p = (1.0 - BY_POWER) * *p / total + BY_POWER * fixed;
        }
        out
    }

    /// An emitter for each random number: triangles of the scene with their probabilities, and
    /// what is left of the number, uniform again.
    pub fn choose(&self, views: Option<&Views>, random: &[f64]) -> Vec<(u32, f64, f64)> {
        let pieces = random.par_iter().enumerate().with_min_len(PIECE);
        let one = |p: &mut Vec<f64>, (i, &u): (usize, &f64)| {
            let (k, chance, rest) = self.choose_one(views.map(|v| v.at(i)), u, p);
            (self.index[k], chance, rest)
        };
        pieces.map_init(Vec::new, one).collect()
    }

    /// The number of an emitter, its probability, and what is left of the random number.
    fn choose_one(
        &self,
        view: Option<(DVec3, f64)>,
        u: f64,
        p: &mut Vec<f64>,
    ) -> (usize, f64, f64) {
        let p = self.probabilities(view, p);
        let mut passed = 0.0;
        let found = p.iter().position(|p| {
            passed += p;
            u < passed
        });
        // Rounding may leave the sum a little under 1.
        let likely = || p.iter().rposition(|&p| p > 0.0).unwrap_or(0);
        let k = found.unwrap_or_else(likely);
        let rest = (u - (passed - p[k])) / p[k];
        (k, p[k], rest.clamp(0.0, 1.0))
    }

    /// The probability of the emitter of each hit.
    pub fn chance(&self, views: Option<&Views>, hits: &[EmitterHit]) -> Vec<f64> {
        let mut p = Vec::new();
        let chance = |h: &EmitterHit| {
            let p = self.probabilities(views.map(|v| v.at(h.path as usize)), &mut p);
            let k = self.index.binary_search(&h.emitter);
            k.map_or(0.0, |k| p[k])
        };
        hits.iter().map(chance).collect()
    }

    /// The hits of rays on the fronts of emitters, were nothing in between.
    pub fn intersect(
        &self,
        views: &Views,
        directions: &[DVec3],
        t_min: f64,
        grazing: f64,
    ) -> Vec<EmitterHit> {
        let one = |i: usize| {
            let (position, time) = views.at(i);
            let mut hits = Vec::new();
            for (k, t) in self.triangles.iter().enumerate() {
                let origin = position - t.velocity * time;
                let (range, reach) = ((t_min, f64::INFINITY), (0.0, f64::INFINITY));
                if let Some(hit) = t.intersect(origin, directions[i], grazing, range, reach)
                    && hit.cosine < 0.0
                {
                    hits.push(EmitterHit {
                        path: i as u32,
                        emitter: self.index[k],
                        b: hit.hit[1],
                        c: hit.hit[2],
                    });
                }
            }
            hits
        };
        let paths = (0..directions.len()).into_par_iter().with_min_len(PIECE);
        paths.flat_map_iter(one).collect()
    }
}
