//! Scenes that leak or shadow themselves where the ends of rays are not treated right: against
//! closed forms and against the same scene without blur.

use crate::common::numbers::mean;
use crate::common::scenes::{diffuse, emitting, facing_down, facing_up, inward, on_axis};
use crate::common::tensors::{gradient, radiance};
use burn::tensor::Device;
use softray::prelude::*;

/// Without an angle, and with more and more of it, in degrees.
const ANGLES: [f64; 3] = [0.0, 0.6, 3.0];

/// What a point of a floor sees of a parallel square light of half width h above it: the closed
/// form of the configuration factor, four corners added up.
fn square_above(h: f64, height: f64) -> f64 {
    let r = (h / height) / (1.0 + (h / height).powi(2)).sqrt();
    4.0 / std::f64::consts::TAU * (2.0 * r * r.atan())
}

#[test]
fn both_triangles_of_a_light_shine_and_both_of_an_occluder_block() {
    let device = Device::flex();
    let floor = facing_up([-6.0, 6.0], [-6.0, 6.0], 0.0, &device);
    let light = facing_down([-1.0, 1.0], [-1.0, 1.0], 2.0, &device);
    let open = Scene::new()
        .with_object(Object::new(floor))
        .with_object(emitting(light, [1.0; 3]));
    // Far larger than the light, so that the whole shadow of a point below is umbra.
    let roof = facing_up([-3.0, 3.0], [-3.0, 3.0], 1.0, &device);
    let roofed = open.clone().with_object(Object::new(roof));
    // From below the roof, at the point under the middle of the light.
    let camera = Camera::look_at([0.3, 0.8, 0.4], [0.0; 3]).with_fov_y(2.0);
    let expected = 0.5 * square_above(1.0, 2.0);
    for angle in ANGLES {
        let options = RenderOptions::new(8, 8)
            .with_samples(256)
            .with_bounces(0)
            .with_blur(angle);
        let lit = mean(&radiance(&open, &camera, &options));
        assert!(
            (lit / expected - 1.0).abs() < 0.015,
            "{angle}: {lit}, expected {expected}"
        );
        let dark = mean(&radiance(&roofed, &camera, &options));
        assert_eq!(dark, 0.0, "{angle}, under the roof");
    }
}

/// A wall between a room with a lamp and one without, from floor to ceiling: no light comes through.
#[test]
fn a_thin_wall_keeps_the_dark() {
    let device = Device::flex();
    let room = inward(shapes::cube(&device)).scaled(Tensor::from_floats([2.0], &device));
    let lamp = facing_down([-1.3, -0.7], [-0.3, 0.3], 1.9, &device);
    let sheet = shapes::quad(
        [0.0, -2.0, 2.0],
        [0.0, -2.0, -2.0],
        [0.0, 2.0, -2.0],
        [0.0, 2.0, 2.0],
        &device,
    );
    // A wall 0.05 thick, as wide and as high as the room.
    let slab = {
        let cube = shapes::cube(&device);
        let size = Tensor::<2>::from_floats([[0.025, 2.0, 2.0]], &device);
        let vertices = cube.vertices.clone() * size;
        cube.with_vertices(vertices)
    };
    for wall in [sheet, slab] {
        let scene = Scene::new()
            .with_object(diffuse(room.clone(), [0.7; 3]))
            .with_object(diffuse(wall, [0.7; 3]))
            .with_object(emitting(lamp.clone(), [5.0; 3]));
        let camera = |x: f64| Camera::look_at([x, 0.0, 1.5], [x, -0.5, -1.0]).with_fov_y(60.0);
        for angle in ANGLES {
            let options = RenderOptions::new(12, 12)
                .with_samples(64)
                .with_bounces(3)
                .with_blur(angle);
            let lit = mean(&radiance(&scene, &camera(-1.0), &options));
            let dark = mean(&radiance(&scene, &camera(1.0), &options));
            println!("{angle}: {lit} and {dark}");
            assert!(lit > 0.03);
            // Where the wall touches the room rounding decides.
            assert!(dark < 2e-4 * lit, "{angle}: {dark} beside {lit}");
        }
    }
}

