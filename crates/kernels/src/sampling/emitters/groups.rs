//! Groups of nearby emitters, whose shadows are sampled together.

use super::Emitter;
use crate::model::V3;

/// A group of emitters, and a sphere around them at the start of the shutter time.
#[derive(Clone, Debug, Default)]
pub struct EmitterGroup {
    pub members: Vec<u32>,
    pub center: V3,
    pub radius: f32,
    /// The velocity of all members.
    pub velocity: V3,
}

/// The largest number of emitters in a group.
const TOGETHER: usize = 8;

/// Groups consecutive emitters of one object, which have the same velocity, up to [`TOGETHER`] at a time.
pub(super) fn group(list: &[Emitter]) -> Vec<EmitterGroup> {
    let mut groups: Vec<EmitterGroup> = Vec::new();
    let mut last = None;
    for (k, e) in list.iter().enumerate() {
        let object = e.object;
        match groups.last_mut() {
            Some(g) if last == Some(object) && g.members.len() < TOGETHER => {
                g.members.push(k as u32);
            }
            _ => groups.push(EmitterGroup {
                members: vec![k as u32],
                center: V3::ZERO,
                radius: 0.0,
                velocity: e.velocity,
            }),
        }
        last = Some(object);
    }
    for g in &mut groups {
        let corners = || g.members.iter().flat_map(|&k| list[k as usize].corners);
        let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
        for c in corners() {
            low = low.min(c);
            high = high.max(c);
        }
        let center = (low + high) * 0.5;
        let radius = corners().map(|c| (c - center).length()).fold(0.0, f32::max);
        g.center = center;
        g.radius = radius * (1.0 + 1e-5);
    }
    groups
}
