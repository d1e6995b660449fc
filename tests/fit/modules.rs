//! Parts of scenes as burn modules: what they hold, how far they go, a fit of a user's module.

use crate::common;
use crate::common::errors::{message, says};
use crate::common::materials::{base, metallic, model, roughness};
use crate::common::numbers::largest;
use crate::common::scenes::{ahead, floor};
use crate::common::tensors::{radiance, values};
use crate::parameters::parameters;
use burn::module::Module;
use burn::tensor::TensorData;
use softray::modules::RotationForm;
use softray::prelude::*;

fn autodiff() -> Device {
    Device::flex().autodiff()
}

#[track_caller]
fn near(found: &[f64], expected: &[f64]) {
    let near = |(a, b): (&f64, &f64)| (a - b).abs() < 2e-5 * (1.0 + b.abs());
    let close = found.len() == expected.len() && found.iter().zip(expected).all(near);
    assert!(close, "{found:?} {expected:?}");
}

/// What modules are made from comes out again.
#[test]
fn cameras_come_back() {
    let device = Device::flex();
    let camera = Camera::look_at([1.0, 2.0, 3.0], [0.0, 0.5, 0.0])
        .with_up([0.1, 1.0, 0.0])
        .with_fov_y(55.0)
        .with_thin_lens(0.05, 3.0);
    let back = CameraParams::from_camera(&camera, &device)
        .expect("a camera")
        .camera();
    near(&back.eye.values().expect("eye"), &[1.0, 2.0, 3.0]);
    near(&back.target.values().expect("target"), &[0.0, 0.5, 0.0]);
    near(&back.up.values().expect("up"), &[0.1, 1.0, 0.0]);
    near(&[common::fov(&back)], &[55.0]);
    let lens = back.lens.expect("a lens");
    near(&lens.aperture_radius.values().expect("aperture"), &[0.05]);
    near(&lens.focus_distance.values().expect("focus"), &[3.0]);
}

#[test]
fn materials_come_back() {
    let device = Device::flex();
    let material =
        Material::phong([0.6, 0.3, 0.1], [0.2, 0.1, 0.3], 25.0).with_emission([1.0, 2.0, 3.0]);
    let back = MaterialParams::from_material(&material, &device)
        .expect("a material")
        .material();
    let color = |albedo: &ColorTexture| match albedo {
        ColorTexture::Constant(p) => p.values().expect("values"),
        ColorTexture::Texture { .. } => panic!("a texture"),
    };
    let Bsdf::Phong {
        diffuse,
        specular,
        shininess,
    } = &back.bsdf
    else {
        panic!("{back:?}");
    };
    near(&color(diffuse), &[0.6, 0.3, 0.1]);
    near(&color(specular), &[0.2, 0.1, 0.3]);
    near(&shininess.values().expect("shininess"), &[25.0]);
    near(&color(&back.emission), &[1.0, 2.0, 3.0]);
    let plain = MaterialParams::from_material(&Material::diffuse([0.4; 3]), &device);
    assert_eq!(plain.expect("a material").num_params(), 6);

    let compensated = |m: &Material| match &m.bsdf {
        Bsdf::MetallicRoughness { compensated, .. }
        | Bsdf::Conductor { compensated, .. }
        | Bsdf::Dielectric { compensated, .. } => *compensated,
        other => panic!("{other:?}"),
    };
    let round = |m: Material| {
        let back = MaterialParams::from_material(&m, &device).expect("a material");
        assert_eq!(model(&back.material()), model(&m));
        assert_eq!(compensated(&back.material()), compensated(&m));
        back.material()
    };
    let number = |texture: &ScalarTexture| match texture {
        ScalarTexture::Constant(p) => p.values().expect("values"),
        ScalarTexture::Texture { .. } => panic!("a texture"),
    };
    let metal = Material::metallic_roughness([0.7, 0.5, 0.2], 0.8, 0.4);
    let metal = round(metal.with_compensated(false));
    near(&color(base(&metal)), &[0.7, 0.5, 0.2]);
    near(&number(metallic(&metal)), &[0.8]);
    near(&number(roughness(&metal)), &[0.4]);
    let gold = round(Material::conductor(
        [0.14, 0.37, 1.44],
        [3.98, 2.39, 1.6],
        0.3,
    ));
    let Bsdf::Conductor {
        eta, extinction, ..
    } = &gold.bsdf
    else {
        panic!("{gold:?}");
    };
    near(&eta.values().expect("eta"), &[0.14, 0.37, 1.44]);
    near(&extinction.values().expect("k"), &[3.98, 2.39, 1.6]);
    near(&number(roughness(&gold)), &[0.3]);
    let glass = round(Material::dielectric(1.5, 0.2).with_tint([0.9, 0.5, 0.2]));
    let Bsdf::Dielectric { tint, ior, .. } = &glass.bsdf else {
        panic!("{glass:?}");
    };
    near(&color(tint), &[0.9, 0.5, 0.2]);
    near(&number(ior), &[1.5]);
    near(&number(roughness(&glass)), &[0.2]);
}

