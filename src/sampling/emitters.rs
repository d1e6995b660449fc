//! Emitters, and the choice of one that a surface point is connected to; it carries no gradient.

use super::strategies::EmitterSampling;
use crate::model::V3;
use crate::model::delta_light::DeltaLight;
use crate::model::triangle::{barycentric, solid_angle};

/// The emitters of a scene: triangles, then lights without extent, in one count.
pub(crate) struct Emitters {
    list: Vec<Emitter>,
    lights: Vec<DeltaLight>,
    /// Probabilities that do not depend on the point.
    pub fixed: Vec<f32>,
    by_solid_angle: bool,
    /// Emitters of one object and velocity, whose shadows are sampled together.
    pub groups: Vec<EmitterGroup>,
}

/// A triangle that emits from its front, in inner coordinates at the start of the shutter.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Emitter {
    /// The triangle and object of the scene that it is.
    pub triangle: u32,
    pub object: u32,
    pub corners: [V3; 3],
    pub normal: V3,
    pub area: f32,
    pub velocity: V3,
    /// Mean radiance; one that is black for now may have a gradient.
    pub radiance: f32,
    /// Of [`Emitters::groups`].
    pub group: u32,
}

/// A point of an emitter that a ray hits, as if nothing were in between.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EmitterHit {
    pub emitter: usize,
    pub distance: f32,
    /// Weights of the corners b and c.
    pub weights: [f32; 2],
}

/// Emitters in a sphere, at the start of the shutter.
#[derive(Clone, Debug)]
pub(crate) struct EmitterGroup {
    pub members: Vec<u32>,
    pub centre: V3,
    pub radius: f32,
    /// The velocity of each of them.
    pub velocity: V3,
}

/// Up to so many emitters have their solid angles computed at every point.
const FEW: usize = 64;
/// Emitters under a glancing angle are chosen with at least this share of their power's probability:
/// their light is small there, but its derivative is not.
const BY_POWER: f32 = 0.1;
/// Emitters of one group at most.
const TOGETHER: usize = 8;

/// Rays that are more parallel to an emitter than this don't meet it.
const GRAZING: f32 = 1e-6;

impl Emitters {
    /// Of a list in the order of the scene's triangles; `moves` says whether any velocity counts. `size` is the typical
    /// size of the scene, in the unit of coordinates.
    pub fn new(
        mut list: Vec<Emitter>,
        lights: Vec<DeltaLight>,
        (moves, size): (bool, f64),
        sampling: EmitterSampling,
    ) -> Self {
        let largest = list.iter().map(|e| e.radiance).fold(0.0, f32::max);
        let least = if largest > 0.0 { 1e-3 * largest } else { 1.0 };
        list.iter_mut()
            .for_each(|e| e.radiance = e.radiance.max(least));
        let count = list.len() + lights.len();
        let of_triangles = list
            .iter()
            .map(|e| f64::from(e.area) * f64::from(e.radiance));
        let mut power: Vec<f64> = of_triangles.collect();
        power.extend(powers_of_lights(&lights, size));
        for p in &mut power {
            *p = if p.is_finite() { *p } else { 0.0 };
        }
        let total: f64 = power.iter().sum();
        // From anywhere, emitters of one plane are seen about as their areas are.
        let apart = |e: &Emitter| {
            let (n, first) = (e.normal - list[0].normal, list[0].corners[0]);
            let offset = (e.corners[0] - first).dot(list[0].normal);
            n.abs().max_element().max(offset.abs()) > 1e-5
        };
        let spread = moves || !lights.is_empty() || list.iter().any(apart);
        let uniform = sampling == EmitterSampling::Uniform || total <= 0.0;
        let fixed = if uniform {
            vec![1.0 / count.max(1) as f32; count]
        } else {
            power.iter().map(|p| (p / total) as f32).collect()
        };
        let mut groups = group(&mut list);
        groups.extend((list.len()..count).map(|k| EmitterGroup {
            members: vec![k as u32],
            centre: V3::ZERO,
            radius: 0.0,
            velocity: V3::ZERO,
        }));
        Self {
            by_solid_angle: sampling == EmitterSampling::SolidAngle
                && (2..=FEW).contains(&count)
                && spread
                && !uniform,
            list,
            lights,
            fixed,
            groups,
        }
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty() && self.lights.is_empty()
    }

    /// The light without extent that an emitter is, by its place among those.
    #[inline(always)]
    pub fn light(&self, emitter: usize) -> Option<usize> {
        emitter.checked_sub(self.list.len())
    }

