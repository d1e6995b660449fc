//! The rows of an image that stand beside radiance.

use burn::tensor::Tensor;

use crate::error::Result;
use crate::geometry::{Vec3, detached, host_values};
use crate::render::options::Outputs;
use crate::scene::Flattened;
use crate::transport::{Hits, Radiance, RayWeights, SurfacePoints};
use crate::visibility::SparseWeights;

/// Rows `[_, N]`: radiance, opacity, depth, normal, weight of each object.
pub(super) fn outputs(
    scene: &Flattened,
    outputs: Outputs,
    found: Radiance,
) -> Result<Vec<Tensor<2>>> {
    let Vec3 { x, y, z } = found.radiance;
    let mut rows = vec![x, y, z];
    let first = found.first;
    if outputs.need_opacity() {
        rows.push(first.attached_background(&scene.context).neg() + 1.0);
    }
    let first = match first {
        RayWeights::Hits(hits) => {
            rows.extend(outputs_of_hits(scene, outputs, &hits)?);
            return Ok(rows);
        }
        RayWeights::Dense(first) => first,
        RayWeights::Sparse(first) => {
            rows.extend(outputs_by_candidates(scene, outputs, &first)?);
            return Ok(rows);
        }
    };
    if outputs.depth {
        rows.push(first.mean(first.attached_distances() * scene.unit, None));
    }
    if outputs.normals {
        let normal = &scene.triangles.normal;
        let front = first.cosine().clone().lower_elem(0.0);
        let side = front.float().cast(scene.context.dtype) * 2.0 - 1.0;
        for axis in [&normal.x, &normal.y, &normal.z] {
            rows.push(first.mean(side.clone() * axis.clone(), None));
        }
    }
    if outputs.object_ids {
        let object = &scene.topology.object;
        let objects = scene.objects();
        let triangles = object.len();
        for id in 0..objects as u32 {
            let member: Vec<f64> = object
                .iter()
                .map(|&o| if o == id { 1.0 } else { 0.0 })
                .collect();
            let member = scene.context.tensor(&member, [triangles, 1]);
            rows.push((first.surfaces.clone() * member).sum_dim(0));
        }
        rows.push(first.background);
    }
    Ok(rows)
}

/// Rows of depth, normal and object, of what rays hit.
fn outputs_of_hits(scene: &Flattened, outputs: Outputs, hits: &Hits) -> Result<Vec<Tensor<2>>> {
    let context = &scene.context;
    let mut rows = Vec::new();
    if outputs.depth || outputs.normals {
        let is_hit = hits.row(context, |i| hits.is_hit(i));
        let missed = detached(&is_hit).lower_elem(0.5);
        // Where nothing is hit any triangle serves; what it gives is left out.
        let last = scene.triangles.len() as u32 - 1;
        let triangles = hits.triangle.iter().map(|&k| k.min(last)).collect();
        let points = SurfacePoints::new(scene, &hits.rays, triangles)?;
        if outputs.depth {
            let along = points.position.sub(&hits.rays.origin);
            let depth = along.dot(&hits.rays.direction) * scene.unit;
            rows.push(depth.mask_fill(missed.clone(), 0.0));
        }
        if outputs.normals {
            let Vec3 { x, y, z } = points.geometric_normal;
            rows.extend([x, y, z].map(|n| n.mask_fill(missed.clone(), 0.0)));
        }
    }
    if outputs.object_ids {
        let object = &scene.topology.object;
        for id in 0..scene.objects() as u32 {
            let is = |i: usize| hits.is_hit(i) && object[hits.triangle[i] as usize] == id;
            rows.push(hits.row(context, is));
        }
        rows.push(hits.row(context, |i| !hits.is_hit(i)));
    }
    Ok(rows)
}

/// Rows of depth, normal and weight of each object.
fn outputs_by_candidates(
    scene: &Flattened,
    outputs: Outputs,
    first: &SparseWeights,
) -> Result<Vec<Tensor<2>>> {
    let mut rows = Vec::new();
    if outputs.depth {
        rows.push(first.mean_distance() * scene.unit);
    }
    if outputs.normals {
        let normal = &scene.triangles.normal;
        let side = |front: bool| if front { 1.0 } else { -1.0 };
        for axis in [&normal.x, &normal.y, &normal.z] {
            let host = host_values(axis)?;
            let value = |_, k: u32, front| host[k as usize] * side(front);
            let mut row = first.mean(value, |_| 0.0);
            if axis.is_tracked()
                && let Some(turned) = first.spread(axis, |k, front| Some((k, side(front))))
            {
                let value = detached(&turned);
                row = row + (turned - value);
            }
            rows.push(row);
        }
    }
    if outputs.object_ids {
        let (objects, background) = first.by_object(&scene.topology.object, scene.objects());
        rows.extend([objects, background]);
    }
    Ok(rows)
}