#[test]
fn maps_come_back() {
    let device = Device::flex();
    let image = Tensor::<3>::from_data([[[0.1, 0.5, 0.9], [0.25, 0.75, 0.6]]], &device);
    let texture = TextureParams::from_image(&image, &device).expect("a texture");
    near(&values(&texture.texels()), &values(&image));
    let sky = EnvironmentParams::from_map(&(image.clone() * 20.0), &device).expect("a sky");
    near(&values(&sky.texels()), &values(&(image.clone() * 20.0)));
    let error = message(TextureParams::from_image(&(image * 20.0), &device));
    says(error, ["expected a number in [0, 1]"]);
    let normals = Tensor::<3>::from_data([[[0.6, 0.0, 0.8], [0.0, -0.6, 0.8]]], &device);
    let map = NormalMapParams::from_map(&normals, &device).expect("a map");
    near(&values(&map.texels()), &values(&normals));
}

/// A quarter turn about z, by every way to give it, in both forms.
#[test]
fn turns_come_back() {
    let device = Device::flex();
    let rows = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]];
    let quarter = 90.0;
    for form in [RotationForm::SixD, RotationForm::Quaternion] {
        let new = || {
            RigidTransformConfig::new()
                .with_rotation(form)
                .with_translation([0.0, 0.0, 5.0])
                .init(&device)
                .expect("a pose")
        };
        let poses = [
            new().with_axis_angle([0.0, 0.0, 3.0], quarter),
            new().with_euler([0.0, 0.0, quarter]),
            new().with_matrix(rows),
        ];
        for pose in poses {
            let pose = pose.expect("a pose");
            let point = Tensor::<2>::from_data([[1.0, 2.0, 3.0]], &device);
            near(&values(&pose.transform().apply(point)), &[-2.0, 1.0, 8.0]);
        }
    }
    // About x first, then about y: z goes to −y and stays there.
    let still = RigidTransformConfig::new().init(&device).expect("a pose");
    let turned = still
        .clone()
        .with_euler([quarter, quarter, 0.0])
        .expect("a pose");
    let z = Tensor::<2>::from_data([[0.0, 0.0, 1.0]], &device);
    near(&values(&turned.transform().apply(z)), &[0.0, -1.0, 0.0]);
    let mirror = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    assert!(still.with_matrix(mirror).is_err());
}

/// Offsets, constants and attributes go with the module: to another device, and into training.
#[test]
fn constants_go_with_the_module() {
    let plain = Device::flex();
    let ball = shapes::icosahedron(&plain);
    let normals = ball.vertices.clone();
    let uvs = normals.clone().narrow(1, 0, 2);
    let params = MeshOffsets::from_mesh(&ball.with_uvs(uvs).with_normals(normals), &plain);
    let params = params.expect("a mesh");
    assert!(!params.mesh().vertices.is_tracked());
    let training = params.train();
    assert!(training.mesh().vertices.is_tracked());
    let there = common::cpu_devices().pop().expect("one").autodiff();
    let mesh = training.fork(&there).mesh();
    let devices = [
        mesh.vertices.device(),
        mesh.uvs.expect("uvs").values.device(),
        mesh.normals.expect("normals").values.device(),
    ];
    assert!(devices.iter().all(|d| *d == there), "{devices:?}");
    let fine = MeshParams::from_mesh(&shapes::icosphere(3, &plain), &plain);
    let debug = format!("{:?}", fine.expect("a mesh"));
    assert!(debug.contains("[642, 3]") && debug.len() < 4000, "{debug}");
}

