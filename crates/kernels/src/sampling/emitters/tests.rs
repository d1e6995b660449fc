//! Tests of the probabilities of emitters.

use super::*;
use crate::host::LightKind;
use crate::model::v3;

/// Emitters are drawn with their probabilities, which add up to 1, and the rest of the random number is uniform.
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
            kind: LightKind::Spot as u32,
            cos_inner: 0.9,
            cos_outer: 0.3,
        };
        let list = (0..3).map(emitter).collect();
        let all = Emitters::new(list, vec![light], (false, 1.0), sampling);
        let (mut room, n) = (Vec::new(), 30_000);
        let at = Receiver {
            position: v3(0.1, -0.2, 0.05),
            normal: v3(0.0, 0.0, 1.0),
            time: 0.0,
        };
        let (mut counts, mut rest) = ([0.0; 4], 0.0);
        for i in 0..n {
            let u = (i as f32 + 0.5) / n as f32;
            let (k, chance, left) = all.choose(&at, u, &mut room);
            assert_eq!(chance, all.chance(&at, k, &mut room));
            counts[k] += 1.0 / f64::from(n);
            rest += f64::from(left) / f64::from(n);
        }
        for (k, count) in counts.into_iter().enumerate() {
            let chance = f64::from(all.chance(&at, k, &mut room));
            assert!(
                (count - chance).abs() < 1e-3,
                "{sampling:?} {k}: {count} {chance}"
            );
        }
        assert!((rest - 0.5).abs() < 1e-3);
    }
}

/// Returns triangles all over a cube, and a delta light of each kind.
fn many() -> (Vec<Emitter>, Vec<DeltaLight>) {
    let mut seed = 1u32;
    let mut random = || {
        seed = seed.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (seed >> 8) as f32 / (1 << 24) as f32
    };
    let mut vector = |size: f32| (v3(random(), random(), random()) * 2.0 - V3::ONE) * size;
    let triangles = (0..300).map(|k| {
        let place = vector(1.0);
        let corners = [0; 3].map(|_| place + vector(0.1));
        let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        Emitter {
            triangle: k,
            object: k % 3,
            corners,
            normal: cross.normalize(),
            area: 0.5 * cross.length(),
            velocity: V3::ZERO,
            radiance: 1.0 + (k % 7) as f32,
            group: 0,
        }
    });
    let triangles = triangles.collect();
    let light = |kind: LightKind| DeltaLight {
        position: v3(0.3, -0.4, 0.9),
        axis: v3(0.0, 0.6, -0.8),
        strength: V3::ONE * 0.3,
        kind: kind as u32,
        cos_inner: 0.9,
        cos_outer: 0.3,
    };
    let kinds = [LightKind::Point, LightKind::Directional, LightKind::Spot];
    (triangles, kinds.map(light).to_vec())
}

