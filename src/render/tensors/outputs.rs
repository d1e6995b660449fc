//! The channels of an image.

use burn::tensor::Tensor;

use crate::geometry::{Vec3, detached};
use crate::render::outputs::Outputs;
use crate::scene::Flattened;
use crate::tensors::{Group, Radiance};

/// Returns channels `[_, N]`: radiance, opacity, depth, normal, albedo, weights of the objects and the background.
pub(super) fn outputs(scene: &Flattened, outputs: Outputs, found: Radiance) -> Vec<Tensor<2>> {
    let Vec3 { x, y, z } = found.radiance;
    let mut rows = vec![x, y, z];
    let first = found.first;
    if outputs.need_opacity() {
        rows.push(first.background().neg() + 1.0);
    }
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
    rows.extend(found.albedo.map(|albedo| albedo.rows()));
    if outputs.object_ids {
        let object = &scene.topology.object;
        for id in 0..scene.objects() as u32 {
            let member = object.iter().map(|&o| f64::from(u8::from(o == id)));
            let member: Vec<f64> = member.collect();
            let is = |g: &Group| g.pairs.constant(&scene.context, &member);
            rows.push(detached(&first.mean(is, None)));
        }
        rows.push(detached(&first.background()));
    }
    rows
}
