//! Delta lights: point, spot and directional lights, whose light reaches a point from a single direction.

use glam::DVec3;

use super::connection::Target;
use super::lists::vector;
use super::{V3, splat};
use crate::cube::*;
use crate::host::{HostLight, LightKind, LightPart, SceneFrame};

/// A delta light.
#[apply(record!)]
pub struct DeltaLight {
    /// 0 for a directional light.
    pub position: V3,
    /// The unit vector in which a spot or directional light shines.
    pub axis: V3,
    /// Intensity, or irradiance of a directional light.
    pub strength: V3,
    /// The integer value of its [`LightKind`].
    pub kind: u32,
    /// Cosines of the angles to the axis between which a spot's intensity falls off.
    pub cos_inner: f32,
    pub cos_outer: f32,
}

/// A delta light as seen from a point.
#[apply(record!)]
pub struct DeltaArrival {
    /// The unit vector to the light.
    pub direction: V3,
    /// A huge number for a directional light.
    pub distance: f32,
    /// Irradiance of a surface facing the light, over the light's strength.
    pub scale: f32,
}

/// Derivatives with respect to a light, except for its strength. The derivative with respect to the point that sees
/// it is −`position`.
#[apply(record!)]
pub struct DeltaGradient {
    pub position: V3,
    pub axis: V3,
    pub cos_inner: f32,
    pub cos_outer: f32,
}

/// Minimum difference of the cosines between which a spot falls off.
const NARROW: f32 = 1e-3;

/// The number of floats of a light in a list, and the first of its strength.
pub const OF_LIGHT: usize = 11;
pub const OF_STRENGTH: usize = 6;

const SPOT: u32 = LightKind::Spot as u32;
const DIRECTIONAL: u32 = LightKind::Directional as u32;

/// Reads light `i` from a list of floats, in the order of the fields, and a list of kinds.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn delta_light_at(numbers: &[f32], kinds: &[u32], i: u32) -> DeltaLight {
    let list = &numbers[OF_LIGHT * i as usize..];
    let cos_outer = list[10];
    DeltaLight {
        position: vector(list, 0u32),
        axis: vector(list, 3u32),
        strength: vector(list, OF_STRENGTH as u32),
        kind: kinds[i as usize],
        cos_inner: list[9],
        cos_outer,
    }
}

impl DeltaLight {
    /// Returns the light's floats in a list, in the order of the fields.
    pub fn numbers(&self) -> [f32; OF_LIGHT] {
        let mut numbers = [0.0; OF_LIGHT];
        let vectors = [self.position, self.axis, self.strength].map(V3::to_array);
        numbers[..9].copy_from_slice(vectors.as_flattened());
        numbers[9..].copy_from_slice(&[self.cos_inner, self.cos_outer]);
        numbers
    }

    /// Returns the derivative with respect to a parameter set by the user, from the derivatives with respect to the
    /// light's floats. `unit` is the number of scene units in an internal unit, and `length` the length of the
    /// direction as given.
    pub fn by_part(
        &self,
        by: [f64; OF_LIGHT],
        part: LightPart,
        unit: f64,
        length: f64,
    ) -> [f64; 3] {
        let [position, axis, strength] = [0, 3, OF_STRENGTH].map(|k| DVec3::from_slice(&by[k..]));
        // The derivative of a cosine with respect to its angle in degrees.
        let slope =
            |cosine: f32| -(1.0 - f64::from(cosine).powi(2)).max(0.0).sqrt() * 1f64.to_radians();
        match part {
            LightPart::Position => (position / unit).to_array(),
            LightPart::Direction => {
                let own = DVec3::from(self.axis);
                ((axis - own * own.dot(axis)) / length).to_array()
            }
            LightPart::Intensity => (strength / (unit * unit)).to_array(),
            LightPart::Irradiance => strength.to_array(),
            LightPart::Inner => [by[9] * slope(self.cos_inner), 0.0, 0.0],
            LightPart::Outer => [by[10] * slope(self.cos_outer), 0.0, 0.0],
        }
    }

