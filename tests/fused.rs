//! Fused kernels against the tensor form, their specification: images, other outputs and gradients.

mod common;

use burn::tensor::{DType, Device, Tensor};
use common::stress::{Outcome, Thing, World, cases};
use common::values;
use softray::prelude::*;

/// Σ|a − b|/Σ|b|; what is 0 but for rounding is compared with 1e-6.
fn apart(a: &[f64], b: &[f64]) -> f64 {
    let scale: f64 = b.iter().map(|v| v.abs()).sum();
    let difference: f64 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
    difference / scale.max(1e-6)
}

/// What is furthest apart, and how far.
fn furthest(world: &World, dtype: DType) -> (String, f64) {
    let [fused, tensors]: [Outcome; 2] = [true, false].map(|fused| {
        let world = World {
            options: world.options.clone().fused(fused),
            ..world.clone()
        };
        world.run(&Device::flex(), dtype).expect("an image")
    });
    let mut found = ("image".to_string(), apart(&fused.image, &tensors.image));
    for (name, gradient) in &fused.gradients {
        let far = apart(gradient, tensors.gradient(name));
        if far.is_nan() || far > found.1 {
            found = (name.clone(), far);
        }
    }
    found
}

/// Where rounding decides: surfaces at one depth are ordered by it, and a point on a face that emits
/// lies before or behind that face.
const DECIDED_BY_ROUNDING: [&str; 2] = ["light: in the floor", "light: a ball of light"];

/// Worlds with every kind of parameter, and those at the edge of what floats hold.
#[test]
fn worlds_in_f64() {
    let device = Device::flex();
    let moving = World::new().with(|w| {
        w.thing("ball").velocity = Some([0.4, 0.2, 0.1]);
        w.thing("light").velocity = Some([-0.2, 0.0, 0.3]);
        w.lens = Some((0.1, 4.0));
    });
    let textured = World::new().with(|w| {
        let uvs = vec![[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]];
        let texels = (0..12).map(|i| 0.1 + 0.05 * f64::from(i)).collect();
        w.thing("floor").texture = Some(([2, 2], texels, uvs));
        w.thing("floor").velocity = Some([0.1, 0.0, 0.2]);
    });
    let fine = World::new().with(|w| {
        *w.thing("ball") =
            Thing::shape("ball", shapes::icosphere(3, &device), [0.4, 0.7, 0.0], 0.6);
        w.options = w.options.clone().russian_roulette(1).bounces(4);
    });
    let own = [("moving", moving), ("textured", textured), ("fine", fine)];
    let own = own.map(|(name, world)| (name.to_string(), world));
    let step = if common::long() { 1 } else { 5 };
    let mut far = Vec::new();
    let decided = |name: &str| DECIDED_BY_ROUNDING.iter().any(|d| name.starts_with(d));
    for (name, world) in own.into_iter().chain(cases().into_iter().step_by(step)) {
        if decided(&name) {
            continue;
        }
        let (what, by) = furthest(&world, DType::F64);
        if by.is_nan() || by > 1e-6 {
            far.push(format!("{name}: {what}, {by:e}"));
        }
    }
    assert!(far.is_empty(), "{} of them\n{}", far.len(), far.join("\n"));
}

/// Normals, texture coordinates and texels in the graph, and all outputs.
#[test]
fn attributes_and_outputs() {
    for form in [
        Visibility::Layered,
        Visibility::softmax(1e-2),
        Visibility::LayeredSoft { gamma: 0.02 },
    ] {
        let [a, b] = [true, false].map(|fused| attributes(fused, form));
        for (name, x, y) in a.iter().zip(&b).map(|(a, b)| (a.0, &a.1, &b.1)) {
            let far = apart(x, y);
            println!("{name}: {far:e}");
            assert!(y.iter().any(|&v| v != 0.0), "{name} is 0");
            assert!(far < 1e-8, "{form:?}, {name}: {far:e}");
        }
    }
}

