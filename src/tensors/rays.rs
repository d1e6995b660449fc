//! Rays in tensors.

use burn::tensor::{IndexingUpdateOp, Tensor};
use glam::DVec3;

use crate::error::Result;
use crate::geometry::{Context, Vec3, gather_row, host_values, host_vectors};

/// The emitter of a shadow ray that ends on no surface.
pub const NO_TRIANGLE: u32 = u32::MAX;

/// Rays o + t·d with |d| = 1, in rows `[1, N]`. Origins are relative to the center of the bounds, in the triangles'
/// unit.
#[derive(Clone, Debug)]
pub struct Rays {
    /// Origins in the frame of static objects.
    pub origin: Vec3,
    pub direction: Vec3,
    /// The shutter time, if anything moves.
    pub time: Option<Tensor<2>>,
    /// The triangle that each ray leaves, if the rays leave surfaces.
    pub departure: Option<Vec<u32>>,
    /// For shadow rays, the emitter triangle on which each ray ends ([`NO_TRIANGLE`] for a delta light), and the
    /// untracked distance to it.
    pub arrival: Option<(Vec<u32>, Tensor<2>)>,
}

impl Rays {
    pub fn len(&self) -> usize {
        self.direction.x.dims()[1]
    }

    /// Returns the listed rays, in any order, each as often as it is listed.
    pub(crate) fn pick(&self, context: &Context, which: &[u32]) -> Self {
        if is_identity(which, self.len()) {
            return self.clone();
        }
        let index = context.index_row(which);
        let of = |list: &[u32]| which.iter().map(|&i| list[i as usize]).collect();
        let row = |row: &Tensor<2>| gather_row(row.clone(), &index);
        Self {
            origin: self.origin.gather(&index),
            direction: self.direction.gather(&index),
            time: self.time.as_ref().map(row),
            departure: self.departure.as_ref().map(|d| of(d)),
            arrival: (self.arrival.as_ref()).map(|(emitters, d)| (of(emitters), row(d))),
        }
    }

    /// Returns the origins in the frames of objects with a velocity (one for each ray).
    pub(crate) fn origin_for(&self, velocity: Option<&Vec3>) -> Vec3 {
        match (&self.time, velocity) {
            (Some(time), Some(velocity)) => self.origin.sub(&velocity.scale(time)),
            _ => self.origin.clone(),
        }
    }
}

/// A ray on the host, with its ends as far as they are given.
#[derive(Clone, Copy, Debug)]
pub struct HostRay {
    pub origin: DVec3,
    pub direction: DVec3,
    pub time: f64,
    /// The triangle that the ray leaves.
    pub departure: Option<u32>,
    /// The emitter on which the ray ends, and the distance to it.
    pub emitter: Option<u32>,
    pub distance: Option<f64>,
}

impl Rays {
    /// Reads the rays back.
    pub fn host(&self) -> Result<Vec<HostRay>> {
        let (origin, direction) = (host_vectors(&self.origin)?, host_vectors(&self.direction)?);
        let time = self.time.as_ref().map(host_values).transpose()?;
        let distance = self.arrival.as_ref().map(|(_, d)| host_values(d));
        let distance = distance.transpose()?;
        let one = |i: usize| HostRay {
            origin: origin[i],
            direction: direction[i],
            time: time.as_ref().map_or(0.0, |t| t[i]),
            departure: self.departure.as_ref().map(|d| d[i]),
            emitter: self
                .arrival
                .as_ref()
                .and_then(|(e, _)| (e[i] != NO_TRIANGLE).then_some(e[i])),
            distance: distance.as_ref().map(|d| d[i]),
        };
        Ok((0..self.len()).map(one).collect())
    }
}

/// Returns whether a list contains all of `count` indices, in order.
pub(crate) fn is_identity(which: &[u32], count: usize) -> bool {
    which.len() == count && which.iter().enumerate().all(|(i, &w)| i == w as usize)
}

/// Spreads a row of some rays over a row of all rays. Values of the same ray are added, and rays without a value have
/// 0.
pub(crate) fn spread(context: &Context, row: Tensor<2>, which: &[u32], count: usize) -> Tensor<2> {
    if is_identity(which, count) {
        return row;
    }
    let zeros = Tensor::<2>::zeros([1, count], (&context.device, context.dtype));
    zeros.scatter(1, context.index_row(which), row, IndexingUpdateOp::Add)
}