    /// Returns the mean absolute value of its strength's channels.
    pub fn mean(&self) -> f32 {
        self.strength.abs().element_sum() / 3.0
    }

    /// Returns its approximate power over π in a scene of extent `size`. For a triangle, that quantity is area times
    /// radiance.
    pub fn power(&self, size: f64) -> f64 {
        let per_strength = if self.is_directional() {
            size * size
        } else if self.kind == SPOT {
            // From the solid angle of a cone about halfway between both angles.
            2.0 - f64::from(self.cos_inner + self.cos_outer)
        } else {
            4.0
        };
        f64::from(self.mean()) * per_strength
    }

    /// Returns whether it shines equally in all directions.
    pub fn is_isotropic(&self) -> bool {
        self.kind == LightKind::Point as u32
    }

    /// Converts a light of the scene to internal coordinates.
    pub fn new(light: &HostLight, frame: &SceneFrame) -> Self {
        let [inner, outer] = light.angles;
        let mut packed = Self {
            position: V3::ZERO,
            axis: DVec3::from(light.direction).normalize().into(),
            strength: DVec3::from(light.strength).into(),
            kind: light.kind as u32,
            cos_inner: inner.cos() as f32,
            cos_outer: outer.cos() as f32,
        };
        if light.kind != LightKind::Directional {
            packed.position = frame.inner(light.position.into()).into();
            packed.strength = (DVec3::from(light.strength) / (frame.unit * frame.unit)).into();
        }
        packed
    }
}

#[cfg_attr(feature = "gpu", cube)]
impl DeltaLight {
    #[inline(always)]
    pub fn is_directional(&self) -> bool {
        self.kind == DIRECTIONAL
    }

    /// Returns the position, 0 … 1, between the outer and the inner angle for the cosine of a direction from the
    /// light.
    #[inline(always)]
    fn within(&self, cosine: f32) -> f32 {
        let width = max(self.cos_inner - self.cos_outer, NARROW);
        min(max((cosine - self.cos_outer) / width, 0.0), 1.0)
    }

    /// Returns the light as seen from a point.
    #[inline(always)]
    pub fn seen_from(&self, x: V3) -> DeltaArrival {
        let mut direction = -self.axis;
        let mut distance = 3.4e38f32;
        let mut scale = 1.0f32;
        if self.kind != DIRECTIONAL {
            let to = self.position - x;
            let squared = max(to.length_squared(), 1e-37);
            distance = squared.sqrt();
            direction = to * (1.0 / distance);
            scale = 1.0 / squared;
            if self.kind == SPOT {
                let within = self.within(-direction.dot(self.axis));
                scale *= within * within;
            }
        }
        DeltaArrival {
            direction,
            distance,
            scale,
        }
    }

    /// Returns the target of a connection to the light.
    #[inline(always)]
    pub fn target(&self, seen: &DeltaArrival) -> Target {
        Target {
            direction: seen.direction,
            place: self.position,
            normal: -seen.direction,
            distant: self.is_directional(),
            radiance: self.strength,
            angle: seen.scale,
            combined: false.runtime(),
        }
    }

