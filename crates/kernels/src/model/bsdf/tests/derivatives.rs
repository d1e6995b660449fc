//! Derivatives against central differences.

use super::*;

type Number = (fn(&mut Shading) -> &mut f32, fn(&ShadingGradient) -> f32);

/// Fields of a shading point, with the derivatives with respect to them.
const NUMBERS: [Number; 13] = [
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
    (|s| &mut s.specular.x, |g| g.specular.x),
];

/// Compares a gradient with central differences of a value in those [`NUMBERS`] for which `matters` is true.
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

/// Derivatives of f·cos θ with respect to all fields and the direction, on both sides of where the horizon limits it.
#[test]
fn derivatives_of_the_value() {
    let g = v3(0.7, -0.4, 0.9);
    for s in surfaces() {
        for outgoing in [
            v3(0.4, -0.2, 0.8),
            v3(0.9, 0.1, 0.05),
            v3(0.4, -0.3, -0.8),
            v3(0.9, 0.1, -0.05),
        ]
        .map(V3::normalize)
        {
            let mut found = ShadingGradient::default();
            let by_outgoing = s.evaluate_backward(outgoing, g, &mut found);
            let value = |s: &Shading| g.dot(s.evaluate(outgoing));
            compare(&s, &found, value, |i| s.glossy || i < 10);
            for step in V3::AXES {
                let at = |h: f32| g.dot(s.evaluate(outgoing + step * h));
                let wanted = (at(2e-3) - at(-2e-3)) / 4e-3;
                let close = (by_outgoing.dot(step) - wanted).abs() < 1e-2 * wanted.abs().max(0.2);
                assert!(close, "{s:?}: {by_outgoing:?} {wanted}");
            }
        }
    }
}

/// Derivatives of a sampled direction and its weight, at fixed random numbers and fixed lobe probabilities; with respect to
/// the parameters of the specular lobe at a fixed direction.
#[test]
fn derivatives_of_samples() {
    let (g, by_direction) = (v3(0.7, -0.4, 0.9), v3(0.2, 0.8, -0.5));
    for s in surfaces() {
        for lobe in [0.0, 1.0] {
            if s.model == CONDUCTOR && lobe > 0.0 {
                continue;
            }
            let (u, v) = (0.4, 0.3);
            let drawn = s.sample(u, v, lobe);
            assert!(!drawn.weight.is_zero(), "{s:?}");
            // The derivative is that of f·cos θ over the density, with the choice of the lobe fixed: its probability,
            // or the fraction of light that goes this way at the sampled facet.
            let part = |s: &Shading, d: &Scatter| {
                let f = s.facets_about(s.normal);
                let reflected =
                    s.part_reflected(&f, s.half_of(&f, d.direction, d.of_gloss).normalize());
                if d.of_gloss {
                    reflected
                } else {
                    1.0 - reflected
                }
            };
            let value = |moved: &Shading| {
                if (moved.specular, moved.exponent) != (s.specular, s.exponent) {
                    let value = moved.evaluate(drawn.direction);
                    return g.dot(value) / s.density(drawn.direction);
                }
                let found = moved.sample(u, v, lobe);
                let scale = match s.model {
                    PHONG => 1.0,
                    DIELECTRIC => part(moved, &found) / part(&s, &drawn),
                    _ => {
                        let by = metal::densities(moved, moved.normal, found.direction);
                        let (old, new) = (s.gloss(), moved.gloss());
                        let below = if new < 1.0 {
                            (1.0 - old) / (1.0 - new)
                        } else {
                            1.0
                        };
                        by.element_sum() / (by.x * old / new + by.y * below)
                    }
                };
                g.dot(found.weight) * scale + by_direction.dot(found.direction)
            };
            let mut found = ShadingGradient::default();
            s.sample_backward(
                &drawn,
                g,
                by_direction,
                &Turning::freely(),
                true,
                &mut found,
            );
            // Colors change the probability of the specular lobe, except on a diffuse surface.
            let color = |i: usize| (8..11).contains(&i) || i == 12;
            let matters = |i: usize| match (s.models.has_others(), s.glossy) {
                (true, _) => true,
                (false, true) => !color(i),
                (false, false) => i < 10,
            };
            compare(&s, &found, value, matters);
        }
    }
}

/// A given direction has the same derivative as a sampled direction equal to it.
#[test]
fn directions_as_if_drawn() {
    for s in surfaces().into_iter().filter(|s| s.glossy) {
        for lobe in [0.0, 0.999] {
            let drawn = s.sample(0.4, 0.3, lobe);
            let again = s.as_drawn(drawn.direction, drawn.of_gloss);
            let by = |s: &Shading, d: &Scatter| {
                let mut by = ShadingGradient::default();
                s.direction_backward(d, v3(0.2, 0.8, -0.5), &mut by);
                v3(by.normal.x + by.normal.z, by.exponent, by.incoming.y)
            };
            let (a, b) = (by(&s, &drawn), by(&s, &again));
            assert!((a - b).length() < 2e-3, "{s:?}: {a:?} {b:?}");
        }
    }
}

/// Glass holds directions that leave it near the critical angle, and no others; the derivative of how much they turn.
#[test]
fn directions_held_near_the_critical_angle() {
    let glass = surfaces().into_iter().find(|s| s.model == DIELECTRIC);
    let glass = glass.expect("glass");
    let (mut held, mut free) = (0, 0);
    for (incoming, u, v) in (0..400).map(|k| {
        let [a, b, c] = [0.618, 0.755, 0.570].map(|by| (k as f32 * by).fract());
        (v3(a, 0.3 * b, -1.0 + 0.3 * c).normalize(), b, c)
    }) {
        for inside in [false, true] {
            let s = Shading {
                geometric: v3(0.0, 0.0, 1.0),
                normal: v3(0.0, 0.0, 1.0),
                incoming,
                inside,
                ..glass
            };
            let drawn = s.sample(u, v, 0.999);
            if drawn.weight.is_zero() || drawn.of_gloss {
                continue;
            }
            let at = drawn.direction;
            let turning = s.turning(at, false);
            if turning.part == 1.0 {
                free += 1;
                continue;
            }
            held += 1;
            assert!(inside, "{s:?}");
            for across in [at.cross(V3::AXES[0]), at.cross(V3::AXES[1])] {
                let moved = |h: f32| s.turning((at + across * h).normalize(), false).part;
                let wanted = (moved(1e-3) - moved(-1e-3)) / 2e-3;
                let found = turning.by_direction.dot(across);
                let close = (found - wanted).abs() < 0.02 * wanted.abs().max(1.0);
                assert!(close, "{s:?}: {found} {wanted}");
            }
        }
    }
    assert!(held > 20 && free > 20, "{held} {free}");
}
