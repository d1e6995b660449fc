//! Densities, reciprocity and albedos of the BSDFs, and their derivatives against central differences.

mod derivatives;
mod furnace;
mod ranges;

use super::*;
use crate::model::frame::{SinCos, sin_cos_of_turns};
use crate::model::v3;

const PHONG: u32 = BsdfKind::Phong as u32;
const METALLIC: u32 = BsdfKind::MetallicRoughness as u32;
const CONDUCTOR: u32 = BsdfKind::Conductor as u32;
const DIELECTRIC: u32 = BsdfKind::Dielectric as u32;

/// Diffuse and glossy Phong surfaces and [`of_facets`], flat and smooth.
fn surfaces() -> Vec<Shading> {
    let mut all = Vec::new();
    for (glossy, exponent) in [(false, 1.0), (true, 3.0), (true, 40.0)] {
        for tilt in [0.0, 0.3] {
            all.push(Shading {
                geometric: V3::AXES[2],
                normal: v3(tilt, 0.5 * tilt, 1.0).normalize(),
                incoming: v3(0.5, -0.3, -0.7).normalize(),
                diffuse: v3(0.5, 0.3, 0.1),
                specular: if glossy { v3(0.3, 0.5, 0.6) } else { V3::ZERO },
                exponent,
                glossy,
                smooth: tilt != 0.0,
                ..Shading::default()
            });
        }
    }
    all.extend(of_facets());
    all
}

/// Metallic-roughness with high and low metallic, a conductor, and glass from outside and inside, flat and smooth.
fn of_facets() -> Vec<Shading> {
    let mut all = Vec::new();
    let gold = (v3(0.2, 0.5, 1.4), v3(3.9, 2.3, 1.7));
    let base = v3(0.5, 0.3, 0.9);
    for (model, (diffuse, specular), inside) in [
        (METALLIC, (base, v3(0.95, 0.0, 0.0)), false),
        (METALLIC, (base, v3(0.3, 0.0, 0.0)), false),
        (CONDUCTOR, gold, false),
        (DIELECTRIC, (base, v3(1.5, 0.0, 0.0)), false),
        (DIELECTRIC, (base, v3(1.5, 0.0, 0.0)), true),
    ] {
        for (tilt, exponent, compensated) in [(0.0, 0.4, true), (0.3, 0.8, false)] {
            all.push(Shading {
                geometric: V3::AXES[2],
                normal: v3(tilt, 0.5 * tilt, 1.0).normalize(),
                incoming: v3(0.3, -0.2, -0.7).normalize(),
                diffuse,
                specular,
                exponent,
                glossy: true,
                smooth: tilt != 0.0,
                model,
                compensated,
                inside,
                models: Models::ALL,
                ..Shading::default()
            });
        }
    }
    all
}

/// The fraction of samples that are not lost: facets of glass may turn light to the wrong side.
fn kept(s: &Shading) -> f64 {
    let n = 1 << 14;
    let kept = numbers(n).filter(|&[u, v, lobe]| {
        let drawn = s.sample(u, v, lobe);
        s.model != DIELECTRIC || drawn.of_gloss == (s.normal.dot(drawn.direction) > 0.0)
    });
    kept.count() as f64 / f64::from(n)
}

/// Points of additive recurrences.
fn numbers(n: u32) -> impl Iterator<Item = [f32; 3]> {
    (0..n).map(|i| {
        [0.819_172_5, 0.671_043_6, 0.549_700_5]
            .map(|step: f64| (step * f64::from(i)).fract() as f32)
    })
}

/// The integral of a function over all directions, on a grid of heights and angles.
fn over_sphere(f: impl Fn(V3) -> f32) -> f64 {
    let (rows, columns) = (800, 800);
    let mut sum = 0.0;
    for i in 0..rows {
        let z = (2 * i + 1) as f32 / rows as f32 - 1.0;
        let sine = (1.0 - z * z).sqrt();
        for j in 0..columns {
            let SinCos { sin, cos } = sin_cos_of_turns((j as f32 + 0.5) / columns as f32);
            sum += f64::from(f(v3(sine * cos, sine * sin, z)));
        }
    }
    sum * 4.0 * std::f64::consts::PI / f64::from(rows * columns)
}