    /// Turns derivatives with respect to the scale and the direction of an arrival into those with respect to the
    /// light.
    #[inline(always)]
    pub fn backward(&self, seen: &DeltaArrival, by_scale: f32, by_direction: V3) -> DeltaGradient {
        let mut by = DeltaGradient {
            position: splat(0.0),
            axis: splat(0.0),
            cos_inner: 0.0f32,
            cos_outer: 0.0f32,
        };
        if self.kind == DIRECTIONAL {
            by.axis = -by_direction;
        } else {
            let inverse = 1.0 / seen.distance;
            let mut towards = by_direction;
            if self.kind == SPOT {
                let within = self.within(-seen.direction.dot(self.axis));
                if within > 0.0 && within < 1.0 {
                    let width = self.cos_inner - self.cos_outer;
                    let by_within = by_scale * 2.0 * within * inverse * inverse;
                    let by_cosine = by_within / max(width, NARROW);
                    by.axis = seen.direction * (-by_cosine);
                    towards -= self.axis * by_cosine;
                    by.cos_outer = -by_cosine;
                    if width > NARROW {
                        by.cos_inner = -(by_cosine * within);
                        by.cos_outer += by_cosine * within;
                    }
                }
            }
            let across = towards.reject_from_normalized(seen.direction);
            let nearer = seen.direction * (2.0 * by_scale * seen.scale);
            by.position = (across - nearer) * inverse;
        }
        by
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    fn spot() -> DeltaLight {
        DeltaLight {
            position: v3(0.3, 1.2, -0.2),
            axis: v3(0.1, -1.0, 0.2).normalize(),
            strength: V3::ONE,
            kind: SPOT,
            cos_inner: 0.97,
            cos_outer: 0.6,
        }
    }

    /// The total light of a spot, summed over rings about its axis, matches the closed form of its falloff: it is 2π
    /// ((1 − cos inner) + (cos inner − cos outer)/3).
    #[test]
    fn the_power_of_a_spot() {
        let light = DeltaLight {
            axis: v3(0.0, 0.0, -1.0),
            position: V3::ZERO,
            ..spot()
        };
        let (n, mut power) = (100_000, 0.0);
        for i in 0..n {
            let cosine = (i as f64 + 0.5) / f64::from(n);
            let sine = (1.0 - cosine * cosine).sqrt();
            let seen = light.seen_from(v3(2.0 * sine as f32, 0.0, -2.0 * cosine as f32));
            power += 4.0 * f64::from(seen.scale) / f64::from(n);
        }
        let wanted = (1.0 - 0.97) + (0.97 - 0.6) / 3.0;
        assert!((power - wanted).abs() < 1e-4, "{power} {wanted}");
    }

    #[test]
    fn derivatives_of_what_arrives() {
        let (by_scale, by_direction) = (0.8, v3(-0.3, 0.6, 0.2));
        let point = DeltaLight {
            kind: LightKind::Point as u32,
            ..spot()
        };
        let distant = DeltaLight {
            kind: DIRECTIONAL,
            ..point
        };
        // Inside the falloff, and inside the inner cone.
        let places = [v3(0.7, -0.3, 0.4), v3(0.4, 0.1, 0.0)];
        for (light, x) in
            [(spot(), 0), (spot(), 1), (point, 0), (distant, 0)].map(|(l, i)| (l, places[i]))
        {
            let value = |light: DeltaLight, x: V3| {
                let seen = light.seen_from(x);
                by_scale * seen.scale + by_direction.dot(seen.direction)
            };
            let found = light.backward(&light.seen_from(x), by_scale, by_direction);
            let h = 3e-3;
            let check = |found: f32, slope: f32, what: &str| {
                assert!((found - slope).abs() < 3e-3, "{what}: {found} {slope}");
            };
            for step in V3::AXES {
                let moved = |h: f32| DeltaLight {
                    position: light.position + step * h,
                    ..light
                };
                let slope = (value(moved(h), x) - value(moved(-h), x)) / (2.0 * h);
                check(found.position.dot(step), slope, "position");
                let slope = (value(light, x + step * h) - value(light, x - step * h)) / (2.0 * h);
                check(-found.position.dot(step), slope, "point");
                let turned = |h: f32| DeltaLight {
                    axis: light.axis + step * h,
                    ..light
                };
                let slope = (value(turned(h), x) - value(turned(-h), x)) / (2.0 * h);
                check(found.axis.dot(step), slope, "axis");
            }
            let inner = |h: f32| DeltaLight {
                cos_inner: light.cos_inner + h,
                ..light
            };
            let slope = (value(inner(h), x) - value(inner(-h), x)) / (2.0 * h);
            check(found.cos_inner, slope, "inner");
            let outer = |h: f32| DeltaLight {
                cos_outer: light.cos_outer + h,
                ..light
            };
            let slope = (value(outer(h), x) - value(outer(-h), x)) / (2.0 * h);
            check(found.cos_outer, slope, "outer");
        }
    }
}
