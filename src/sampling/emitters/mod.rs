//! Emitters, and the choice of one that a surface point is connected to; it carries no gradient.

mod branches;
mod fixed;
mod groups;
mod many;
mod powers;
#[cfg(test)]
mod tests;
mod tree;

use super::strategies::EmitterSampling;
use crate::model::V3;
use crate::model::delta_light::DeltaLight;
use crate::model::triangle::{barycentric, solid_angle};
#[cfg(feature = "wgpu")]
pub(crate) use fixed::Chosen;
pub(crate) use fixed::Fixed;
use fixed::one_of;
pub(crate) use groups::EmitterGroup;
use groups::group;
use many::ManyEmitters;
pub(crate) use many::Met;
use powers::{mean, powers_of_lights, running_sums};
#[cfg(feature = "wgpu")]
pub(crate) use tree::LightTree;

/// The emitters of a scene: triangles, then lights without extent, in one count.
pub(crate) struct Emitters {
    list: Vec<Emitter>,
    lights: Vec<DeltaLight>,
    /// Probabilities that do not depend on the point.
    pub fixed: Vec<f32>,
    /// Sums of these up to each emitter.
    sums: Vec<f32>,
    by: Choice,
    /// Emitters that are near to each other, whose shadows are sampled together; then lights without extent, one by one.
    pub groups: Vec<EmitterGroup>,
    /// The group of each light without extent.
    group_of_light: Vec<u32>,
}

/// The choice of an emitter.
enum Choice {
    /// With probabilities that do not depend on the point.
    Fixed,
    /// By the solid angles of all.
    SolidAngle,
    /// By a tree.
    Tree(ManyEmitters),
}

/// A surface point that emitters are chosen for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Receiver {
    pub position: V3,
    /// The side's normal.
    pub normal: V3,
    /// Time in the shutter.
    pub time: f32,
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

/// Up to so many emitters have their solid angles computed at every point.
const FEW: usize = 64;
/// Emitters under a glancing angle are chosen with at least this share of their power's probability:
/// their light is small there, but its derivative is not.
pub(crate) const BY_POWER: f32 = 0.1;

