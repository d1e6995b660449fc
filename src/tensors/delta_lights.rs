//! Direct light of delta lights at surface points.

use super::bsdf::scattered;
use super::lights::ChosenLight;
use super::rays::NO_TRIANGLE;
use super::shaded::Shaded;
use super::tracer::Tracer;
use crate::error::Result;
use crate::geometry::{Vec3, detached, gather_row, host_values};
use softray_kernels::host::LightKind;

/// The distance of a directional light.
const FAR: f64 = 1e30;
/// The least difference of the cosines between which a spot light falls off.
const NARROW: f64 = 1e-3;

/// Returns light from one delta light at each surface point, over its probability: planes of f·cos
/// θ·intensity·falloff/r²·T, or of f·cos θ·irradiance·T.
pub(super) fn from_delta_lights(
    tracer: &Tracer,
    shaded: Shaded,
    chosen: &[ChosenLight],
) -> Result<Vec3> {
    let scene = tracer.scene();
    let context = &scene.context;
    let Shaded { points, rays, at } = shaded;
    let n = chosen.len();
    let Some(lights) = &scene.lights else {
        return Ok(Vec3::constant(context, [0.0; 3]).map(|x| x.expand([1, n])));
    };
    let index: Vec<u32> = chosen.iter().map(|c| c.light).collect();
    let is = |kind: LightKind| {
        let flags = index.iter().map(|&l| lights.kinds[l as usize] == kind);
        let flags: Vec<f64> = flags.map(|is| u8::from(is).into()).collect();
        context.row(&flags).greater_elem(0.5)
    };
    let (directional, no_spot) = (is(LightKind::Directional), is(LightKind::Spot).bool_not());
    let index = context.index_row(&index);
    let axis = lights.axis.gather(&index);
    let to = lights.position.gather(&index).sub(&points.position);
    let squared = to
        .dot(&to)
        .clamp_min((tracer.t_min() * tracer.t_min()).max(1e-37));
    let distance = squared.clone().sqrt();
    let direction = to.map(|x| x / distance.clone());
    let direction = direction.zip(&axis, |d, a| d.mask_where(directional.clone(), a.neg()));
    let cosine = direction.dot(&axis).neg();
    let [inner, outer] =
        [&lights.cos_inner, &lights.cos_outer].map(|cosine| gather_row(cosine.clone(), &index));
    let within = (cosine - outer.clone()) / (inner - outer).clamp_min(NARROW);
    let within = within.clamp(0.0, 1.0).mask_fill(no_spot, 1.0);
    let scale = within.clone() * within / squared;
    let scale = scale.mask_fill(directional.clone(), 1.0);
    let reflected = scattered(context, points, &rays.direction, &direction)?;
    let mut shadow = points.ray(direction, rays.time.clone());
    let distance = detached(&distance).mask_fill(directional, FAR);
    shadow.arrival = Some((vec![NO_TRIANGLE; n], distance));
    let sum = detached(&reflected.x) + detached(&reflected.y) + detached(&reflected.z);
    let needed = host_values(&(sum.abs() * detached(&scale)))?;
    let needed: Vec<bool> = needed.iter().map(|&v| v != 0.0).collect();
    let passed = tracer.transmittance(&shadow, &needed, at)?;
    let chances: Vec<f64> = chosen.iter().map(|c| c.chance).collect();
    let strength = lights.strength.gather(&index);
    let light = strength.scale(&(scale * passed / context.row(&chances)));
    Ok(reflected.mul(&light))
}