fn attributes(fused: bool, form: Visibility) -> Vec<(&'static str, Vec<f64>)> {
    let device = Device::flex();
    let leaf = |t: Tensor<2>| t.cast(DType::F64).autodiff().require_grad();
    let ball = shapes::icosphere(1, &device);
    let vertices = leaf(ball.vertices.clone());
    // Bent, so that they are not those of a sphere.
    let bent = Tensor::<2>::from_floats([[1.0, 0.7, 1.2]], &device).cast(DType::F64);
    let normals = leaf(vertices.clone().inner() * bent);
    let uvs = leaf(
        vertices
            .clone()
            .inner()
            .slice([0..vertices.dims()[0], 0..2])
            * 0.7
            + 0.3,
    );
    let texels: Vec<f64> = (0..4 * 5 * 3)
        .map(|i| 0.1 + 0.4 * f64::from(i * 7 % 11) / 11.0)
        .collect();
    let texels = Tensor::<1>::from_data(texels.as_slice(), (&device, DType::F64))
        .reshape([4, 5, 3])
        .autodiff()
        .require_grad();
    let mesh = ball
        .with_vertices(vertices.clone())
        .with_normals(normals.clone())
        .with_uvs(uvs.clone());
    let material = Material::diffuse(Albedo::texture(texels.clone())).specular(
        Albedo::texture(texels.clone() * 0.5),
        Tensor::<1>::from_floats([9.0], &device).cast(DType::F64),
    );
    let quad = |c: [[f64; 3]; 4]| shapes::quad(c[0], c[1], c[2], c[3], &device).cast(DType::F64);
    let floor = quad([
        [-3.0, -1.0, 3.0],
        [3.0, -1.0, 3.0],
        [3.0, -1.0, -3.0],
        [-3.0, -1.0, -3.0],
    ]);
    let light = quad([
        [-1.0, 2.5, -1.0],
        [1.0, 2.5, -1.0],
        [1.0, 2.5, 1.0],
        [-1.0, 2.5, 1.0],
    ]);
    let scene = Scene::new()
        .with(Object::new(mesh).material(material))
        .with(Object::new(floor).material(Material::diffuse([0.4; 3])))
        .with(Object::new(light).material(Material::emitter([5.0; 3])))
        .environment([0.2; 3]);
    let camera = Camera::look_at([0.3, 0.5, 5.0], [0.0; 3]).fov_y(42.0);
    let options = RenderOptions::new(10, 9)
        .samples(4)
        .bounces(2)
        .sigma(3e-3)
        .visibility(form)
        .with_opacity()
        .with_depth()
        .with_normals()
        .with_object_ids()
        .fused(fused);
    let image = render(&scene, &camera, &options).expect("an image");
    let opacity = image.opacity.expect("opacity");
    let depth = image.depth.expect("depth");
    let facing = image.normals.expect("normals");
    let ids = image.object_ids.expect("ids");
    let ids = ids
        .into_data()
        .iter::<i64>()
        .map(|v| v as f64 + 2.0)
        .collect();
    let mut found = vec![
        ("radiance", values(&image.radiance)),
        ("opacity", values(&opacity)),
        ("depth", values(&depth)),
        ("normals", values(&facing)),
        ("object ids", ids),
    ];
    let weighted = |t: Tensor<1>| {
        let n = t.dims()[0];
        let rising: Vec<f64> = (0..n).map(|i| 0.3 + i as f64 / n as f64).collect();
        (t * Tensor::<1>::from_data(rising.as_slice(), (&device, DType::F64))).sum()
    };
    let flat = |t: Tensor<2>| t.reshape([90]);
    let loss = weighted(image.radiance.reshape([270]))
        + weighted(flat(opacity)) * 0.5
        + weighted(flat(depth)) * 0.2
        + weighted(facing.reshape([270])) * 0.7;
    let gradients = loss.backward();
    let of = |t: &Tensor<2>| values(&t.grad(&gradients).expect("a gradient"));
    found.extend([
        ("by vertices", of(&vertices)),
        ("by normals", of(&normals)),
        ("by uvs", of(&uvs)),
        (
            "by texels",
            values(&texels.grad(&gradients).expect("a gradient")),
        ),
    ]);
    found
}