/// Objects that stand on a floor, a concave closed mesh and an open sheet: with the blur as
/// without.
#[test]
fn standing_objects_neither_leak_nor_shadow_themselves() {
    let device = Device::flex();
    let floor = facing_up([-4.0, 4.0], [-4.0, 4.0], 0.0, &device);
    let offset = |v: [f64; 3]| Tensor::<1>::from_floats(v.map(|x| x as f32), &device);
    let gray = |m: Mesh| diffuse(m, [0.6; 3]);
    let bowl = {
        // The lower half of a sphere's faces: open, and concave from inside.
        let ball = shapes::icosphere(2, &device);
        let vertices = ball.host_vertices().expect("vertices");
        let low = |f: &&[u32; 3]| f.iter().all(|&i| vertices[i as usize][1] < 0.3);
        let faces = ball.faces.iter().filter(low).copied().collect();
        Mesh::new(ball.vertices.clone(), faces)
    };
    let cases = [
        (
            "cube",
            shapes::cube(&device)
                .scaled(Tensor::from_floats([0.5], &device))
                .translated(offset([0.0, 0.5, 0.0])),
        ),
        (
            "torus",
            shapes::torus(1.0, 0.4, 16, 10, &device).translated(offset([0.0, 0.4, 0.0])),
        ),
        ("bowl", bowl.translated(offset([0.0, 1.0, 0.0]))),
        (
            "screen",
            shapes::quad(
                [-1.0, 0.0, 0.2],
                [1.0, 0.0, 0.2],
                [1.0, 1.2, -0.4],
                [-1.0, 1.2, -0.4],
                &device,
            ),
        ),
    ];
    for (name, mesh) in cases {
        let light = facing_down([-1.5, -0.5], [0.5, 1.5], 3.0, &device);
        let scene = Scene::new()
            .with_object(gray(floor.clone()))
            .with_object(gray(mesh))
            .with_object(emitting(light, [9.0; 3]));
        let camera = Camera::look_at([0.4, 2.5, 4.0], [0.0, 0.4, 0.0]).with_fov_y(45.0);
        let at = |angle| {
            let options = RenderOptions::new(24, 24)
                .with_samples(64)
                .with_bounces(1)
                .with_blur(angle);
            radiance(&scene, &camera, &options)
        };
        let sharp = at(0.0);
        for (angle, tolerance) in [(0.6, 0.01), (2.9, 0.03)] {
            let soft = at(angle);
            let ratio = mean(&soft) / mean(&sharp);
            println!("{name}, {angle}: {ratio}");
            assert!((ratio - 1.0).abs() < tolerance, "{name}, {angle}: {ratio}");
        }
    }
}

/// A white and a black sheet pass through each other; moving one in depth moves the line where they cross,
/// and the gradient is that of the line's movement, in closed form.
#[test]
fn the_crossing_of_surfaces_moves() {
    let device = Device::flex();
    let sheet = |tilt: f64| {
        shapes::quad(
            [-4.0, -4.0, -4.0 * tilt],
            [4.0, -4.0, 4.0 * tilt],
            [4.0, 4.0, 4.0 * tilt],
            [-4.0, 4.0, -4.0 * tilt],
            &device,
        )
    };
    let camera = on_axis(10.0).with_fov_y(12.0);
    let options = RenderOptions::new(32, 32).with_samples(64).with_bounces(0);
    let depth = Tensor::<1>::zeros([1], &device).autodiff().require_grad();
    let axis = Tensor::<1>::from_floats([0.0, 0.0, 1.0], &device);
    let white = sheet(0.5).translated(depth.clone() * axis);
    let scene = Scene::new()
        .with_object(emitting(white, [1.0; 3]))
        .with_object(diffuse(sheet(-0.5), [0.0; 3]));
    let image = render(&scene, &camera, &options).expect("an image");
    let gradients = image.radiance.mean().backward();
    let found = gradient(&depth, &gradients)[0];
    // The planes z = ±x/2 (+ d) cross at x = −d; the image is 2·10·tan 6° wide.
    let width = 20.0 * 6f64.to_radians().tan();
    assert!((found * width - 1.0).abs() < 0.01, "{found}, width {width}");
}