/// Rays that are more parallel to an emitter than this don't meet it.
pub(crate) const GRAZING: f32 = 1e-6;

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
        let by_place = sampling == EmitterSampling::SolidAngle && !uniform;
        let mut this = Self {
            group_of_light: vec![0; lights.len()],
            sums: Vec::new(),
            by: Choice::Fixed,
            groups: Vec::new(),
            list,
            lights,
            fixed,
        };
        if by_place && count > FEW {
            let (many, groups) = ManyEmitters::new(&mut this);
            this.groups = groups;
            this.by = Choice::Tree(many);
        } else {
            this.groups = group(&this.list);
            let lights = this.list.len()..count;
            this.groups.extend(lights.map(|k| EmitterGroup {
                members: vec![k as u32],
                ..EmitterGroup::default()
            }));
            if by_place && count > 1 && spread {
                this.by = Choice::SolidAngle;
            }
        }
        for (g, group) in this.groups.iter().enumerate() {
            for &k in &group.members {
                match (k as usize).checked_sub(this.list.len()) {
                    None => this.list[k as usize].group = g as u32,
                    Some(light) => this.group_of_light[light] = g as u32,
                }
            }
        }
        this.sums = running_sums(this.fixed.iter().copied());
        this
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
        self.light(*self.groups[group].members.first()? as usize)
    }

    pub fn group_of(&self, emitter: usize) -> usize {
        match self.light(emitter) {
            None => self.list[emitter].group as usize,
            Some(light) => self.group_of_light[light] as usize,
        }
    }

    pub fn lights(&self) -> &[DeltaLight] {
        &self.lights
    }

    /// Whether probabilities depend on the point.
    pub fn depends_on_position(&self) -> bool {
        !matches!(self.by, Choice::Fixed)
    }

    pub fn get(&self, emitter: usize) -> &Emitter {
        &self.list[emitter]
    }

    /// What an emitter brings to a point is multiplied by: mean radiance, intensity or irradiance.
    #[cfg(feature = "wgpu")]
    pub fn brightness(&self, emitter: usize) -> f32 {
        match self.light(emitter) {
            None => self.list[emitter].radiance,
            Some(light) => brightness(&self.lights[light]),
        }
    }

    /// Probabilities of few emitters at a point; `room` is room for them.
    #[inline(never)]
    fn seen_from<'a>(&'a self, at: &Receiver, room: &'a mut Vec<f32>) -> &'a [f32] {
        room.clear();
        let mut total = 0.0;
        for e in &self.list {
            let p = e.brings(at);
            total += p;
            room.push(p);
        }
        for light in &self.lights {
            let p = brings(light, at);
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
    pub fn choose(&self, at: &Receiver, u: f32, room: &mut Vec<f32>) -> (usize, f32, f32) {
        match &self.by {
            Choice::Fixed if self.fixed.len() > FEW => self.by_power().choose(u).parts(),
            Choice::Fixed => one_of(&self.fixed, u),
            Choice::SolidAngle => one_of(self.seen_from(at, room), u),
            Choice::Tree(many) => many.choose(self, at, u).parts(),
        }
    }

    /// Probabilities that do not depend on the point.
    #[inline(always)]
    pub fn by_power(&self) -> Fixed<'_> {
        Fixed {
            chances: &self.fixed,
            sums: &self.sums,
            count: self.fixed.len() as u32,
        }
    }

    /// The tree that one is chosen by, if there is one.
    #[cfg(feature = "wgpu")]
    pub fn tree(&self) -> Option<LightTree<'_>> {
        match &self.by {
            Choice::Tree(many) => Some(many.tree(self)),
            _ => None,
        }
    }

    /// Whether they are chosen by the solid angles of all.
    #[cfg(feature = "wgpu")]
    pub fn by_solid_angle(&self) -> bool {
        matches!(self.by, Choice::SolidAngle)
    }

    /// Whether they are so many that one is searched for by sums of their fixed probabilities.
    #[cfg(feature = "wgpu")]
    pub fn by_sums(&self) -> bool {
        self.fixed.len() > FEW
    }

    /// The probability of an emitter at a point.
    #[inline(always)]
    pub fn chance(&self, at: &Receiver, emitter: usize, room: &mut Vec<f32>) -> f32 {
        match &self.by {
            Choice::Fixed => self.fixed[emitter],
            Choice::SolidAngle => self.seen_from(at, room)[emitter],
            Choice::Tree(many) => {
                let by_place = many.chance(self, at, emitter, false);
                (1.0 - BY_POWER) * by_place + BY_POWER * self.fixed[emitter]
            }
        }
    }

    /// A group for a random number, and its probability.
    pub fn choose_group(&self, at: &Receiver, u: f32, room: &mut Vec<f32>) -> (usize, f32) {
        if self.groups.len() == 1 {
            return (0, 1.0);
        }
        let (k, _, _) = self.choose(at, u, room);
        let group = self.group_of(k);
        let members = self.groups[group].members.iter().map(|&k| k as usize);
        let chance = match &self.by {
            Choice::Fixed => members.map(|k| self.fixed[k]).sum(),
            Choice::SolidAngle => {
                let p = self.seen_from(at, room);
                members.map(|k| p[k]).sum()
            }
            Choice::Tree(many) => {
                let by_place = many.chance(self, at, k, true);
                let fixed: f32 = members.map(|k| self.fixed[k]).sum();
                (1.0 - BY_POWER) * by_place + BY_POWER * fixed
            }
        };
        (group, chance)
    }

    /// Visits all emitters whose front a ray hits, as if nothing were in between; `met` is room for some of them.
    #[inline(always)]
    pub fn each_hit_of_all(
        &self,
        at: &Receiver,
        direction: V3,
        met: &mut Met,
        visit: impl FnMut(EmitterHit),
    ) {
        match &self.by {
            Choice::Tree(many) => {
                many.meet(self, at, direction, met);
                let triangles = met.emitters.iter().map(|&k| k as usize);
                let triangles = triangles.filter(|&k| k < self.list.len());
                self.each_hit(triangles, at, direction, visit);
            }
            _ => self.each_hit(self.all(), at, direction, visit),
        }
    }

    /// Visits the emitters among some whose front a ray hits, as if nothing were in between.
    #[inline(always)]
    pub fn each_hit(
        &self,
        members: impl Iterator<Item = usize>,
        at: &Receiver,
        direction: V3,
        mut visit: impl FnMut(EmitterHit),
    ) {
        for k in members {
            let e = &self.list[k];
            let cosine = e.normal.dot(direction);
            if cosine >= -GRAZING {
                continue;
            }
            let from_a = at.position - e.velocity * at.time - e.corners[0];
            let t = -e.normal.dot(from_a) / cosine;
            if t <= 0.0 {
                continue;
            }
            let point = e.corners[0] + from_a + direction * t;
            let [a, b, c] = barycentric(e.corners, e.normal, e.area, point);
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

impl Emitter {
    /// About the irradiance of a point that faces it.
    #[inline(always)]
    fn brings(&self, at: &Receiver) -> f32 {
        let [a, b, c] = self.corners;
        let x = at.position - self.velocity * at.time;
        self.radiance * solid_angle(a, b, c, x).max(0.0)
    }
}

/// About the irradiance of a point that faces a light.
#[inline(always)]
fn brings(light: &DeltaLight, at: &Receiver) -> f32 {
    brightness(light) * light.seen_from(at.position).scale
}

#[inline(always)]
fn brightness(light: &DeltaLight) -> f32 {
    mean(light.strength).max(1e-30)
}
