//! Mistakes of somebody who uses this crate for the first time: each is an error whose message says
//! what is wrong, where, and what to do. `--nocapture` prints them all.

mod ranges;

use crate::common::mistakes::{Mistakes, ball, camera, flex, lit, row, see, small};
use softray::Result;
use softray::gradcheck::{Checked, GradCheck, gradcheck};
use softray::prelude::*;

fn with(options: RenderOptions) -> Result<Image> {
    render(&lit(ball()), &camera(), &options)
}

fn by(camera: Camera) -> Result<Image> {
    render(&lit(ball()), &camera, &small())
}

#[test]
fn devices() {
    let named = |name| softray::device::named(Some(name));
    let mut mistakes = Mistakes::default();
    mistakes.expect("device gpu", &["\"gpu\"", "flex", "wgpu"], || named("gpu"));
    mistakes.expect("device tpu", &["\"tpu\"", "wgpu"], || named("tpu"));
    #[cfg(not(feature = "cuda"))]
    mistakes.expect("device cuda, not built in", &["--features cuda"], || {
        named("cuda:1")
    });
    mistakes.expect("device cpu", &["\"cpu\"", "flex"], || named("cpu"));
    #[cfg(not(feature = "wgpu"))]
    mistakes.expect("device wgpu, not built in", &["--features wgpu"], || {
        named("wgpu")
    });
}

#[cfg(feature = "ndarray")]
#[test]
fn devices_that_differ() {
    let mut mistakes = Mistakes::default();
    #[allow(deprecated)] // burn deprecates ndarray
    let there = Device::ndarray();
    mistakes.expect(
        "objects on two devices",
        &["moon", "vertices", "ndarray", "flex", "to_device"],
        || {
            let moon = Object::new(shapes::cube(&there)).with_name("moon");
            render(&lit(ball()).with_object(moon), &camera(), &small())
        },
    );
    mistakes.expect(
        "albedo on another device, in a graph",
        &["ball", "diffuse", "ndarray", "flex", "to_device"],
        || {
            let albedo = Tensor::<1>::zeros([3], &there).autodiff().require_grad();
            see(ball().with_material(Material::diffuse(albedo)))
        },
    );
    mistakes.expect(
        "camera on another device",
        &["camera", "eye", "ndarray"],
        || by(Camera::look_at(Tensor::<1>::ones([3], &there), [0.0; 3])),
    );
    mistakes.expect(
        "environment on another device",
        &["environment", "ndarray"],
        || {
            let map = Tensor::<3>::ones([2, 4, 3], &there);
            let scene = Scene::new()
                .with_object(ball())
                .with_environment(Environment::map(map));
            render(&scene, &camera(), &small())
        },
    );
}

#[test]
fn float_types_that_differ() {
    use burn::tensor::DType;
    let mut mistakes = Mistakes::default();
    mistakes.expect(
        "an f64 albedo",
        &["ball", "diffuse", "F64", "F32", "cast"],
        || {
            let albedo = row([0.5; 3]).cast(DType::F64);
            see(ball().with_material(Material::diffuse(albedo)))
        },
    );
}

