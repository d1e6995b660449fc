//! Furnace tests: albedos under uniform light.

use super::*;

const ROUGHNESSES: [f32; 6] = [0.0, 0.1, 0.25, 0.5, 0.75, 1.0];
const DEGREES: [f32; 5] = [0.0, 30.0, 60.0, 75.0, 85.0];

/// A white surface seen at an angle to its normal.
fn white(model: u32, specular: f32, roughness: f32, degrees: f32) -> Shading {
    let angle = degrees.to_radians();
    Shading {
        geometric: V3::AXES[2],
        normal: V3::AXES[2],
        incoming: v3(angle.sin(), 0.0, -angle.cos()),
        diffuse: V3::ONE,
        specular: v3(specular, 0.0, 0.0),
        exponent: roughness,
        glossy: true,
        model,
        compensated: true,
        models: Models::ALL,
        ..Shading::default()
    }
}

/// The fraction of light that is scattered. `below` is the factor of refracted radiance: the square of an index.
fn albedo(s: &Shading, below: f64) -> f64 {
    let n = 1 << 14;
    let light = |[u, v, lobe]: [f32; 3]| {
        let drawn = s.sample(u, v, lobe);
        let counts = match s.model == DIELECTRIC && !drawn.of_gloss {
            true => below,
            false => 1.0,
        };
        f64::from(drawn.weight.x) * counts
    };
    numbers(n).map(light).sum::<f64>() / f64::from(n)
}

/// Prints the albedos of a model by roughness and angle, and asserts that they lie in a range.
fn table(name: &str, least: f64, of: impl Fn(f32, f32) -> f64) {
    println!("{name}: roughness, and albedos at {DEGREES:?}°");
    for roughness in ROUGHNESSES {
        let row = DEGREES.map(|degrees| of(roughness, degrees));
        println!("  {roughness:<5} {row:.4?}");
        for (albedo, degrees) in row.iter().zip(DEGREES) {
            let kept = (least..=1.001).contains(albedo);
            assert!(kept, "{name}, {roughness}, {degrees}°: {albedo}");
        }
    }
}

/// White facets and a white base scatter all light except for 3 %, for any metallic parameter.
#[test]
fn metal_and_paint() {
    for metallic in [0.0, 0.25, 0.5, 0.75, 1.0] {
        table(&format!("metallic {metallic}"), 0.97, |r, degrees| {
            albedo(&white(METALLIC, metallic, r, degrees), 1.0)
        });
    }
    table("conductor", 0.97, |r, degrees| {
        let mirror = Shading {
            diffuse: splat(0.05),
            specular: splat(40.0),
            ..white(CONDUCTOR, 0.0, r, degrees)
        };
        albedo(&mirror, 1.0)
    });
}

/// Glass scatters all light except for 3 %, from outside and inside. From inside of an index below 1.35, whose
/// critical angle is near the horizon, the limit is 6 %.
#[test]
fn glass() {
    for (ior, faint) in [
        (1.002, true),
        (1.1, true),
        (1.33, true),
        (1.5, false),
        (2.4, false),
    ] {
        for inside in [false, true] {
            let least = if faint && inside { 0.94 } else { 0.97 };
            let square = f64::from(ior * ior);
            let below = if inside { 1.0 / square } else { square };
            table(&format!("glass {ior}, inside {inside}"), least, |r, d| {
                let clear = Shading {
                    inside,
                    ..white(DIELECTRIC, ior, r, d)
                };
                albedo(&clear, below)
            });
        }
    }
}

/// Without compensation rough metal and rough glass lose light; smooth ones do not.
#[test]
fn what_is_lost_between_facets() {
    for (model, specular) in [(METALLIC, 1.0), (DIELECTRIC, 1.5)] {
        for (roughness, range) in [(0.1, 0.99..=1.001), (0.8, 0.0..=0.98)] {
            let s = Shading {
                compensated: false,
                ..white(model, specular, roughness, 45.0)
            };
            let found = albedo(&s, 2.25);
            assert!(range.contains(&found), "{model}, {roughness}: {found}");
        }
    }
}

/// Near the horizon light may be lost; at most 3 % are gained.
#[test]
fn near_the_horizon() {
    for (model, specular, inside) in [
        (METALLIC, 0.0, false),
        (METALLIC, 1.0, false),
        (DIELECTRIC, 1.1, true),
        (DIELECTRIC, 1.5, false),
        (DIELECTRIC, 1.5, true),
        (DIELECTRIC, 2.4, false),
        (DIELECTRIC, 2.4, true),
    ] {
        let square = f64::from(specular * specular);
        let below = if inside { 1.0 / square } else { square };
        let mut most = 0f64;
        for degrees in [86.0, 87.0, 88.0, 89.0, 89.5, 89.9] {
            for roughness in ROUGHNESSES {
                let s = Shading {
                    inside,
                    ..white(model, specular, roughness, degrees)
                };
                let found = albedo(&s, below);
                assert!(
                    found < 1.03,
                    "{model}, {specular}, {inside}, {roughness}: {found}"
                );
                most = most.max(found);
            }
        }
        println!("model {model}, {specular}, inside {inside}: at most {most:.4}");
    }
}

/// A Phong surface with k_d + k_s = 1 gains no energy; its lobe is cut off at the horizon.
#[test]
fn phong() {
    for exponent in [1.0, 10.0, 100.0] {
        for degrees in DEGREES {
            let s = Shading {
                diffuse: splat(0.5),
                specular: splat(0.5),
                ..white(PHONG, 0.0, exponent, degrees)
            };
            let found = albedo(&s, 1.0);
            println!("Phong, n = {exponent}, {degrees}°: {found:.4}");
            assert!(found <= 1.001, "{exponent}, {degrees}°: {found}");
        }
    }
}
