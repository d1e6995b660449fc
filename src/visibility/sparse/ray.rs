//! Rays on the host, and the surfaces that they meet.

use glam::DVec3;

use crate::accel::HostTriangle;
use crate::error::Result;
use crate::geometry::{host_values, host_vectors};
use crate::visibility::{NO_TRIANGLE, Rays};

/// A surface that a ray meets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    pub triangle: u32,
    pub t: f64,
    pub cosine: f64,
    /// Probability, and its derivatives by logit and t.
    pub p: f64,
    pub slope: f64,
    pub slope_t: f64,
    /// log p, and its derivatives: for the softmax.
    pub log: [f64; 3],
    /// ∂logit/∂(squared distance).
    pub sign: f64,
    pub hit: [f64; 3],
    pub border: [f64; 3],
    /// Weight, 0 for shadow rays.
    pub weight: f64,
}

impl Surface {
    /// The vectors f and m that a·dlogit + b·dt is made of: (f − m)·(do + t dd) over the ray, at the
    /// triangle's place at the ray's time, and m·hit_i − f·border_i at its corners. None if it
    /// counts nothing.
    #[inline(always)]
    pub fn backward(
        &self,
        triangle: &HostTriangle,
        direction: DVec3,
        a: f64,
        b: f64,
        least: f64,
    ) -> Option<[DVec3; 2]> {
        let matters = b != 0.0 || (a != 0.0 && self.slope >= least);
        if !matters {
            return None;
        }
        // d(squared distance) = 2e·(dx − dy) at fixed border weights; x = o + t·d,
        // n·d dt = n·(Σ hit_i dv_i − do − t dd).
        let apart = triangle.point(self.hit) - triangle.point(self.border);
        let f = apart * (2.0 * self.sign * a);
        let m = triangle.normal * ((f.dot(direction) + b) / self.cosine);
        Some([f, m])
    }
}

/// A ray, with what is known of its ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct HostRay {
    pub origin: DVec3,
    pub direction: DVec3,
    pub time: f64,
    /// The triangle that it leaves.
    pub departure: Option<u32>,
    /// The emitter that it ends on, and where.
    pub emitter: Option<u32>,
    pub distance: Option<f64>,
}

pub(super) struct HostRays {
    pub origin: Vec<DVec3>,
    pub direction: Vec<DVec3>,
    pub time: Option<Vec<f64>>,
    arrival: Option<Vec<f64>>,
}

impl HostRays {
    pub fn new(rays: &Rays) -> Result<Self> {
        Ok(Self {
            origin: host_vectors(&rays.origin)?,
            direction: host_vectors(&rays.direction)?,
            time: rays.time.as_ref().map(host_values).transpose()?,
            arrival: rays
                .arrival
                .as_ref()
                .map(|(_, d)| host_values(d))
                .transpose()?,
        })
    }

    pub fn ray(&self, rays: &Rays, i: usize) -> HostRay {
        let emitter = rays.arrival.as_ref().and_then(|(e, _)| e.get(i).copied());
        let emitter = emitter.filter(|&e| e != NO_TRIANGLE);
        HostRay {
            origin: self.origin[i],
            direction: self.direction[i],
            time: self.time.as_ref().map_or(0.0, |t| t[i]),
            departure: rays.departure.as_ref().map(|d| d[i]),
            emitter,
            distance: self.arrival.as_ref().map(|a| a[i]),
        }
    }
}

/// A list for each ray.
#[derive(Clone, Debug)]
pub(super) struct Lists<T> {
    items: Vec<T>,
    /// The beginnings of the lists, and the end.
    starts: Vec<usize>,
}

impl<T> Default for Lists<T> {
    fn default() -> Self {
        Self {
            items: Vec::new(),
            starts: vec![0],
        }
    }
}

impl<T: Copy> Lists<T> {
    /// Adds the list of one more ray.
    pub fn push(&mut self, items: &[T]) {
        self.items.extend_from_slice(items);
        self.starts.push(self.items.len());
    }

    /// Adds the lists of more rays.
    pub fn join(&mut self, other: Self) {
        let base = self.items.len();
        self.items.extend(other.items);
        let starts = other.starts[1..].iter().map(|s| base + s);
        self.starts.extend(starts);
    }

    pub fn of(&self, ray: usize) -> &[T] {
        &self.items[self.starts[ray]..self.starts[ray + 1]]
    }

    pub fn rays(&self) -> usize {
        self.starts.len() - 1
    }
}

/// Rays of a piece.
pub(super) const RAYS_A_PIECE: usize = 512;

/// Rays in pieces for the cores: as many whatever the machine, so that sums come out the same.
pub(super) fn pieces(n: usize) -> Vec<std::ops::Range<usize>> {
    (0..n.div_ceil(RAYS_A_PIECE))
        .map(|i| i * RAYS_A_PIECE..((i + 1) * RAYS_A_PIECE).min(n))
        .collect()
}
