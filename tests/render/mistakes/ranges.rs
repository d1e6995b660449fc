//! Values that no material, light, sky or camera has.

use softray::Result;
use softray::prelude::*;

use crate::common::mistakes::{Mistakes, ball, camera, flex, lit, row, see, small};

/// Constants that no material, light or sky has, and colors of vertices that are not.
#[test]
#[expect(clippy::too_many_lines, reason = "a list of mistakes")]
fn constants_out_of_their_ranges() {
    let huge = 1e30;
    let metal = |metallic, roughness| Material::metallic_roughness([0.5; 3], metallic, roughness);
    let texels = || Tensor::<3>::full([2, 2, 3], huge, &flex());
    let mut mistakes = Mistakes::default();
    for (name, parts, material) in [
        (
            "diffuse",
            ["at most 1", "1e30"],
            Material::diffuse([huge; 3]),
        ),
        (
            "shininess",
            ["[0, 1000000]", "1000000000000000000000000000000"],
            Material::phong([0.1; 3], [0.2; 3], huge),
        ),
        ("metallic", ["[0, 1]", "1000000"], metal(huge, 0.5)),
        ("roughness", ["[0, 1]", "1000000"], metal(0.5, huge)),
        (
            "eta",
            ["[0, 10000]", "1e30"],
            Material::conductor([huge; 3], [1.0; 3], 0.5),
        ),
        (
            "extinction",
            ["[0, 10000]", "1e30"],
            Material::conductor([1.0; 3], [huge; 3], 0.5),
        ),
        (
            "eta",
            ["[0, 10000]", "-1.0"],
            Material::conductor([-1.0; 3], [1.0; 3], 0.5),
        ),
        (
            "ior",
            ["[0.1, 10]", "1000000"],
            Material::dielectric(huge, 0.5),
        ),
        (
            "ior",
            ["[0.1, 10]", "0.01"],
            Material::dielectric(0.01, 0.5),
        ),
        ("emission", ["1e15", "1e30"], Material::emitter([huge; 3])),
        (
            "emission",
            ["1e15", "e30"],
            Material::emitter(row([1e30; 3])),
        ),
    ] {
        let [expected, found] = parts;
        mistakes.expect(
            &format!("{name} of {found}"),
            &["ball", name, expected, found],
            || see(ball().with_material(material.clone())),
        );
    }
    let lit_by = |light: Light| render(&lit(ball()).with_light(light), &camera(), &small());
    mistakes.expect(
        "intensity of 1e30",
        &["light 0", "intensity", "1e15"],
        || lit_by(Light::point([0.0, 3.0, 0.0], [huge; 3])),
    );
    mistakes.expect(
        "irradiance of -1e30",
        &["light 0", "irradiance", "1e15"],
        || lit_by(Light::directional([0.0, -1.0, 0.0], [-huge; 3])),
    );
    mistakes.expect("a sky of 1e30", &["environment", "1e15"], || {
        render(
            &lit(ball()).with_environment([huge; 3]),
            &camera(),
            &small(),
        )
    });
    mistakes.expect("a map of 1e30", &["environment", "(0, 0)", "1e15"], || {
        let map = Environment::map(texels());
        render(&lit(ball()).with_environment(map), &camera(), &small())
    });
    let painted = |value: f32, tracked: bool| {
        let corners = ball().mesh.faces.clone();
        let colors = Tensor::<2>::full([12, 3], value, &flex());
        let colors = match tracked {
            true => colors.autodiff().require_grad(),
            false => colors,
        };
        see(ball().map_mesh(|m| m.with_colors(colors, corners)))
    };
    mistakes.expect(
        "negative vertex colors",
        &["ball", "colors 0", "-0.1", "≥ 0"],
        || painted(-0.1, false),
    );
    // Those of a fit may wander.
    assert!(painted(-0.1, true).is_ok() && painted(0.0, false).is_ok());
}

/// What a lens, a camera, a motion or a texture coordinate may be is an error, or has an image and gradients that are
/// finite.
#[test]
fn what_is_huge_is_an_error_or_finite() {
    let huge = 1e30;
    let shown = |camera: Camera| render(&lit(ball()), &camera, &small());
    let far = |v: f64| [v, 0.0, 0.0];
    let uvs = |v: f32| {
        let texels = Tensor::<3>::full([2, 2, 3], 0.5, &flex());
        let mesh = |m: Mesh| m.with_uvs(Tensor::<2>::full([12, 2], v, &flex()));
        let of = Material::diffuse(ColorTexture::texture(texels));
        ball().map_mesh(mesh).with_material(of)
    };
    let normals = |v: f32| ball().map_mesh(|m| m.with_normals(Tensor::full([12, 3], v, &flex())));
    let mut wrong = Vec::new();
    for sign in [1.0, -1.0] {
        let v: f64 = sign * huge;
        let all: Vec<(&str, Result<Image>)> = vec![
            ("eye", shown(Camera::look_at(far(v), [0.0; 3]))),
            ("target", shown(Camera::look_at([0.0, 0.0, 4.0], far(v)))),
            ("up", shown(camera().with_up(far(v)))),
            ("lens", shown(camera().with_thin_lens(v, 4.0))),
            ("focus", shown(camera().with_thin_lens(0.1, v))),
            ("height", shown(camera().with_orthographic(v))),
            ("velocity", see(ball().with_velocity(far(v)))),
            ("uvs", see(uvs(v as f32))),
            ("normals", see(normals(v as f32))),
        ];
        for (name, found) in all {
            let finite = match found {
                Ok(image) => {
                    let sum = image.radiance.sum().into_data().iter::<f64>().next();
                    let sum = sum.unwrap_or(f64::NAN);
                    println!("{name} of {v:e}: {sum}");
                    sum.is_finite()
                }
                Err(error) => {
                    println!("{name} of {v:e}: {error}");
                    true
                }
            };
            if !finite {
                wrong.push(format!("{name} of {v:e}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}
