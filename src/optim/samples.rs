//! Points on the surface of a mesh.

use burn::tensor::Tensor;
use glam::DVec3;

use crate::error::{Error, Result};
use crate::geometry::{Context, Vec3};
use crate::scene::{Mesh, take_rows};
use softray_kernels::model::integers::mix;

/// Returns points `[count, 3]` on the faces of a mesh, in scene units, distributed uniformly by area (Osada et
/// al. 2002, *Shape Distributions*, Eq. 1). The same seed gives the same points.
///
/// The points are in the graph of the vertices. Each point keeps its barycentric coordinates, so its derivative
/// is the weighted sum of the derivatives of its corners with constant weights. A change of the areas adds no
/// derivative. The points are in the order of the faces and are stratified over their total area: use all of
/// them, not the first few.
///
/// ```
/// use softray::optim::sample_points;
/// use softray::prelude::*;
/// let ball = shapes::icosphere(2, &Device::flex().autodiff());
/// let vertices = ball.vertices.clone().require_grad();
/// let points = sample_points(&ball.with_vertices(vertices.clone()), 100, 7)?;
/// assert_eq!(points.dims(), [100, 3]);
/// assert!(vertices.grad(&points.powi_scalar(2).mean().backward()).is_some());
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If `count` is 0, no face of the mesh has an area, the vertices are not `[V, 3]` or not finite, a face has an
/// index out of range, or the vertices cannot be read from their device.
pub fn sample_points(mesh: &Mesh, count: usize, seed: u64) -> Result<Tensor<2>> {
    Samples::new(mesh, count, seed).map(|samples| samples.points())
}

/// Returns the points of [`sample_points`] and the unit normals of their faces, `[count, 3]` each.
///
/// Both are in the graph of the vertices. Normals point to the front side of the face; shading normals are not
/// used.
///
/// ```
/// use softray::optim::sample_points_and_normals;
/// use softray::prelude::*;
/// let (points, normals) = sample_points_and_normals(&shapes::cube(&Device::flex()), 60, 0)?;
/// // The faces of the cube are at a distance of 1 from its center.
/// let distances = (points * normals).sum_dim(1);
/// assert!((distances - 1.0).abs().max().into_scalar::<f32>() < 1e-5);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// Like [`sample_points`].
pub fn sample_points_and_normals(
    mesh: &Mesh,
    count: usize,
    seed: u64,
) -> Result<(Tensor<2>, Tensor<2>)> {
    let samples = Samples::new(mesh, count, seed)?;
    Ok((samples.points(), samples.normals()))
}

/// Sampled places on faces.
struct Samples {
    context: Context,
    /// The corners of the sampled faces, `[count, 3]` each.
    corners: [Tensor<2>; 3],
    /// Barycentric coordinates.
    weights: [Vec<f64>; 3],
    /// Normals of the sampled faces; their length is twice the area.
    crosses: Vec<DVec3>,
}

impl Samples {
    fn new(mesh: &Mesh, count: usize, seed: u64) -> Result<Self> {
        Error::unless(count > 0, "samples", "count", count, "at least 1")?;
        let vertices = mesh.checked_vertices("mesh")?;
        let cross = |f: &[u32; 3]| {
            let [a, b, c] = f.map(|v| DVec3::from(vertices[v as usize]));
            (b - a).cross(c - a)
        };
        let areas: Vec<f64> = mesh.faces.iter().map(|f| cross(f).length()).collect();
        let drawn = by_area(&areas, count, seed)?;
        let mut weights = [(); 3].map(|()| Vec::with_capacity(count));
        for i in 0..count as u64 {
            let root = number(seed, i, 1).sqrt();
            let v = number(seed, i, 2);
            let all = [1.0 - root, root * (1.0 - v), root * v];
            weights
                .iter_mut()
                .zip(all)
                .for_each(|(list, w)| list.push(w));
        }
        let corner = |i: usize| take_rows(&mesh.vertices, drawn.iter().map(|&f| mesh.faces[f][i]));
        Ok(Self {
            context: Context {
                device: mesh.vertices.device().inner(),
                dtype: mesh.vertices.dtype(),
            },
            corners: [corner(0), corner(1), corner(2)],
            weights,
            crosses: drawn.iter().map(|&f| cross(&mesh.faces[f])).collect(),
        })
    }

    fn points(&self) -> Tensor<2> {
        let [a, b, c] = [0, 1, 2].map(|i| {
            let weights = self.context.column(&self.weights[i]);
            self.corners[i].clone() * weights
        });
        a + b + c
    }

    fn normals(&self) -> Tensor<2> {
        let [a, b, c] = self.corners.each_ref();
        // The sides are scaled so that the length of their cross product is about 1.
        let scale = self.crosses.iter().map(|n| n.length().sqrt().recip());
        let scale = self.context.column(&scale.collect::<Vec<_>>());
        let side = |end: &Tensor<2>| Vec3::from_columns((end.clone() - a.clone()) * scale.clone());
        let normal = side(b).cross(&side(c));
        // In f32 the cross product of a thin face's sides may be lost to rounding.
        let square = normal.dot(&normal);
        let lost = square.clone().lower_elem(1e-12);
        let length = square.mask_fill(lost.clone(), 1.0).sqrt();
        let axis = |x: Tensor<2>, i: usize| {
            let known: Vec<f64> = self.crosses.iter().map(|n| n.normalize()[i]).collect();
            (x / length.clone()).mask_where(lost.clone(), self.context.column(&known))
        };
        Vec3::new(axis(normal.x, 0), axis(normal.y, 1), axis(normal.z, 2)).columns()
    }
}

/// Samples faces in proportion to their areas, one in each of `count` equal parts of the total area; ascending.
fn by_area(areas: &[f64], count: usize, seed: u64) -> Result<Vec<usize>> {
    let total: f64 = areas.iter().sum();
    let Some(last) = areas.iter().rposition(|&a| a > 0.0) else {
        let found = format!("{} without area", areas.len());
        let expected = "at least one with an area";
        return Err(Error::invalid("mesh", "faces", found, expected));
    };
    let (mut face, mut below) = (0, 0.0);
    let mut drawn = Vec::with_capacity(count);
    for i in 0..count {
        let at = total * (i as f64 + number(seed, i as u64, 0)) / count as f64;
        while face < last && below + areas[face] <= at {
            below += areas[face];
            face += 1;
        }
        drawn.push(face);
    }
    Ok(drawn)
}

/// Returns one of the three random numbers of a sample, in [0, 1).
fn number(seed: u64, sample: u64, which: u64) -> f64 {
    (mix(mix(mix(seed) ^ which) ^ sample) >> 11) as f64 / (1u64 << 53) as f64
}