/// Over all directions, and over the hemisphere if the mirror direction is the normal.
#[test]
fn the_density_integrates_to_one() {
    for mut s in surfaces() {
        let all = over_sphere(|d| s.density(d));
        let wanted = kept(&s);
        assert!((all - wanted).abs() < 4e-3, "{s:?}: {all} {wanted}");
        let d = v3(0.2, 0.3, 0.9).normalize();
        let shares = s.share_of_lobe(d, false) + s.share_of_lobe(d, true);
        assert!((shares - 1.0).abs() < 1e-6);
        if s.models.has_others() {
            continue;
        }
        s.incoming = -s.normal;
        let above = over_sphere(|d| {
            if d.dot(s.normal) > 0.0 {
                s.density(d)
            } else {
                0.0
            }
        });
        assert!((above - 1.0).abs() < 2e-3, "{s:?}: {above}");
    }
}

/// A flat surface reflects at most k_d + k_s, and exactly that if the whole lobe is above it.
#[test]
fn the_albedo_is_at_most_one() {
    for mut s in surfaces()
        .into_iter()
        .filter(|s| !s.smooth && !s.models.has_others())
    {
        for incoming in [-V3::AXES[2], s.incoming, v3(0.99, 0.0, -0.1).normalize()] {
            s.incoming = incoming;
            let albedo = over_sphere(|d| s.evaluate(d).x);
            let most = f64::from(s.diffuse.x + s.specular.x);
            assert!(albedo <= most + 2e-3, "{s:?}: {albedo}");
            assert!(albedo <= 1.0 && (incoming != -V3::AXES[2] || albedo > 0.99 * most));
        }
    }
}

/// Reflection by glass is symmetric in light and eye. Refraction is symmetric after division by the square of the
/// index on the side that light goes to.
#[test]
fn reciprocity_of_glass() {
    for mut s in of_facets() {
        if s.model != DIELECTRIC || s.smooth {
            continue;
        }
        // The compensation depends on the view alone.
        s.compensated = false;
        for outgoing in [v3(-0.4, 0.3, 0.8), v3(0.3, -0.3, -0.8)].map(V3::normalize) {
            let below = outgoing.z < 0.0;
            let side = if below { -1.0 } else { 1.0 };
            let other = Shading {
                incoming: -outgoing,
                normal: s.normal * side,
                geometric: s.geometric * side,
                inside: s.inside != below,
                ..s
            };
            let f = s.evaluate(outgoing).x / outgoing.z.abs();
            let back = other.evaluate(-s.incoming).x / s.incoming.z.abs();
            let square = match (below, s.inside) {
                (false, _) => 1.0,
                (true, false) => 2.25,
                (true, true) => 1.0 / 2.25,
            };
            let close = (f * square - back).abs() < 1e-4 * back;
            assert!(close && f > 0.0, "{s:?}: {f} {back}");
        }
    }
}

/// f is symmetric in light and eye.
#[test]
fn reciprocity() {
    for mut s in surfaces().into_iter().filter(|s| !s.smooth) {
        // The compensation depends on the view alone.
        s.compensated = false;
        if s.model == DIELECTRIC {
            continue;
        }
        let outgoing = v3(-0.2, 0.6, 0.8).normalize();
        let other = Shading {
            incoming: -outgoing,
            ..s
        };
        let f = s.evaluate(outgoing) * (1.0 / outgoing.z);
        let back = other.evaluate(-s.incoming) * (1.0 / -s.incoming.z);
        assert!((f - back).length() < 1e-5, "{f:?} {back:?}");
    }
}

/// Sampled directions have the returned density: the mean of f·cos θ over the density is the albedo.
#[test]
fn drawn_directions_have_their_density() {
    for s in surfaces() {
        let n = 1 << 14;
        let mut mean = 0.0;
        for [u, v, lobe] in numbers(n) {
            mean += f64::from(s.sample(u, v, lobe).weight.y) / f64::from(n);
        }
        let wanted = over_sphere(|d| s.evaluate(d).y);
        assert!((mean - wanted).abs() < 6e-3, "{s:?}: {mean} {wanted}");
    }
}