#[test]
#[expect(clippy::too_many_lines, reason = "a list of mistakes")]
fn scenes() {
    let mut mistakes = Mistakes::default();
    mistakes.expect("no objects", &["no objects", "Scene::with_object"], || {
        render(
            &Scene::new().with_environment([1.0; 3]),
            &camera(),
            &small(),
        )
    });
    mistakes.expect("no faces", &["scene", "no faces"], || {
        let points = Mesh::new(shapes::cube(&flex()).vertices, Vec::new());
        see(Object::new(points).with_name("cloud"))
    });
    let mesh = |vertices: Tensor<2>| Mesh::new(vertices, vec![[0, 1, 2]]);
    mistakes.expect("vertices [3, 2]", &["object", "[3, 2]", "[_, 3]"], || {
        see(Object::new(mesh(Tensor::zeros([3, 2], &flex()))))
    });
    mistakes.expect(
        "too few vertices",
        &["face 0", "[0, 1, 2]", "under 2"],
        || see(Object::new(mesh(Tensor::zeros([2, 3], &flex())))),
    );
    mistakes.expect("a vertex is NaN", &["vertices 0", "NaN", "finite"], || {
        see(Object::new(mesh(Tensor::full([3, 3], f32::NAN, &flex()))))
    });
    mistakes.expect("faces from 1", &["face 0", "[1, 2, 3]", "under 3"], || {
        let faces = vec![[1, 2, 3]];
        see(Object::new(Mesh::new(Tensor::ones([3, 3], &flex()), faces)))
    });
    let texture = || {
        Material::diffuse(ColorTexture::texture(
            Tensor::ones([2, 2, 3], &flex()) * 0.5,
        ))
    };
    mistakes.expect(
        "a texture without coordinates",
        &["ball", "diffuse", "texture", "with_uvs"],
        || see(ball().with_material(texture())),
    );
    mistakes.expect("too few coordinates", &["ball", "uvs", "under 5"], || {
        let uvs = Tensor::zeros([5, 2], &flex());
        see(ball()
            .map_mesh(|m| m.with_uvs(uvs))
            .with_material(texture()))
    });
    mistakes.expect("normals [12, 2]", &["normals", "[12, 2]", "[_, 3]"], || {
        see(ball().map_mesh(|m| m.with_normals(Tensor::ones([12, 2], &flex()))))
    });
    mistakes.expect(
        "an RGBA texture",
        &["diffuse", "[2, 2, 4]", "[H, W, 3]"],
        || {
            let rgba = Tensor::ones([2, 2, 4], &flex());
            see(ball().with_material(Material::diffuse(ColorTexture::texture(rgba))))
        },
    );
    mistakes.expect("an RGBA color", &["diffuse", "[4]", "[3]"], || {
        see(ball().with_material(Material::diffuse(row([0.5; 4]))))
    });
    mistakes.expect(
        "bytes for an albedo",
        &["diffuse is", "200", "at most 1"],
        || see(ball().with_material(Material::diffuse([200.0, 100.0, 50.0]))),
    );
    mistakes.expect("a negative albedo", &["diffuse", "-0.5", "≥ 0"], || {
        see(ball().with_material(Material::diffuse([-0.5, 0.5, 0.5])))
    });
    mistakes.expect("a negative exponent", &["shininess", "-1", "≥ 0"], || {
        see(ball().with_material(Material::phong([0.1; 3], [0.5; 3], -1.0)))
    });
    mistakes.expect("emission NaN", &["emission", "NaN", "finite"], || {
        see(ball().with_material(Material::emitter([f64::NAN, 1.0, 1.0])))
    });
    mistakes.expect(
        "a velocity of two numbers",
        &["velocity", "[2]", "[3]"],
        || see(ball().with_velocity(row([1.0, 2.0]))),
    );
    mistakes.expect(
        "materials of faces",
        &["face_materials", "3", "20 faces"],
        || {
            let mut object = ball();
            object.face_materials = vec![0; 3].into();
            see(object)
        },
    );
    mistakes.expect(
        "a material that is not there",
        &["face 0", "7", "1"],
        || {
            let mut object = ball();
            object.face_materials = vec![7; 20].into();
            see(object)
        },
    );
    mistakes.expect(
        "an environment [H, W, 4]",
        &["environment", "[2, 4, 4]"],
        || {
            let map = Environment::map(Tensor::ones([2, 4, 4], &flex()));
            render(&lit(ball()).with_environment(map), &camera(), &small())
        },
    );
}

