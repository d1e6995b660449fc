//! The rows of an image that stand beside radiance.

use burn::tensor::Tensor;

use crate::error::Result;
use crate::geometry::{Vec3, detached};
use crate::render::options::Outputs;
use crate::scene::Flattened;
use crate::tensors::{Group, Hits, Radiance, RayWeights, SurfacePoints};

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
        RayWeights::Shares(first) => first,
    };
    if outputs.depth {
        rows.push(first.mean(|g| g.hits(scene).t * scene.unit, None));
    }
    if outputs.normals {
        let normal = &scene.triangles.normal;
        for axis in [&normal.x, &normal.y, &normal.z] {
            let turned = |g: &Group| (g.fronts(scene) * 2.0 - 1.0) * g.pairs.of(axis);
            rows.push(first.mean(turned, None));
        }
    }
    if outputs.object_ids {
        let object = &scene.topology.object;
        for id in 0..scene.objects() as u32 {
            let member = object.iter().map(|&o| f64::from(u8::from(o == id)));
            let member: Vec<f64> = member.collect();
            let is = |g: &Group| g.pairs.constant(&scene.context, &member);
            rows.push(detached(&first.mean(is, None)));
        }
        rows.push(detached(&first.attached_background()));
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