/// One of each, and what renders them: a user's module.
#[derive(Module, Debug)]
struct World {
    mesh: MeshParams,
    pose: RigidTransform,
    camera: CameraParams,
    texture: TextureParams,
    surface: MaterialParams,
    renderer: Renderer,
    loss: RenderLoss,
}

fn world(device: &Device) -> World {
    let camera = CameraParamsConfig::new([0.5, 1.0, 5.0], [0.0, 0.0, 0.0])
        .with_lens(Some([0.1, 4.0]))
        .init(device);
    let surface = MaterialParamsConfig::new()
        .with_specular(Some([0.2; 3]))
        .with_emission(Some([0.3; 3]))
        .init(device);
    let mesh = MeshParams::from_mesh(&shapes::icosahedron(device), device);
    let pose = RigidTransformConfig::new()
        .with_scale(Some(1.0))
        .init(device);
    let texture = TextureParamsConfig::new(2, 2).init(device);
    let renderer = Renderer::new(RenderOptions::new(12, 12).with_samples(4).with_bounces(0));
    World {
        mesh: mesh.expect("a mesh"),
        pose: pose.expect("a pose"),
        camera: camera.expect("a camera").freeze_lens(),
        texture: texture.expect("a texture"),
        surface: surface.expect("a material"),
        renderer: renderer.expect("a renderer"),
        loss: RenderLossConfig::new().with_l1(0.1).init().expect("a loss"),
    }
}

impl World {
    fn scene(&self) -> Scene {
        let ball = self.pose.forward(self.mesh.mesh());
        let texture = Material::diffuse(self.texture.texture(Wrap::Clamp));
        let floor = Object::new(floor(2.0, -1.2, &Device::flex())).with_material(texture);
        let ball = Object::new(ball).with_material(self.surface.material());
        Scene::new()
            .with_object(ball)
            .with_object(floor)
            .with_environment([0.8, 0.9, 1.0])
    }

    fn forward(&self, target: &Tensor<3>, seed: u64) -> softray::Result<Tensor<1>> {
        let [a, b] = self
            .renderer
            .forward_pair(&self.scene(), &self.camera.camera(), seed)?;
        self.loss
            .forward_unbiased(a.radiance, b.radiance, target.clone())
    }
}

/// What burn-train 0.22's `LearnerModel` asks of a module beside its steps, and what its
/// `TrainOutput::new` does with a loss.
fn learns<M: Module + std::fmt::Display + 'static>(module: &M, loss: Tensor<1>) -> bool {
    let gradients = burn::optim::GradientsParams::from_grads(loss.backward(), module);
    !module.to_string().is_empty() && !gradients.is_empty()
}

#[cfg(feature = "fit")]
#[test]
fn an_optimizer_moves_all_but_the_frozen() {
    use softray::optim::{Evaluation, Fit};

    let start = world(&autodiff());
    let target = Tensor::<3>::zeros([12, 12, 3], &Device::flex());
    let loss = start.forward(&target, 0).expect("a loss");
    assert!(learns(&start, loss));
    let adam = burn::optim::AdamConfig::new().init();
    let fitted = Fit::new(start.clone(), adam, 2)
        .with_rate(0.01)
        .run(|world: &World, step: &_| {
            let loss = world.forward(&target, step.seed(0))?;
            Ok(Evaluation::new(loss))
        })
        .expect("a fit");
    let after = parameters(&fitted.module, None);
    let mut frozen = Vec::new();
    for (a, b) in parameters(&start, None).iter().zip(&after) {
        assert_eq!(a.trained, b.trained, "{}", a.name);
        assert_eq!(a.values != b.values, a.trained, "{}", a.name);
        if !a.trained {
            frozen.push(a.name.clone());
        }
    }
    let expected = [
        "camera.up",
        "camera.lens.log_aperture",
        "camera.lens.log_focus",
    ];
    assert_eq!(frozen, expected);
    // Frozen ones don't get a gradient by being loaded, nor lose it in training and back.
    let again = start.clone().valid().train();
    let trained = |m: &World| -> Vec<bool> {
        let all = parameters(m, None).into_iter();
        all.map(|p| p.trained).collect()
    };
    assert_eq!(trained(&again), trained(&start));
}

