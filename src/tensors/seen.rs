//! Emission that primary rays see.

use burn::tensor::Tensor;

use super::emission::emission;
use super::rays::{Rays, spread};
use super::softmax::Shares;
use super::surface::SurfacePoints;
use super::tracer::Transport;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::scene::Flattened;

/// Returns the light of emitters and environment that primary rays see. It is the mean over all surfaces of a ray, not
/// over drawn ones, so it has no noise from a draw. Returns `None` if the scene has neither.
pub(crate) fn seen(transport: &Transport, weights: &Shares, rays: &Rays) -> Result<Option<Vec3>> {
    let scene = transport.scene;
    let context = &scene.context;
    let sky = transport.sky.map(|s| s.radiance(context, &rays.direction));
    let sky = sky.transpose()?;
    if scene.emitters.is_empty() && sky.is_none() {
        return Ok(None);
    }
    let materials = context.index_row(&scene.topology.material);
    let emission = scene.materials.even_emission().gather(&materials);
    let mean = |emission: &Tensor<2>, environment: Option<&Tensor<2>>| {
        weights.mean(|g| g.pairs.of(emission) * g.fronts(scene), environment)
    };
    let environment = sky.as_ref();
    let mut seen = Vec3::new(
        mean(&emission.x, environment.map(|e| &e.x)),
        mean(&emission.y, environment.map(|e| &e.y)),
        mean(&emission.z, environment.map(|e| &e.z)),
    );
    if let Some(light) = uneven(scene, weights, rays)? {
        seen = seen.add(&light);
    }
    Ok(Some(seen))
}

/// Returns the light of emitters whose emission is a texture, which only cones support.
fn uneven(scene: &Flattened, weights: &Shares, rays: &Rays) -> Result<Option<Vec3>> {
    let (context, material) = (&scene.context, &scene.topology.material);
    let count = rays.len();
    let kinds = &scene.materials.kinds;
    if !kinds.iter().any(|kind| kind.glows) {
        return Ok(None);
    }
    let hit = weights.draw(vec![0.0; count])?;
    let glows = |i: &u32| {
        let material = material.get(hit[*i as usize] as usize);
        material.is_some_and(|&m| kinds[m as usize].glows)
    };
    let which: Vec<u32> = (0..count as u32).filter(glows).collect();
    if which.is_empty() {
        return Ok(None);
    }
    let triangles: Vec<u32> = which.iter().map(|&i| hit[i as usize]).collect();
    let materials: Vec<u32> = triangles.iter().map(|&k| material[k as usize]).collect();
    let rays = rays.pick(context, &which);
    let points = SurfacePoints::new(scene, &rays, triangles)?;
    let index = context.index_row(&materials);
    let side = points.inside.clone() * 2.0 - 1.0;
    let cosine = points.geometric_normal.dot(&rays.direction) * side;
    let light = emission(scene, &materials, &index, &points.uv, &cosine)?;
    Ok(Some(light.map(|l| spread(context, l, &which, count))))
}