#[test]
#[expect(clippy::too_many_lines, reason = "a list of mistakes")]
fn names_and_transforms() {
    let mut mistakes = Mistakes::default();
    mistakes.expect(
        "map_object of a wrong name",
        &["map_object", "\"bal\"", "\"ball\""],
        || {
            let scene = lit(ball()).map_object("bal", |o| o.with_velocity([1.0, 0.0, 0.0]))?;
            render(&scene, &camera(), &small())
        },
    );
    mistakes.expect(
        "map_object of no object",
        &["map_object", "none to choose from"],
        || {
            let scene = Scene::new().map_object("ball", |o| o)?.with_object(ball());
            render(&scene.with_environment([1.0; 3]), &camera(), &small())
        },
    );
    mistakes.expect(
        "a parameter of gradcheck",
        &["\"ofset\"", "\"offset\""],
        || {
            let settings = GradCheck::new(small(), &flex()).with_seeds(2, 2);
            gradcheck(&[Checked::new("offset", [0.0; 3], 0.1)], &settings, |p| {
                Ok((lit(ball().with_velocity(p.get("ofset")?)), camera()))
            })
        },
    );
    mistakes.expect(
        "gradcheck of two of one name",
        &["two parameters", "\"offset\""],
        || {
            let offset = || Checked::new("offset", [0.0; 3], 0.1);
            let settings = GradCheck::new(small(), &flex()).with_seeds(2, 2);
            gradcheck(&[offset(), offset()], &settings, |_| {
                Ok((lit(ball()), camera()))
            })
        },
    );
    mistakes.expect(
        "gradcheck of no parameters",
        &["parameters", "empty"],
        || {
            let settings = GradCheck::new(small(), &flex()).with_seeds(2, 2);
            gradcheck(&[], &settings, |_| Ok((lit(ball()), camera())))
        },
    );
    mistakes.expect(
        "gradcheck of nothing",
        &["only", "\"ofset\"", "\"offset\""],
        || {
            let settings = GradCheck::new(small(), &flex())
                .with_seeds(2, 2)
                .with_parameters(&["ofset"]);
            gradcheck(&[Checked::new("offset", [0.0; 3], 0.1)], &settings, |p| {
                let mesh = shapes::icosahedron(&p.device).cast(p.dtype);
                let object = Object::new(mesh.translated(p.get("offset")?));
                Ok((lit(object), camera()))
            })
        },
    );
    mistakes.expect(
        "translated by [2]",
        &["ball", "translated", "[2]", "[3]"],
        || see(ball().map_mesh(|m| m.translated(row([1.0, 2.0])))),
    );
    mistakes.expect("scaled by [2]", &["ball", "scaled", "[2]", "[3]"], || {
        see(ball().map_mesh(|m| m.scaled(row([1.0, 2.0]))))
    });
    let transformed = |t: Transform| see(ball().map_mesh(|m| m.transformed(&t)));
    mistakes.expect(
        "a transform's translation",
        &["translation", "[2]", "[3]"],
        || transformed(Transform::new().with_translation(row([1.0, 2.0]))),
    );
    mistakes.expect(
        "a transform's scale",
        &["scale", "[2]", "[1] or [3]"],
        || transformed(Transform::new().with_scale(row([1.0, 2.0]))),
    );
    mistakes.expect(
        "a quaternion of three",
        &["quaternion", "[3]", "[4]"],
        || transformed(Transform::new().with_quaternion(row([1.0, 0.0, 0.0]))),
    );
    mistakes.expect("six_d of four", &["six_d", "[4]", "[6]"], || {
        transformed(Transform::new().with_six_d(row([1.0, 0.0, 0.0, 0.0])))
    });
    mistakes.expect("an angle of two numbers", &["angle", "[2]", "[1]"], || {
        transformed(Transform::new().with_axis_angle([0.0, 1.0, 0.0], row([1.0, 0.0])))
    });
    mistakes.expect(
        "an axis of 0",
        &["axis", "[0.0, 0.0, 0.0]", "direction"],
        || transformed(Transform::new().with_axis_angle([0.0; 3], row([1.0]))),
    );
    mistakes.expect("a quaternion of 0", &["ball", "NaN"], || {
        transformed(Transform::new().with_quaternion(row([0.0; 4])))
    });
}

