//! Gradients of modules' parameters through renders, against central differences.

use crate::common::scenes::{ahead, diffuse, emitting, facing_front, glowing};
use crate::common::tensors::{tensor, values};
use crate::parameters::{changed, parameters};
use burn::module::Module;
use burn::tensor::DType;
use softray::modules::{AimForm, RotationForm, cast};
use softray::prelude::*;

fn autodiff() -> Device {
    Device::flex().autodiff()
}

/// The softmax without anything that a parameter could change the probability of, so that differences
/// of one render are what its gradient has to be.
fn still() -> RenderOptions {
    let half = 4.0 / 3f64.sqrt();
    let softmax = SoftmaxOptions::new(1e-2, 0.1)
        .with_cutoff(1e-9)
        .with_bounds(Bounds {
            min: [-half; 3],
            max: [half; 3],
        });
    RenderOptions::new(10, 8)
        .with_samples(2)
        .with_bounces(0)
        .with_sampling(Sampling::paper())
        .with_visibility(softmax)
}

/// The mean radiance under weights that rise over the image, so that no symmetry cancels.
fn seen(scene: &Scene, camera: &Camera) -> Tensor<1> {
    let radiance = render(scene, camera, &still()).expect("a render").radiance;
    let dims = radiance.dims();
    let weights: Vec<f64> = (0..dims.iter().product())
        .map(|i| 0.5 + (i as f64 * 0.37).sin().abs() + i as f64 / 240.0)
        .collect();
    let weights = tensor(&weights, dims, &Device::flex(), radiance.dtype());
    (radiance * weights).mean()
}

/// Every trained parameter has a gradient that is finite and not 0, and those of the named components
/// are central differences. In f64, so that rounding leaves them enough digits.
fn check<M: Module>(module: M, components: &[(&str, usize)], objective: impl Fn(&M) -> Tensor<1>) {
    let module = cast(module, DType::F64);
    let found = parameters(&module, Some(&objective(&module).backward()));
    for p in found.iter().filter(|p| p.trained) {
        let gradient = p.gradient.as_ref().expect("a gradient");
        assert!(gradient.iter().all(|g| g.is_finite()), "{}", p.name);
        assert!(gradient.iter().any(|&g| g != 0.0), "{}", p.name);
    }
    for &(name, component) in components {
        let p = found.iter().find(|p| p.name == name).expect("a parameter");
        let gradient = p.gradient.as_ref().expect("a gradient")[component];
        let h = 2e-5;
        let at = |h: f64| {
            let step = |n: &str, i| if (n, i) == (name, component) { h } else { 0.0 };
            let moved = changed(module.clone(), |n, i, v| v + step(n, i));
            values(&objective(&moved))[0]
        };
        let difference = (at(h) - at(-h)) / (2.0 * h);
        let off = (gradient - difference).abs() / difference.abs();
        assert!(off < 1e-4, "{name}[{component}]: {gradient} {difference}");
    }
}

/// All tensors of a scene need one float type.
fn f64_mesh(mesh: Mesh) -> Mesh {
    mesh.cast(DType::F64)
}

#[test]
fn gradients_of_meshes_and_transforms() {
    let ball = shapes::icosahedron(&autodiff());
    let see = |mesh: Mesh| seen(&glowing(mesh), &ahead());
    let params = MeshParams::from_mesh(&ball, &autodiff()).expect("a mesh");
    check(params, &[("vertices", 7)], |m| see(m.mesh()));
    let params = MeshOffsets::from_mesh(&ball, &autodiff()).expect("a mesh");
    check(params, &[("offsets", 4)], |m| see(m.mesh()));
    let cube = || f64_mesh(shapes::cube(&Device::flex()));
    for form in [RotationForm::SixD, RotationForm::Quaternion] {
        let pose = RigidTransformConfig::new()
            .with_rotation(form)
            .with_scale(Some(0.8))
            .init(&autodiff())
            .and_then(|p| p.with_axis_angle([1.0, 2.0, 0.5], 40.0))
            .expect("a pose");
        let components = [("rotation", 1), ("translation", 0), ("log_scale", 0)];
        check(pose, &components, |p| see(p.forward(cube())));
    }
}

#[test]
fn gradients_of_cameras() {
    let scene = glowing(f64_mesh(shapes::cube(&Device::flex())));
    for form in [AimForm::Target, AimForm::Direction] {
        let params = CameraParamsConfig::new([1.0, 1.5, 6.0], [0.1, 0.0, 0.0])
            .with_lens(Some([0.1, 4.0]))
            .with_aim(form)
            .init(&autodiff())
            .expect("a camera")
            .train_up();
        let aim = match form {
            AimForm::Target => "aim.Target",
            AimForm::Direction => "aim.Direction",
        };
        let components = [
            ("eye", 0),
            (aim, 1),
            ("up", 0),
            ("logit_fov", 0),
            ("lens.log_aperture", 0),
            ("lens.log_focus", 0),
        ];
        check(params, &components, |p| seen(&scene, &p.camera()));
    }
}

#[test]
fn gradients_of_textures_environments_and_materials() {
    let device = autodiff();
    let wall = || f64_mesh(facing_front([-1.0, 1.0], [-1.0, 1.0], 0.0, &Device::flex()));
    let lit = |material: Material| {
        let [a, b, c, d] = [
            [-1.0, 1.5, 2.0],
            [1.0, 1.5, 2.0],
            [1.0, 2.5, 1.0],
            [-1.0, 2.5, 1.0],
        ];
        let light = f64_mesh(shapes::quad(d, c, b, a, &Device::flex()));
        let light = emitting(light, [8.0, 7.0, 6.0]);
        Scene::new()
            .with_object(Object::new(wall()).with_material(material))
            .with_object(light)
    };
    let texture = TextureParamsConfig::new(2, 3).init(&device);
    let texture = texture.expect("a texture");
    check(texture, &[("logit_texels", 4)], |t| {
        seen(&lit(Material::diffuse(t.texture(Wrap::Clamp))), &ahead())
    });
    let material = MaterialParamsConfig::new()
        .with_diffuse([0.5, 0.4, 0.3])
        .with_specular(Some([0.2, 0.3, 0.1]))
        .with_emission(Some([0.1, 0.2, 0.3]))
        .init(&device)
        .expect("a material");
    let components = [
        ("logit_shares", 1),
        ("log_shininess", 0),
        ("log_emission", 2),
    ];
    check(material, &components, |m| {
        seen(&lit(m.material()), &ahead())
    });
    let sky = EnvironmentParamsConfig::new(4, 8).with_radiance([0.7; 3]);
    let sky = sky.init(&device).expect("a sky");
    // A texel that the camera sees: the third row, the middle column.
    check(sky, &[("log_radiance", (8 + 4) * 3)], |sky| {
        let black = Scene::new().with_object(diffuse(wall(), [0.0; 3]));
        seen(&black.with_environment(sky.environment()), &ahead())
    });
}
