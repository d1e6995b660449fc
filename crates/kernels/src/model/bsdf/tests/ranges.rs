//! Parameters outside their ranges.

use super::*;

/// Shadings with one parameter out of range, each with its clamped equivalent.
fn outside() -> Vec<(Shading, Shading)> {
    let of = |model: u32| {
        let mut all = of_facets().into_iter();
        all.find(|s| s.model == model).expect("one of the model")
    };
    let (metal, conductor, glass) = (of(METALLIC), of(CONDUCTOR), of(DIELECTRIC));
    let mut all = Vec::new();
    for s in [metal, conductor, glass] {
        for (exponent, as_if) in [(1.5, 1.0), (-0.5, 0.0)] {
            all.push((
                Shading { exponent, ..s },
                Shading {
                    exponent: as_if,
                    ..s
                },
            ));
        }
    }
    let specular = |s: Shading, x: f32| Shading {
        specular: v3(x, s.specular.y, s.specular.z),
        ..s
    };
    let diffuse = |s: Shading, x: f32| Shading {
        diffuse: v3(x, s.diffuse.y, s.diffuse.z),
        ..s
    };
    for (x, as_if) in [(1.5, 1.0), (-0.5, 0.0), (1e30, 1.0)] {
        all.push((specular(metal, x), specular(metal, as_if)));
    }
    for (x, as_if) in [(-0.5, 0.0), (1e30, 1e4)] {
        all.push((specular(conductor, x), specular(conductor, as_if)));
        all.push((diffuse(conductor, x), diffuse(conductor, as_if)));
    }
    for (x, as_if) in [(0.01, 0.1), (-2.0, 0.1), (30.0, 10.0), (1.0002, 1.001)] {
        all.push((specular(glass, x), specular(glass, as_if)));
    }
    all
}

/// A value out of range acts as the nearest value inside and has no derivative; the other parameters keep theirs.
#[test]
fn values_outside_of_their_ranges_have_no_derivative() {
    let by_direction = v3(0.2, 0.8, -0.5);
    for (s, inside) in outside() {
        let of = |s: &Shading| {
            let mut by = ShadingGradient::default();
            for outgoing in [v3(0.4, -0.2, 0.8), v3(0.4, -0.3, -0.8)].map(V3::normalize) {
                s.evaluate_backward(outgoing, V3::ONE, &mut by);
            }
            for lobe in [0.0, 0.999] {
                let drawn = s.sample(0.4, 0.3, lobe);
                s.sample_backward(
                    &drawn,
                    V3::ONE,
                    by_direction,
                    &Turning::freely(),
                    true,
                    &mut by,
                );
            }
            by
        };
        let outgoing = v3(0.4, -0.2, 0.8).normalize();
        assert_eq!(s.evaluate(outgoing), inside.evaluate(outgoing), "{s:?}");
        let (found, wanted) = (of(&s), of(&inside));
        let numbers = |by: &ShadingGradient, s: &Shading| {
            [
                (by.exponent, s.exponent),
                (by.specular.x, s.specular.x),
                (by.specular.y, s.specular.y),
                (by.diffuse.x, s.diffuse.x),
                (by.diffuse.y, s.diffuse.y),
            ]
        };
        let both = numbers(&found, &s)
            .into_iter()
            .zip(numbers(&wanted, &inside));
        for (i, ((by, value), (by_inside, nearest))) in both.enumerate() {
            let wanted = if value == nearest { by_inside } else { 0.0 };
            assert_eq!(by, wanted, "{i} of {s:?}");
        }
    }
}

/// An ideal mirror, whose η is 0, has finite derivatives of moderate size.
#[test]
fn metal_without_a_real_index() {
    for s in of_facets().into_iter().filter(|s| s.model == CONDUCTOR) {
        let s = Shading {
            diffuse: V3::ZERO,
            ..s
        };
        let mut by = ShadingGradient::default();
        s.evaluate_backward(v3(-0.3, 0.1, 0.9).normalize(), V3::ONE, &mut by);
        assert!(by.specular.abs().max_element() < 1e-3, "{by:?}");
        assert!(by.diffuse.max_element() < 0.0 && by.diffuse.abs().max_element() < 10.0);
    }
}
