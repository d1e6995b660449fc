//! Emitters, and the choice of one for next-event estimation at a surface point. The choice carries no gradient.

mod branches;
mod fixed;
mod groups;
mod lists;
mod many;
#[cfg(feature = "gpu")]
mod places;
mod powers;
#[cfg(test)]
mod tests;
mod tree;

use super::strategies::EmitterSampling;
use crate::accel::LANES;
use crate::accel::eights::NONE;
use crate::model::V3;
use crate::model::delta_light::{DeltaLight, OF_LIGHT};
pub use fixed::{Chosen, Fixed};
pub use groups::EmitterGroup;
use groups::group;
use lists::MAX_SOLID_ANGLES;
pub use lists::{
    Choosing, EmitterHit, EmitterKinds, EmitterLists, EmitterTriangle, OF_EMITTER, Receiver,
    no_emitter_hit,
};
use many::ManyEmitters;
pub use many::Met;
#[cfg(feature = "gpu")]
pub use places::EmitterPlace;
use powers::{powers_of_lights, running_sums};
pub use tree::LightTree;

/// The emitters of a scene. Triangles are numbered first, then delta lights.
pub struct Emitters {
    list: Vec<Emitter>,
    lights: Vec<DeltaLight>,
    /// Probabilities that do not depend on the point.
    pub fixed: Vec<f32>,
    /// Running sums of these probabilities.
    sums: Vec<f32>,
    by: Choice,
    pub kinds: EmitterKinds,
    flat: Flat,
    /// Groups of nearby triangles, whose shadows are sampled together. Each delta light is a group of its own.
    pub groups: Vec<EmitterGroup>,
    /// The group of each delta light.
    group_of_light: Vec<u32>,
}

/// The data of [`EmitterLists`].
#[derive(Default)]
struct Flat {
    triangles: Vec<[f32; OF_EMITTER]>,
    lights: Vec<[f32; OF_LIGHT]>,
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

/// How an emitter is chosen.
enum Choice {
    /// With probabilities that do not depend on the point.
    Fixed,
    /// By the solid angles of all emitters.
    SolidAngle,
    /// By a tree.
    Tree(ManyEmitters),
}

/// A triangle that emits from its front, in inner coordinates at the start of the shutter.
#[derive(Clone, Copy, Debug)]
pub struct Emitter {
    /// The triangle's number in the scene, and its object's.
    pub triangle: u32,
    pub object: u32,
    pub corners: [V3; 3],
    pub normal: V3,
    pub area: f32,
    pub velocity: V3,
    /// Mean radiance. [`Emitters::new`] raises it above 0, since an emitter that is black now may have a gradient.
    pub radiance: f32,
    /// An index of [`Emitters::groups`].
    pub group: u32,
}

/// The least probability of an emitter, relative to its probability by power. At a grazing angle an emitter's light is
/// small, but the derivative of the light is not.
pub const BY_POWER: f32 = 0.1;

impl Emitters {
    /// Takes a list in the order of the scene's triangles. `moves` states whether any velocity is used. `size` is the
    /// typical size of the scene, in the unit of coordinates.
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
        // From any point, the solid angles of emitters in one plane are about in proportion to their areas.
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
        if by_place && count > MAX_SOLID_ANGLES {
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
            by_sums: count > MAX_SOLID_ANGLES,
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

    /// Returns the index of an emitter among the delta lights, or `None` for a triangle.
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

    /// Returns whether probabilities depend on the point.
    pub fn depends_on_position(&self) -> bool {
        !matches!(self.by, Choice::Fixed)
    }

    pub fn get(&self, emitter: usize) -> &Emitter {
        &self.list[emitter]
    }

    /// Returns the lists for a choice.
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

    /// Chooses an emitter with a random number. Returns its number, its probability, and the rest of the random number,
    /// which is uniform again.
    pub fn choose(&self, at: &Receiver, u: f32, room: &mut Vec<u32>) -> (usize, f32, f32) {
        let lists = self.lists();
        room.resize(self.kinds.room, 0);
        let share = lists.look(at, room);
        let choice = lists.choose(u, at, share, room);
        (choice.emitter as usize, choice.chance, choice.rest)
    }

    /// Returns the probability of an emitter at a point.
    pub fn chance(&self, at: &Receiver, emitter: usize, room: &mut Vec<u32>) -> f32 {
        let lists = self.lists();
        room.resize(self.kinds.room, 0);
        let share = lists.look(at, room);
        lists.chance(emitter as u32, at, share, room)
    }

    /// Visits all emitters whose front a ray hits, regardless of occluders. `met` is scratch space.
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
            _ => self.each_hit(self.triangles(), at, direction, visit),
        }
    }

    /// Visits the listed emitters whose front a ray hits, regardless of occluders.
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

    /// Returns the numbers of all triangles.
    pub fn triangles(&self) -> std::ops::Range<usize> {
        0..self.list.len()
    }
}
