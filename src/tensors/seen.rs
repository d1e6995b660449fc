//! Emission and albedos that primary rays see.

use burn::tensor::Tensor;

use super::bsdf;
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
    let (_, light) = points(scene, &rays.pick(context, &which), &which, &hit)?;
    Ok(Some(light.map(|l| spread(context, l, &which, count))))
}

/// Returns the points of the surfaces that the listed rays hit, and their emission. `rays` are the listed ones alone.
fn points(
    scene: &Flattened,
    rays: &Rays,
    which: &[u32],
    hit: &[u32],
) -> Result<(SurfacePoints, Vec3)> {
    let triangles: Vec<u32> = which.iter().map(|&i| hit[i as usize]).collect();
    let material = |&k: &u32| scene.topology.material[k as usize];
    let materials: Vec<u32> = triangles.iter().map(material).collect();
    let points = SurfacePoints::new(scene, rays, triangles)?;
    let index = scene.context.index_row(&materials);
    let side = points.inside.clone() * 2.0 - 1.0;
    let cosine = points.geometric_normal.dot(&rays.direction) * side;
    let light = emission(scene, &materials, &index, &points.uv, &cosine)?;
    Ok((points, light))
}

/// Returns the albedo, in [0, 1], of one surface of each ray, drawn with a list of random numbers: the color of the BSDF
/// plus the emission. It is 0 for the background, and untracked.
pub(crate) fn albedo(
    scene: &Flattened,
    weights: &Shares,
    rays: &Rays,
    random: &[f64],
) -> Result<Vec3> {
    let (context, count) = (&scene.context, rays.len());
    let hit = weights.draw(random.to_vec())?;
    let is_surface = |i: &u32| hit[*i as usize] < scene.triangles.len() as u32;
    let which: Vec<u32> = (0..count as u32).filter(is_surface).collect();
    if which.is_empty() {
        let none = Tensor::zeros([1, count], (&context.device, context.dtype));
        return Ok(Vec3::new(none.clone(), none.clone(), none));
    }
    let rays = rays.pick(context, &which);
    let (points, light) = points(scene, &rays, &which, &hit)?;
    let color = bsdf::albedo(&points, &rays.direction).add(&light);
    let color = color.detached().map(|x| x.clamp(0.0, 1.0));
    Ok(color.map(|x| spread(context, x, &which, count)))
}
