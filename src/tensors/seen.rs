//! Emission that camera rays see.

use burn::tensor::Tensor;

use super::cones::Hits;
use super::rays::spread;
use super::surface::{SurfacePoints, look_up};
use super::tracer::{RayWeights, Transport};
use crate::error::Result;
use crate::geometry::Vec3;
use crate::scene::{Channel, Flattened};

/// Light of emitters and environment that camera rays see: the mean over all their surfaces, not over
/// drawn ones, which has no noise of a draw. None where all is black.
pub(crate) fn seen(
    transport: &Transport,
    weights: &RayWeights,
    direction: &Vec3,
) -> Result<Option<Vec3>> {
    let scene = transport.scene;
    let context = &scene.context;
    let sky = transport.sky.map(|s| s.radiance(context, direction));
    let sky = sky.transpose()?;
    if scene.emitters.is_empty() && sky.is_none() {
        return Ok(None);
    }
    let weights = match weights {
        RayWeights::Hits(hits) => return Ok(Some(seen_by_hits(scene, hits, sky)?)),
        RayWeights::Shares(weights) => weights,
    };
    let materials = context.index_row(&scene.topology.material);
    let emission = scene.materials.emission().gather(&materials);
    let mean = |emission: &Tensor<2>, environment: Option<&Tensor<2>>| {
        weights.mean(|g| g.pairs.of(emission) * g.fronts(scene), environment)
    };
    let environment = sky.as_ref();
    Ok(Some(Vec3::new(
        mean(&emission.x, environment.map(|e| &e.x)),
        mean(&emission.y, environment.map(|e| &e.y)),
        mean(&emission.z, environment.map(|e| &e.z)),
    )))
}

fn seen_by_hits(scene: &Flattened, hits: &Hits, sky: Option<Vec3>) -> Result<Vec3> {
    let context = &scene.context;
    let material = |&k: &u32| scene.topology.material.get(k as usize).map_or(0, |&m| m);
    let materials: Vec<u32> = hits.triangle.iter().map(material).collect();
    let emission = scene.materials.channel(Channel::Emission.place());
    let constant = emission.constant.gather(&context.index_row(&materials));
    let mut seen = constant.scale(&hits.row(context, |i| hits.is_hit(i) && hits.front[i]));
    let count = materials.len();
    let textured = |i: usize| {
        hits.is_hit(i) && hits.front[i] && emission.texture[materials[i] as usize].is_some()
    };
    let which: Vec<u32> = (0..count as u32)
        .filter(|&i| textured(i as usize))
        .collect();
    if !which.is_empty() {
        let triangle = which.iter().map(|&i| hits.triangle[i as usize]).collect();
        let points = SurfacePoints::new(scene, &hits.rays.pick(context, &which), triangle)?;
        let materials: Vec<u32> = which.iter().map(|&i| materials[i as usize]).collect();
        let index = context.index_row(&materials);
        let light = look_up(context, emission, &materials, &index, &points.uv)?;
        seen = seen.add(&light.map(|l| spread(context, l, &which, count)));
    }
    Ok(match sky {
        Some(sky) => seen.add(&sky.scale(&hits.row(context, |i| !hits.is_hit(i)))),
        None => seen,
    })
}