/// A map, gathered at surfaces and looked up where paths miss; its texels, the geometry and the camera
/// in the graph.
#[test]
fn environment_maps() {
    for sampling in [Sampling::default(), Sampling::plain()] {
        for form in [Visibility::Layered, Visibility::softmax(1e-2)] {
            let [a, b] = [true, false].map(|fused| under_a_map(fused, form, sampling));
            for (name, x, y) in a.iter().zip(&b).map(|(a, b)| (a.0, &a.1, &b.1)) {
                let far = apart(x, y);
                println!("{name}: {far:e}");
                assert!(y.iter().any(|&v| v != 0.0), "{name} is 0");
                assert!(far < 1e-8, "{sampling:?}, {form:?}, {name}: {far:e}");
            }
        }
    }
}

fn under_a_map(fused: bool, form: Visibility, sampling: Sampling) -> Vec<(&'static str, Vec<f64>)> {
    let device = Device::flex();
    let texels: Vec<f64> = (0..4 * 8 * 3)
        .map(|i| 0.1 + 2.0 * f64::from(i * 5 % 17) / 17.0)
        .collect();
    let texels = Tensor::<1>::from_data(texels.as_slice(), (&device, DType::F64))
        .reshape([4, 8, 3])
        .autodiff()
        .require_grad();
    let ball = shapes::icosphere(1, &device).cast(DType::F64);
    let vertices = ball.vertices.clone().autodiff().require_grad();
    let eye = Tensor::<1>::from_data([0.3, 0.5, 5.0].as_slice(), (&device, DType::F64));
    let eye = eye.autodiff().require_grad();
    let ten = Tensor::<1>::from_floats([10.0], &device).cast(DType::F64);
    let floor = shapes::quad(
        [-3.0, -1.0, 3.0],
        [3.0, -1.0, 3.0],
        [3.0, -1.0, -3.0],
        [-3.0, -1.0, -3.0],
        &device,
    );
    let gloss = Material::diffuse([0.3, 0.4, 0.5]).specular([0.3; 3], ten);
    let scene = Scene::new()
        .with(Object::new(ball.with_vertices(vertices.clone())).material(gloss))
        .with(Object::new(floor.cast(DType::F64)).material(Material::diffuse([0.4; 3])))
        .environment(Environment::map(texels.clone()));
    let camera = Camera::look_at(eye.clone(), [0.0; 3]).fov_y(42.0);
    let options = RenderOptions::new(10, 9)
        .samples(4)
        .bounces(2)
        .sigma(3e-3)
        .visibility(form)
        .sampling(sampling)
        .fused(fused);
    let image = render(&scene, &camera, &options)
        .expect("an image")
        .radiance;
    let radiance = values(&image);
    let gradients = image.powf_scalar(2.0).sum().backward();
    vec![
        ("radiance", radiance),
        (
            "by texels",
            values(&texels.grad(&gradients).expect("a gradient")),
        ),
        (
            "by vertices",
            values(&vertices.grad(&gradients).expect("a gradient")),
        ),
        ("by eye", values(&eye.grad(&gradients).expect("a gradient"))),
    ]
}