    /// The light without extent that a group is.
    pub fn light_of_group(&self, group: usize) -> Option<usize> {
        (group + self.lights.len()).checked_sub(self.groups.len())
    }

    pub fn lights(&self) -> &[DeltaLight] {
        &self.lights
    }

    /// Whether probabilities depend on the point.
    pub fn depends_on_position(&self) -> bool {
        self.by_solid_angle
    }

    pub fn get(&self, emitter: usize) -> &Emitter {
        &self.list[emitter]
    }

    /// Probabilities of the emitters at a point and time; `room` is room for them.
    #[inline(always)]
    fn probabilities<'a>(&'a self, x: V3, time: f32, room: &'a mut Vec<f32>) -> &'a [f32] {
        if self.by_solid_angle {
            self.seen_from(x, time, room)
        } else {
            &self.fixed
        }
    }

    #[inline(never)]
    fn seen_from<'a>(&'a self, x: V3, time: f32, room: &'a mut Vec<f32>) -> &'a [f32] {
        room.clear();
        let mut total = 0.0;
        for e in &self.list {
            let [a, b, c] = e.corners;
            let p = e.radiance * solid_angle(a, b, c, x - e.velocity * time).max(0.0);
            total += p;
            room.push(p);
        }
        for light in &self.lights {
            let p = mean(light.strength).max(1e-30) * light.seen_from(x).scale;
            total += p;
            room.push(p);
        }
        if !(total > 0.0 && total.is_finite()) {
            return &self.fixed;
        }
        for (p, fixed) in room.iter_mut().zip(&self.fixed) {
            *p = (1.0 - BY_POWER) * *p / total + BY_POWER * fixed;
        }
        room
    }

    /// An emitter for a random number, its probability, and what is left of the number, uniform again.
    #[inline(always)]
    pub fn choose(&self, x: V3, time: f32, u: f32, room: &mut Vec<f32>) -> (usize, f32, f32) {
        let p = self.probabilities(x, time, room);
        let (mut k, mut passed) = (0, 0.0);
        // Rounding may leave the sum a little under 1: then the last that can be is taken.
        let mut taken = (0, 0.0);
        while k < p.len() {
            if p[k] > 0.0 {
                taken = (k, passed);
                if u < passed + p[k] {
                    break;
                }
            }
            passed += p[k];
            k += 1;
        }
        let (k, before) = taken;
        let rest = (u - before) / p[k];
        (k, p[k], rest.clamp(0.0, 1.0 - f32::EPSILON))
    }

    /// The probability of an emitter at a point.
    #[inline(always)]
    pub fn chance(&self, x: V3, time: f32, emitter: usize, room: &mut Vec<f32>) -> f32 {
        self.probabilities(x, time, room)[emitter]
    }

    /// A group for a random number, its probability, and what is left of the number.
    pub fn choose_group(&self, x: V3, time: f32, u: f32, room: &mut Vec<f32>) -> (usize, f32) {
        if self.groups.len() == 1 {
            return (0, 1.0);
        }
        let (k, _, _) = self.choose(x, time, u, room);
        let group = match self.light(k) {
            None => self.list[k].group as usize,
            Some(light) => self.groups.len() - self.lights.len() + light,
        };
        let p = self.probabilities(x, time, room);
        let chance: f32 = self.groups[group]
            .members
            .iter()
            .map(|&k| p[k as usize])
            .sum();
        (group, chance)
    }

    /// Visits the emitters among some whose front a ray hits, as if nothing were in between.
    #[inline(always)]
    pub fn each_hit(
        &self,
        members: impl Iterator<Item = usize>,
        x: V3,
        time: f32,
        direction: V3,
        mut visit: impl FnMut(EmitterHit),
    ) {
        for k in members {
            let e = &self.list[k];
            let cosine = e.normal.dot(direction);
            if cosine >= -GRAZING {
                continue;
            }
            let from_a = x - e.velocity * time - e.corners[0];
            let t = -e.normal.dot(from_a) / cosine;
            if t <= 0.0 {
                continue;
            }
            let at = e.corners[0] + from_a + direction * t;
            let [a, b, c] = barycentric(e.corners, e.normal, e.area, at);
            if a >= 0.0 && b >= 0.0 && c >= 0.0 {
                visit(EmitterHit {
                    emitter: k,
                    distance: t,
                    weights: [b, c],
                });
            }
        }
    }

