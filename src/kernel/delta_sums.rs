//! Sums of derivatives by lights without extent.

use glam::DVec3;

use super::scene::KernelScene;
use crate::scene::LightPart;

/// Derivatives by a light, in inner units.
pub(crate) struct DeltaSums {
    position: DVec3,
    axis: DVec3,
    strength: DVec3,
    cos_inner: f64,
    cos_outer: f64,
}

impl DeltaSums {
    /// From its numbers: position, axis, strength and both cosines.
    pub fn of(number: impl Fn(usize) -> f64) -> Self {
        let vector = |first: usize| DVec3::new(number(first), number(first + 1), number(first + 2));
        Self {
            position: vector(0),
            axis: vector(3),
            strength: vector(6),
            cos_inner: number(9),
            cos_outer: number(10),
        }
    }

    /// Adds the derivative by a parameter of the scene's i-th light.
    pub fn write(&self, scene: &KernelScene, i: usize, part: LightPart, to: &mut [f64]) {
        let light = &scene.emitters.lights()[i];
        let unit = scene.frame.unit;
        let by = match part {
            LightPart::Position => (self.position / unit).to_array(),
            LightPart::Direction => {
                let axis = DVec3::from(light.axis);
                let across = self.axis - axis * axis.dot(self.axis);
                (across / scene.lengths_of_axes[i]).to_array()
            }
            LightPart::Intensity => (self.strength / (unit * unit)).to_array(),
            LightPart::Irradiance => self.strength.to_array(),
            LightPart::Inner => [self.cos_inner * slope(light.cos_inner), 0.0, 0.0],
            LightPart::Outer => [self.cos_outer * slope(light.cos_outer), 0.0, 0.0],
        };
        to.iter_mut().zip(by).for_each(|(to, by)| *to += by);
    }
}

/// The derivative of a cosine by its angle.
fn slope(cosine: f32) -> f64 {
    let cosine = f64::from(cosine);
    -(1.0 - cosine * cosine).max(0.0).sqrt()
}
