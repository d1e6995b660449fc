//! Emitters, and the choice of one that a surface point is connected to; it carries no gradient.

mod branches;
mod fixed;
mod groups;
mod lists;
mod many;
#[cfg(feature = "wgpu")]
mod places;
mod powers;
#[cfg(test)]
mod tests;
mod tree;

use super::strategies::EmitterSampling;
use crate::accel::LANES;
use crate::accel::eights::NONE;
use crate::model::V3;
use crate::model::delta_light::DeltaLight;
pub(crate) use fixed::{Chosen, Fixed};
pub(crate) use groups::EmitterGroup;
use groups::group;
use lists::FEW;
pub(crate) use lists::{
    Choosing, EmitterHit, EmitterKinds, EmitterLists, EmitterTriangle, OF_EMITTER, Receiver,
    no_emitter_hit,
};
use many::ManyEmitters;
pub(crate) use many::Met;
#[cfg(feature = "wgpu")]
pub(crate) use places::EmitterPlace;
use powers::{powers_of_lights, running_sums};
pub(crate) use tree::LightTree;

/// The emitters of a scene: triangles, then delta lights, in one count.
pub(crate) struct Emitters {
    list: Vec<Emitter>,
    lights: Vec<DeltaLight>,
    /// Probabilities that do not depend on the point.
    pub fixed: Vec<f32>,
    /// Sums of these up to each emitter.
    sums: Vec<f32>,
    by: Choice,
    pub kinds: EmitterKinds,
    flat: Flat,
    /// Emitters that are near to each other, whose shadows are sampled together; then delta lights, one by one.
    pub groups: Vec<EmitterGroup>,
    /// The group of each delta light.
    group_of_light: Vec<u32>,
}

/// What [`EmitterLists`] read.
#[derive(Default)]
struct Flat {
    triangles: Vec<[f32; OF_EMITTER]>,
    lights: Vec<[f32; 11]>,
    bits: Vec<u32>,
    brightness: Vec<f32>,
}

impl Flat {
    fn new(list: &[Emitter], lights: &[DeltaLight]) -> Self {
        let triangle = |e: &Emitter| {
            let [a, b, c] = e.corners;
            let vectors = [a, b, c, e.normal, e.velocity].map(V3::to_array);
            let mut numbers = [e.area; OF_EMITTER];
            numbers[..12].copy_from_slice(vectors[..4].as_flattened());
            numbers[13..].copy_from_slice(&vectors[4]);
            numbers
        };
        let of_triangles = list.iter().map(|e| e.radiance);
        Self {
            triangles: list.iter().map(triangle).collect(),
            lights: lights.iter().map(DeltaLight::numbers).collect(),
            bits: lights.iter().map(|light| light.kind).collect(),
            brightness: of_triangles
                .chain(lights.iter().map(|l| l.mean().max(1e-30)))
                .collect(),
        }
    }
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

/// Emitters under a glancing angle are chosen with at least this share of their power's probability:
/// their light is small there, but its derivative is not.
pub(crate) const BY_POWER: f32 = 0.1;

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
            kinds: EmitterKinds::default(),
            flat: Flat::default(),
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
        this.kinds = EmitterKinds {
            lights: !this.lights.is_empty(),
            moves,
            by_solid_angle: matches!(this.by, Choice::SolidAngle),
            by_tree: matches!(this.by, Choice::Tree(_)),
            by_sums: count > FEW,
            room: match this.by {
                Choice::SolidAngle => count.next_power_of_two().max(LANES),
                _ => LANES,
            },
        };
        this.flat = Flat::new(&this.list, &this.lights);
        this
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty() && self.lights.is_empty()
    }

    /// The delta light that an emitter is, by its place among those.
    #[inline(always)]
    pub fn light(&self, emitter: usize) -> Option<usize> {
        emitter.checked_sub(self.list.len())
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

    /// What a choice reads.
    #[inline(always)]
    pub fn lists(&self) -> EmitterLists<'_> {
        let fixed = Fixed {
            chances: &self.fixed,
            sums: &self.sums,
            count: self.fixed.len() as u32,
        };
        EmitterLists {
            triangles: self.flat.triangles.as_flattened(),
            triangle_count: self.list.len() as u32,
            lights: self.flat.lights.as_flattened(),
            bits: &self.flat.bits,
            brightness: &self.flat.brightness,
            tree: match &self.by {
                Choice::Tree(many) => many.tree(fixed),
                _ => LightTree::none(fixed),
            },
            kinds: self.kinds,
        }
    }

    /// An emitter for a random number, its probability, and what is left of the number, uniform again.
    pub fn choose(&self, at: &Receiver, u: f32, room: &mut Vec<u32>) -> (usize, f32, f32) {
        let lists = self.lists();
        room.resize(self.kinds.room, 0);
        let share = lists.look(at, room);
        let choice = lists.choose(u, at, share, room);
        (choice.emitter as usize, choice.chance, choice.rest)
    }

    /// The probability of an emitter at a point.
    pub fn chance(&self, at: &Receiver, emitter: usize, room: &mut Vec<u32>) -> f32 {
        let lists = self.lists();
        room.resize(self.kinds.room, 0);
        let share = lists.look(at, room);
        lists.chance(emitter as u32, at, share, room)
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
        let lists = self.lists();
        for k in members {
            let hit = lists.hit(k as u32, at.position, direction, at.time);
            if hit.emitter != NONE {
                visit(hit);
            }
        }
    }

    /// All triangles.
    pub fn all(&self) -> std::ops::Range<usize> {
        0..self.list.len()
    }
}