    /// All triangles.
    pub fn all(&self) -> std::ops::Range<usize> {
        0..self.list.len()
    }

    pub fn members(&self, group: usize) -> impl Iterator<Item = usize> + '_ {
        self.groups[group].members.iter().map(|&k| k as usize)
    }
}

/// The mean of a colour's channels.
fn mean(colour: V3) -> f32 {
    colour.abs().element_sum() / 3.0
}

/// Powers of lights over π, which for a triangle is area times radiance; those that are black for now count a little.
fn powers_of_lights(lights: &[DeltaLight], size: f64) -> impl Iterator<Item = f64> {
    let power = move |l: &DeltaLight| {
        let per_strength = if l.directional {
            size * size
        } else if l.spot {
            // Of the solid angle about half-way between both angles.
            2.0 - f64::from(l.cos_inner + l.cos_outer)
        } else {
            4.0
        };
        f64::from(mean(l.strength)) * per_strength
    };
    let largest = lights.iter().map(power).fold(0.0, f64::max);
    let least = if largest > 0.0 { 1e-3 * largest } else { 1.0 };
    lights.iter().map(move |l| power(l).max(least))
}

/// Emitters of one object and velocity together, few at a time.
fn group(list: &mut [Emitter]) -> Vec<EmitterGroup> {
    let mut groups: Vec<EmitterGroup> = Vec::new();
    let mut last = None;
    for (k, e) in list.iter_mut().enumerate() {
        let object = e.object;
        match groups.last_mut() {
            Some(g) if last == Some(object) && g.members.len() < TOGETHER => {
                g.members.push(k as u32);
            }
            _ => groups.push(EmitterGroup {
                members: vec![k as u32],
                centre: V3::ZERO,
                radius: 0.0,
                velocity: e.velocity,
            }),
        }
        last = Some(object);
        e.group = groups.len() as u32 - 1;
    }
    for g in &mut groups {
        let corners = || g.members.iter().flat_map(|&k| list[k as usize].corners);
        let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
        for c in corners() {
            low = low.min(c);
            high = high.max(c);
        }
        let centre = (low + high) * 0.5;
        let radius = corners().map(|c| (c - centre).length()).fold(0.0, f32::max);
        g.centre = centre;
        g.radius = radius * (1.0 + 1e-5);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::v3;

    /// Emitters are drawn as often as their probabilities say, which add up to 1; what is left of the number is
    /// uniform.
    #[test]
    fn emitters_are_drawn_with_their_probabilities() {
        let emitter = |k: u32| Emitter {
            triangle: k,
            object: 0,
            corners: [V3::AXES[0], V3::AXES[2], V3::AXES[1]].map(|c| c * (1.0 + k as f32)),
            normal: V3::ONE * -(1.0f32 / 3.0).sqrt(),
            area: 0.5 * 3f32.sqrt() * (1.0 + k as f32).powi(2),
            velocity: V3::ZERO,
            radiance: 1.0 + 2.0 * k as f32,
            group: 0,
        };
        for sampling in [
            EmitterSampling::Uniform,
            EmitterSampling::Power,
            EmitterSampling::SolidAngle,
        ] {
            let light = DeltaLight {
                position: v3(0.5, 0.7, 2.0),
                axis: v3(0.0, 0.0, -1.0),
                strength: V3::ONE * 2.0,
                directional: false,
                spot: true,
                cos_inner: 0.9,
                cos_outer: 0.3,
            };
            let list = (0..3).map(emitter).collect();
            let all = Emitters::new(list, vec![light], (false, 1.0), sampling);
            let (x, mut room, n) = (v3(0.1, -0.2, 0.05), Vec::new(), 30_000);
            let (mut counts, mut rest) = ([0.0; 4], 0.0);
            for i in 0..n {
                let u = (i as f32 + 0.5) / n as f32;
                let (k, chance, left) = all.choose(x, 0.0, u, &mut room);
                assert_eq!(chance, all.chance(x, 0.0, k, &mut room));
                counts[k] += 1.0 / f64::from(n);
                rest += f64::from(left) / f64::from(n);
            }
            for (k, count) in counts.into_iter().enumerate() {
                let chance = f64::from(all.chance(x, 0.0, k, &mut room));
                assert!(
                    (count - chance).abs() < 1e-3,
                    "{sampling:?} {k}: {count} {chance}"
                );
            }
            assert!((rest - 0.5).abs() < 1e-3);
        }
    }
}
