//! The BSDF as a density and as physics, and its derivatives against central differences.

use super::*;
use crate::model::frame::SinCos;

/// A gloss and a matt surface, flat and smooth.
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
    all
}

/// The integral of a function over all directions, by a grid of heights and angles.
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

/// Over all directions, and over the hemisphere where the mirror direction is the normal.
#[test]
fn the_density_integrates_to_one() {
    for mut s in surfaces() {
        let all = over_sphere(|d| s.density(d));
        assert!((all - 1.0).abs() < 2e-3, "{s:?}: {all}");
        s.incoming = -s.normal;
        let above = over_sphere(|d| {
            if d.dot(s.normal) > 0.0 {
                s.density(d)
            } else {
                0.0
            }
        });
        assert!((above - 1.0).abs() < 2e-3, "{s:?}: {above}");
        let d = v3(0.2, 0.3, 0.9).normalize();
        let shares = s.share_of_lobe(d, false) + s.share_of_lobe(d, true);
        assert!((shares - 1.0).abs() < 1e-6);
    }
}

/// A flat surface reflects at most k_d + k_s, which it does where all of the lobe is above it.
#[test]
fn the_albedo_is_at_most_one() {
    for mut s in surfaces().into_iter().filter(|s| !s.smooth) {
        for incoming in [-V3::AXES[2], s.incoming, v3(0.99, 0.0, -0.1).normalize()] {
            s.incoming = incoming;
            let albedo = over_sphere(|d| s.evaluate(d).x);
            let most = f64::from(s.diffuse.x + s.specular.x);
            assert!(albedo <= most + 2e-3, "{s:?}: {albedo}");
            assert!(albedo <= 1.0 && (incoming != -V3::AXES[2] || albedo > 0.99 * most));
        }
    }
}

/// f is the same with light and eye exchanged.
#[test]
fn reciprocity() {
    for s in surfaces().into_iter().filter(|s| !s.smooth) {
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

/// Directions that are drawn have the density that is told: the mean of f·cos θ over it is the albedo.
#[test]
fn drawn_directions_have_their_density() {
    for s in surfaces() {
        let n = 1 << 14;
        let mut mean = 0.0;
        for i in 0..n {
            // Additive recurrences.
            let [u, v, lobe] = [0.819_172_5, 0.671_043_6, 0.549_700_5]
                .map(|step: f64| (step * f64::from(i)).fract() as f32);
            mean += f64::from(s.sample(u, v, lobe).weight.y) / f64::from(n);
        }
        let wanted = over_sphere(|d| s.evaluate(d).y);
        assert!((mean - wanted).abs() < 6e-3, "{s:?}: {mean} {wanted}");
    }
}

type Number = (fn(&mut Shading) -> &mut f32, fn(&ShadingGradient) -> f32);

/// Numbers that a shaded point is made of, with the derivatives by them.
const NUMBERS: [Number; 12] = [
    (|s| &mut s.normal.x, |g| g.normal.x),
    (|s| &mut s.normal.y, |g| g.normal.y),
    (|s| &mut s.normal.z, |g| g.normal.z),
    (|s| &mut s.geometric.x, |g| g.geometric.x),
    (|s| &mut s.geometric.z, |g| g.geometric.z),
    (|s| &mut s.incoming.x, |g| g.incoming.x),
    (|s| &mut s.incoming.y, |g| g.incoming.y),
    (|s| &mut s.incoming.z, |g| g.incoming.z),
    (|s| &mut s.diffuse.x, |g| g.diffuse.x),
    (|s| &mut s.diffuse.z, |g| g.diffuse.z),
    (|s| &mut s.specular.y, |g| g.specular.y),
    (|s| &mut s.exponent, |g| g.exponent),
];

/// Compares a gradient with central differences of a value in [`NUMBERS`], where `matters` says so.
fn compare(
    s: &Shading,
    found: &ShadingGradient,
    value: impl Fn(&Shading) -> f32,
    matters: impl Fn(usize) -> bool,
) {
    for (i, (number, gradient)) in NUMBERS.into_iter().enumerate().filter(|n| matters(n.0)) {
        let h = 1e-3;
        let (mut a, mut b) = (*s, *s);
        *number(&mut a) += h;
        *number(&mut b) -= h;
        let wanted = (value(&a) - value(&b)) / (2.0 * h);
        let got = gradient(found);
        let close = (got - wanted).abs() < 1e-2 * wanted.abs().max(0.2);
        assert!(close, "{i} of {s:?}: {got} {wanted}");
    }
}

/// f·cos θ by all that it is made of and by the direction, on both sides of where the horizon matters.
#[test]
fn derivatives_of_the_value() {
    let g = v3(0.7, -0.4, 0.9);
    for s in surfaces() {
        for outgoing in [v3(0.4, -0.2, 0.8), v3(0.9, 0.1, 0.05)].map(V3::normalize) {
            let mut found = ShadingGradient::default();
            let by_outgoing = s.evaluate_backward(outgoing, g, &mut found);
            let value = |s: &Shading| g.dot(s.evaluate(outgoing));
            compare(&s, &found, value, |i| s.glossy || !(10..12).contains(&i));
            for step in V3::AXES {
                let at = |h: f32| g.dot(s.evaluate(outgoing + step * h));
                let wanted = (at(2e-3) - at(-2e-3)) / 4e-3;
                let close = (by_outgoing.dot(step) - wanted).abs() < 1e-2 * wanted.abs().max(0.2);
                assert!(close, "{s:?}: {by_outgoing:?} {wanted}");
            }
        }
    }
}

/// A drawn direction and its weight, at fixed random numbers and a fixed share of the lobes.
#[test]
fn derivatives_of_samples() {
    let (g, by_direction) = (v3(0.7, -0.4, 0.9), v3(0.2, 0.8, -0.5));
    for s in surfaces() {
        for lobe in [0.0, 1.0] {
            let (u, v) = (0.4, 0.3);
            let drawn = s.sample(u, v, lobe);
            let gloss = s.gloss();
            let value = |s: &Shading| {
                let drawn = s.sample(u, v, lobe);
                // The derivative is that of f·cos θ over the density, whose share of gloss stays.
                assert!((s.gloss() - gloss).abs() < 1e-6);
                g.dot(drawn.weight) + by_direction.dot(drawn.direction)
            };
            let mut found = ShadingGradient::default();
            s.sample_backward(&drawn, g, by_direction, &mut found);
            // Colours change the share of gloss, but for those of a matt surface.
            let colour = |i: usize| (8..11).contains(&i);
            let matters = |i: usize| {
                if s.glossy { !colour(i) } else { i < 10 }
            };
            compare(&s, &found, value, matters);
        }
    }
}
