//! Emission that camera rays see.

use burn::tensor::Tensor;

use super::rays::{Rays, spread};
use super::softmax::Shares;
use super::surface::{SurfacePoints, look_up};
use super::tracer::Transport;
use crate::error::Result;
use crate::geometry::Vec3;
use crate::scene::{Channel, Flattened};

/// Light of emitters and environment that camera rays see: the mean over all their surfaces, not over
/// drawn ones, which has no noise of a draw. None where all is black.
pub(crate) fn seen(transport: &Transport, weights: &Shares, rays: &Rays) -> Result<Option<Vec3>> {
    let scene = transport.scene;
    let context = &scene.context;
    let sky = transport.sky.map(|s| s.radiance(context, &rays.direction));
    let sky = sky.transpose()?;
    if scene.emitters.is_empty() && sky.is_none() {
        return Ok(None);
    }
    let materials = context.index_row(&scene.topology.material);
    let emission = scene.materials.emission().gather(&materials);
    let mean = |emission: &Tensor<2>, environment: Option<&Tensor<2>>| {
        weights.mean(|g| g.pairs.of(emission) * g.fronts(scene), environment)
    };
    let environment = sky.as_ref();
    let mut seen = Vec3::new(
        mean(&emission.x, environment.map(|e| &e.x)),
        mean(&emission.y, environment.map(|e| &e.y)),
        mean(&emission.z, environment.map(|e| &e.z)),
    );
    if let Some(light) = textured(scene, weights, rays)? {
        seen = seen.add(&light);
    }
    Ok(Some(seen))
}

/// Light of emitters with textures, which only cones see.
fn textured(scene: &Flattened, weights: &Shares, rays: &Rays) -> Result<Option<Vec3>> {
    let (context, material) = (&scene.context, &scene.topology.material);
    let emission = scene.materials.channel(Channel::Emission.place());
    if emission.texture.iter().all(Option::is_none) {
        return Ok(None);
    }
    let hit = weights.draw(vec![0.0; rays.len()])?;
    let has_texture = |i: &u32| {
        let material = material.get(hit[*i as usize] as usize);
        material.is_some_and(|&m| emission.texture[m as usize].is_some())
    };
    let which: Vec<u32> = (0..rays.len() as u32).filter(has_texture).collect();
    if which.is_empty() {
        return Ok(None);
    }
    let triangles: Vec<u32> = which.iter().map(|&i| hit[i as usize]).collect();
    let materials: Vec<u32> = triangles.iter().map(|&k| material[k as usize]).collect();
    let points = SurfacePoints::new(scene, &rays.pick(context, &which), triangles)?;
    let index = context.index_row(&materials);
    let light = look_up(context, emission, &materials, &index, &points.uv)?;
    let light = light.scale(&(points.inside.neg() + 1.0));
    Ok(Some(light.map(|l| spread(context, l, &which, rays.len()))))
}