/// The same holds for a tree, at many points, and for the groups for which shadows are sampled. Light over probability
/// has less variance than with probabilities by power.
#[test]
fn many_emitters_are_drawn_with_their_probabilities() {
    let (triangles, lights) = many();
    let all = Emitters::new(triangles, lights, (false, 1.0), EmitterSampling::SolidAngle);
    assert!(matches!(all.by, Choice::Tree(_)));
    let (count, mut room) = (all.fixed.len(), Vec::new());
    assert!((all.fixed.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    for (x, normal) in [
        (v3(0.2, 0.1, -0.3), v3(0.0, 0.6, 0.8)),
        (v3(-0.2, 0.4, 0.3), v3(0.0, 0.6, -0.8)),
        (v3(-0.7, 0.8, 0.3), v3(0.8, -0.6, 0.0)),
        (v3(-0.9, 0.1, 0.9), v3(0.6, 0.0, -0.8)),
        (v3(-1.2, 0.1, 0.9), v3(0.8, 0.0, -0.6)),
        (v3(3.0, -2.0, 1.0), v3(-1.0, 0.0, 0.0)),
        (v3(-0.9, -0.9, 8.0), v3(0.0, 0.0, 1.0)),
    ] {
        let at = Receiver {
            position: x,
            normal,
            time: 0.0,
        };
        let chances: Vec<f32> = (0..count).map(|k| all.chance(&at, k, &mut room)).collect();
        let sum: f64 = chances.iter().map(|&p| f64::from(p)).sum();
        assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        let n = 40_000;
        let mut counts = vec![0u32; count];
        for i in 0..n {
            let u = (i as f32 + 0.5) / n as f32;
            let (k, chance, rest) = all.choose(&at, u, &mut room);
            assert!(
                (chance / chances[k] - 1.0).abs() < 1e-4,
                "{chance} {}",
                chances[k]
            );
            assert!((0.0..1.0).contains(&rest));
            counts[k] += 1;
            if i % 16 == 0 {
                let members = &all.groups[all.group_of(k)].members;
                let (first, past) = (members[0], members[0] + members.len() as u32);
                let lists = all.lists();
                let share = lists.look(&at, &mut room);
                let chance = lists.chance_of_group(first, past, &at, share, &mut room);
                let members: f32 = members.iter().map(|&k| chances[k as usize]).sum();
                assert!((chance / members - 1.0).abs() < 1e-3, "{chance} {members}");
            }
        }
        for (k, &found) in counts.iter().enumerate() {
            let wanted = n as f32 * chances[k];
            assert!(
                (found as f32 - wanted).abs() < 4.0 + 0.01 * wanted,
                "{k}: {found} {wanted}"
            );
        }
        // E[(light/chance)²]. At best, it is the square of the mean.
        let brings = |k: usize| all.lists().brings(k as u32, &at);
        let facing = |k: usize| match all.light(k) {
            Some(i) => all.lights[i].seen_from(x).direction.dot(normal),
            None => (all.list[k].corners[0] - x).normalize().dot(normal),
        };
        let light = |k: usize| f64::from(brings(k) * facing(k).max(0.0));
        let total: f64 = (0..count).map(light).sum();
        let square: f64 = (0..count)
            .map(|k| light(k).powi(2) / f64::from(chances[k]))
            .sum();
        let by_power: f64 = (0..count)
            .map(|k| light(k).powi(2) / f64::from(all.fixed[k]))
            .sum();
        println!(
            "{} by power, {} by the tree",
            by_power / total / total,
            square / total / total
        );
        assert!(square < 0.9 * by_power, "{square} {by_power}");
    }
}

/// A ray meets the same emitters with a tree as without.
#[test]
fn rays_meet_all_emitters() {
    let (triangles, lights) = many();
    let all = Emitters::new(triangles, lights, (false, 1.0), EmitterSampling::SolidAngle);
    let (mut count, mut met) = (0, Met::default());
    for i in 0..5000 {
        let t = i as f32;
        let at = Receiver {
            position: v3(t.sin(), (1.7 * t).cos(), (0.3 * t).sin()),
            normal: V3::AXES[2],
            time: 0.0,
        };
        let direction = v3((2.3 * t).cos(), (0.7 * t).sin(), (1.1 * t).cos()).normalize();
        let (mut one, mut other) = (Vec::new(), Vec::new());
        all.each_hit_of_all(&at, direction, &mut met, |hit| one.push(hit.emitter));
        all.each_hit(all.triangles(), &at, direction, |hit| {
            other.push(hit.emitter)
        });
        one.sort_unstable();
        assert_eq!(one, other);
        count += one.len();
    }
    assert!(count > 100, "{count}");
}

/// Kernels visit the emitters that a ray hits one after another, and the host visits all at once.
#[cfg(feature = "gpu")]
#[test]
fn the_same_emitters_lie_along_a_ray() {
    let (triangles, lights) = many();
    let few = triangles[..30].to_vec();
    let mut counted = 0;
    for triangles in [triangles, few] {
        let all = Emitters::new(
            triangles,
            lights.clone(),
            (false, 1.0),
            EmitterSampling::SolidAngle,
        );
        let (lists, mut met) = (all.lists(), Met::default());
        let mut room = vec![0; EmitterKinds::MAX_ROOM];
        for k in 0..2000 {
            let (a, b) = ((0.37 * k as f32).sin(), (0.61 * k as f32).cos());
            let at = Receiver {
                position: v3(a, -b, 0.2 - a * b),
                normal: v3(0.0, 0.0, 1.0),
                time: 0.0,
            };
            let direction = v3(b, a + 0.1, b - a).normalize();
            let mut wanted = Vec::new();
            all.each_hit_of_all(&at, direction, &mut met, |hit| wanted.push(hit.emitter));
            wanted.sort_unstable();
            let share = lists.look(&at, &mut room);
            let (mut found, mut from) = (Vec::new(), 0);
            loop {
                let place = lists.place_along(from, direction, &at, share, &mut room);
                if place.emitter == NONE {
                    break;
                }
                found.push(place.emitter);
                from = place.emitter + 1;
            }
            assert_eq!(found, wanted);
            counted += found.len();
        }
    }
    assert!(counted > 50, "{counted}");
}