#[test]
fn cameras() {
    let mut mistakes = Mistakes::default();
    mistakes.expect("eye is target", &["target", "other than the eye"], || {
        by(Camera::look_at([0.0; 3], [0.0; 3]))
    });
    mistakes.expect("up along the view", &["up", "along the view"], || {
        by(Camera::look_at([0.0, 4.0, 0.0], [0.0; 3]))
    });
    mistakes.expect("up is 0", &["up", "[0, 0, 0]", "along the view"], || {
        by(camera().with_up([0.0; 3]))
    });
    for fov in [0.0, 180.0, -3.0, f64::NAN] {
        mistakes.expect("field of view", &["fov_y", "degrees in (0, 180)"], || {
            by(camera().with_fov_y(fov))
        });
    }
    mistakes.expect("eye is NaN", &["eye", "NaN", "finite"], || {
        by(Camera::look_at([f64::NAN, 0.0, 0.0], [0.0; 3]))
    });
    mistakes.expect("eye of two numbers", &["eye", "[2]", "[3]"], || {
        by(Camera::look_at(row([0.0, 4.0]), [0.0; 3]))
    });
    mistakes.expect("a negative aperture", &["aperture", "-1", "≥ 0"], || {
        by(camera().with_thin_lens(-1.0, 4.0))
    });
    mistakes.expect("a focus at 0", &["focus distance", "0", "> 0"], || {
        by(camera().with_thin_lens(0.1, 0.0))
    });
}

#[test]
fn options() {
    let mut mistakes = Mistakes::default();
    mistakes.expect("no columns", &["width", "0", "at least 1"], || {
        with(RenderOptions::new(0, 4))
    });
    mistakes.expect("no samples", &["samples", "0", "at least 1"], || {
        with(small().with_samples(0))
    });
    mistakes.expect("negative blur", &["blur", "-0.1", "[0, 68)"], || {
        with(small().with_blur(-0.1))
    });
    mistakes.expect("a blur of 90", &["blur", "90", "degrees"], || {
        with(small().with_blur(90.0))
    });
    mistakes.expect("a wide cone", &["blur angle", "70", "degrees"], || {
        with(small().with_visibility(Visibility::cone(70.0)))
    });
    mistakes.expect("blur of 0 for the softmax", &["sigma", "0", "> 0"], || {
        with(small().with_visibility(Visibility::softmax(0.0, 1e-3)))
    });
    mistakes.expect("blur, softmax", &["blur", "SoftmaxOptions::sigma"], || {
        with(
            small()
                .with_visibility(Visibility::softmax(1e-4, 1e-3))
                .with_blur(5.73),
        )
    });
    mistakes.expect(
        "kernels for the softmax",
        &["engine", "Kernels", "softmax"],
        || {
            with(
                small()
                    .with_visibility(Visibility::softmax(1e-4, 1e-3))
                    .with_engine(Engine::Kernels),
            )
        },
    );
    for limit in [0.0, f64::INFINITY, f64::NAN] {
        mistakes.expect("a clamp of none", &["indirect_clamp", "1e-30"], || {
            with(small().with_indirect_clamp(limit))
        });
    }
    mistakes.expect("a pass too many", &["pass", "4 of 4", "less than"], || {
        with(small().with_samples(8).with_pass(4, 4))
    });
    mistakes.expect("uneven passes", &["samples", "8", "3 passes"], || {
        with(small().with_samples(8).with_pass(0, 3))
    });
    mistakes.expect("adaptive passes", &["pass", "adaptive"], || {
        with(small().with_samples(64).with_adaptive().with_pass(0, 2))
    });
    mistakes.expect("too large", &["60000 × 60000", "memory_limit"], || {
        with(RenderOptions::new(60_000, 60_000))
    });
    mistakes.expect(
        "a pixel that is not there",
        &["pixel", "16", "under 16"],
        || render_pixels(&lit(ball()), &camera(), &small(), &[3, 16]),
    );
    mistakes.expect("no pixels", &["pixels", "empty", "at least one"], || {
        render_pixels(&lit(ball()), &camera(), &small(), &[])
    });
    mistakes.expect("a cutoff of 1", &["cutoff", "1", "(0, 0.5)"], || {
        with(small().with_visibility(SoftmaxOptions::new(1e-4, 1e-3).with_cutoff(1.0)))
    });
}