/// However far a step leads, what the parameters mean is a scene that renders.
#[test]
fn large_steps_stay_in_range() {
    let device = autodiff();
    for sign in [1.0, -1.0] {
        // One step of Adam is the rate long in every component; signs differ between neighbors.
        let mut optimizer = burn::optim::AdamConfig::new().init();
        let sky = EnvironmentParamsConfig::new(2, 4).init(&device);
        let sky = sky.expect("a sky");
        let mut moved = (
            world(&device).camera.unfreeze(),
            world(&device).surface,
            world(&device).texture,
            sky,
            world(&device).pose,
        );
        for _ in 0..2 {
            let loss = alternating(&moved) * sign;
            let gradients = burn::optim::GradientsParams::from_grads(loss.backward(), &moved);
            moved = optimizer.step(400.0, moved, gradients);
        }
        let all = parameters(&moved, None);
        let far = largest(all.iter().flat_map(|p| p.values.clone()));
        assert!(far > 700.0, "{far}");
        let (camera, surface, texture, sky, pose) = &moved;
        let camera = camera.camera();
        let fov = common::fov(&camera);
        assert!((1.0..=170.0).contains(&fov), "{fov}");
        let lens = camera.lens.clone().expect("a lens");
        let material = surface.material();
        let ColorTexture::Constant(emission) = &material.emission else {
            panic!("a texture");
        };
        let Bsdf::Phong {
            diffuse: ColorTexture::Constant(diffuse),
            specular: ColorTexture::Constant(specular),
            shininess,
        } = &material.bsdf
        else {
            panic!("{material:?}");
        };
        let (d, s) = (
            diffuse.values().expect("k_d"),
            specular.values().expect("k_s"),
        );
        for (d, s) in d.into_iter().zip(s) {
            assert!(d >= 0.0 && s >= 0.0 && d + s <= 1.0 + 1e-6, "{d} {s}");
        }
        let one = |p: &Parameter<1>| p.values().expect("values").to_vec();
        let emission = emission.values().expect("values").to_vec();
        for v in [
            one(&lens.aperture_radius),
            one(&lens.focus_distance),
            one(shininess),
            emission,
            values(&sky.texels()),
        ]
        .concat()
        {
            assert!(v > 0.0 && v.is_finite(), "{v}");
        }
        let texels = values(&texture.texels());
        assert!(texels.iter().all(|t| (0.0..=1.0).contains(t)));
        let ball = pose.forward(shapes::icosahedron(&Device::flex()));
        assert!(values(&ball.vertices).iter().all(|v| v.is_finite()));
        let wall = shapes::icosphere(1, &Device::flex());
        let scene = Scene::new().with_object(Object::new(wall).with_material(material));
        let scene = scene.with_environment(sky.environment());
        let options = RenderOptions::new(4, 4).with_samples(1).with_bounces(0);
        let image = radiance(&scene, &ahead(), &options);
        assert!(image.iter().all(|v| v.is_finite()));
    }
}

/// Σ ±parameter over all components, with alternating signs.
fn alternating<M: Module>(module: &M) -> Tensor<1> {
    use burn::module::{ModuleVisitor, Param};
    struct Sum(Tensor<1>);
    impl ModuleVisitor for Sum {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let tensor = param.val();
            let count: usize = tensor.dims().iter().product();
            let signs: Vec<f64> = (0..count).map(|i| [1.0, -1.0][i % 2]).collect();
            let signs = Tensor::<1>::from_data(TensorData::new(signs, [count]), &tensor.device());
            self.0 = self.0.clone() + (tensor.reshape([count]) * signs).sum();
        }
    }
    let mut sum = Sum(Tensor::zeros([1], &autodiff()));
    module.visit(&mut sum);
    sum.0
}