/// A lens that is there and not used: the gradient has a place for it.
#[test]
fn a_closed_aperture() {
    let device = Device::flex();
    let eye = Tensor::<1>::from_floats([0.3, 0.5, 5.0], &device)
        .autodiff()
        .require_grad();
    let scene = Scene::new()
        .with(Object::new(shapes::icosphere(1, &device)))
        .environment([1.0, 0.5, 0.2]);
    let camera = Camera::look_at(eye.clone(), [0.0; 3]);
    let of = |camera: &Camera| {
        let options = RenderOptions::new(8, 8).samples(4).bounces(1).sigma(1e-3);
        let image = render(&scene, camera, &options).expect("an image").radiance;
        let gradients = image.powf_scalar(2.0).sum().backward();
        values(&eye.grad(&gradients).expect("a gradient"))
    };
    let pinhole = of(&camera);
    assert!(pinhole.iter().any(|&g| g != 0.0));
    assert_eq!(pinhole, of(&camera.clone().thin_lens(0.0, 3.0)));
}

/// Sides of closed objects that can't be seen are not asked for: from inside of a closed room, from
/// outside of it, by the light of a closed ring, whose other side counts too, and all of it by a batch
/// whose views see different sides.
#[test]
fn closed_objects_from_inside_and_outside() {
    let device = Device::flex();
    let mesh = |mesh: Mesh, factor: f64, shift: [f64; 3]| {
        let shift = Tensor::<1>::from_data(shift.as_slice(), (&device, DType::F64));
        let vertices = mesh.vertices.clone().cast(DType::F64) * factor;
        let vertices = (vertices + shift.reshape([1, 3])).autodiff().require_grad();
        (mesh.with_vertices(vertices.clone()), vertices)
    };
    let inside = Camera::look_at([0.3, 0.5, 1.7], [0.0; 3]).fov_y(70.0);
    let outside = Camera::look_at([0.6, 1.1, 7.0], [0.0; 3]).fov_y(60.0);
    let run = |cameras: &[&Camera], fused: bool| {
        let (room, of_room) = mesh(shapes::cube(&device), 4.0, [0.0; 3]);
        let (ball, of_ball) = mesh(shapes::icosphere(2, &device), 0.7, [0.2, -0.6, -0.3]);
        let ring = shapes::torus(0.8, 0.3, 8, 5, &device);
        let (lamp, of_lamp) = mesh(ring, 1.0, [-0.4, 1.3, 0.2]);
        let scene = Scene::new()
            .with(Object::new(room).material(Material::diffuse([0.6, 0.5, 0.4])))
            .with(Object::new(ball).material(Material::diffuse([0.3, 0.5, 0.6])))
            .with(Object::new(lamp).material(Material::emitter([9.0, 8.0, 7.0])))
            .environment([0.3; 3]);
        let options = RenderOptions::new(10, 9)
            .samples(4)
            .bounces(2)
            .sigma(3e-3)
            .fused(fused);
        let cameras: Vec<Camera> = cameras.iter().map(|&c| c.clone()).collect();
        let batch = Batch::new(vec![scene], cameras).expect("a batch");
        let image = render_batch(&batch, &options).expect("images").radiance;
        let radiance = values(&image);
        let gradients = image.powf_scalar(2.0).sum().backward();
        let of = |t: &Tensor<2>| values(&t.grad(&gradients).expect("a gradient"));
        [radiance, of(&of_room), of(&of_ball), of(&of_lamp)]
    };
    for cameras in [
        &[&inside][..],
        &[&outside],
        &[&inside, &outside],
        &[&outside, &inside],
    ] {
        let [a, b] = [true, false].map(|fused| run(cameras, fused));
        for (name, (x, y)) in ["image", "room", "ball", "lamp"]
            .iter()
            .zip(a.iter().zip(&b))
        {
            let far = apart(x, y);
            println!("{} views, {name}: {far:e}", cameras.len());
            // From outside only the room is seen.
            let seen = cameras.iter().any(|c| std::ptr::eq(*c, &inside));
            let any = y.iter().any(|&v| v != 0.0);
            assert_eq!(any, seen || ["image", "room"].contains(name), "{name}");
            assert!(far < 1e-8, "{} views, {name}: {far:e}", cameras.len());
        }
    }
}
