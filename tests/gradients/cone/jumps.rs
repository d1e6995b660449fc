//! Scenes in which the light that is seen jumps, and a part of which is moved and turned.

use burn::tensor::Tensor;
use softray::gradcheck::Point;
use softray::prelude::*;

use crate::common::gradients::floor_and_light;
use crate::common::scenes::{diffuse, emitting, facing_front};
use crate::common::tensors::tensor;

/// A scene, and where its derivative is large beside its noise, so that few seeds tell whether it is right.
pub struct Jump {
    pub scene: &'static str,
    pub angle: f64,
    /// Of x, y and a turn; None where noise hides all.
    pub direction: Option<[f64; 3]>,
}

const fn jump(scene: &'static str, angle: f64, direction: [f64; 3]) -> Jump {
    Jump {
        scene,
        angle,
        direction: Some(direction),
    }
}

/// Jumps at the lines in which surfaces cross, at seams of materials, between facets of a gloss, under a
/// map, in a mirror, behind a lens, at a wall.
pub const SCENES: [Jump; 11] = [
    jump("cross", 0.0, [-1.0, 1.0, -1.0]),
    jump("self", 2.865, [-1.0, 1.0, 0.0]),
    jump("gloss", 0.0, [-1.0, 0.0, 0.0]),
    jump("map", 2.865, [-1.0, 1.0, 0.0]),
    jump("mapgloss", 0.0, [0.0, 0.0, 1.0]),
    jump("seam", 2.865, [-1.0, 1.0, -1.0]),
    jump("lensmove", 0.0, [-1.0, 0.0, 0.0]),
    jump("smooth", 2.865, [-1.0, 1.0, 0.0]),
    // The edge of the lamp lies on the wall, where its light grows without bound: the noise of 4,000 seeds is three times
    // the derivative.
    Jump {
        scene: "wall",
        angle: 2.865,
        direction: None,
    },
    jump("crossmove", 2.865, [-1.0, 1.0, -1.0]),
    jump("mirror", 2.865, [0.0, 1.0, 0.0]),
];

/// A scene by its name, from the parameter `place`: x, y and a turn.
pub fn scene(name: &str, point: &Point) -> softray::Result<(Scene, Camera)> {
    let (d, dtype) = (&point.device, point.dtype);
    let place = point.get("place")?;
    let [x, y, turn] = [0, 1, 2].map(|i| place.clone().slice([i..i + 1]));
    let turn = Transform::new().with_axis_angle([0.3, 1.0, 0.2], turn * 1f64.to_degrees());
    let offset = Tensor::cat(vec![x.clone(), y.clone() + 0.7, x.clone() * 0.3], 0);
    let placed = |mesh: Mesh| mesh.transformed(&turn).translated(offset.clone());

    let sphere = || shapes::icosphere(1, d).cast(dtype);
    let scaled = |mesh: Mesh| placed(mesh.scaled(tensor(&[0.5], [1], d, dtype)));
    let ball = || Object::new(scaled(sphere()));
    let gloss = Material::phong([0.2, 0.3, 0.4], [0.5; 3], 30.0);
    let quad = || placed(facing_front([-0.6, 0.6], [-0.5, 0.5], 0.0, d).cast(dtype));
    let red = || diffuse(quad(), [0.8, 0.2, 0.2]);
    let green = || diffuse(slope(d).cast(dtype), [0.2, 0.8, 0.2]);

    let [floor, light] = floor_and_light(d).map(|mesh| mesh.cast(dtype));
    let ground = match name {
        "mirror" => Material::phong([0.1; 3], [0.8; 3], 200.0),
        _ => Material::default(),
    };
    let open = Scene::new().with_object(Object::new(floor).with_material(ground));
    let room = open.clone().with_object(emitting(light, [3.0; 3]));
    let scene = match name {
        "cross" => room.with_object(red()).with_object(green()),
        "crossmove" => room
            .with_object(red().with_velocity([0.3, 0.1, 0.0]))
            .with_object(green()),
        "self" => room.with_object(ball()).with_object(green()),
        "gloss" => room.with_object(ball().with_material(gloss)),
        "mirror" => room.with_object(ball().with_material(Material::diffuse([0.2, 0.3, 0.4]))),
        "map" => open.with_object(ball()).with_environment(map(point)),
        "mapgloss" => open
            .with_object(ball().with_material(gloss))
            .with_environment(map(point)),
        "seam" => room.with_object(seam(quad(), point)),
        "lensmove" => room.with_object(ball().with_velocity([0.4, 0.2, 0.1])),
        "smooth" => {
            let normals = sphere().vertices;
            room.with_object(Object::new(scaled(sphere().with_normals(normals))))
        }
        "wall" => {
            let wall = facing_front([-2.0, 2.0], [0.0, 2.5], -0.9, d).cast(dtype);
            let lamp = beside_the_wall(d).cast(dtype);
            let lamp = lamp.translated(Tensor::cat(vec![x, y.clone(), y * 0.0], 0));
            open.with_object(Object::new(wall))
                .with_object(emitting(lamp, [5.0; 3]))
        }
        other => panic!("there is no scene {other:?}"),
    };
    let camera = Camera::look_at([0.2, 1.3, 4.2], [0.0, 0.6, 0.0]).with_fov_y(30.0);
    let camera = match name {
        "lensmove" => camera.with_thin_lens(0.2, 3.0),
        _ => camera,
    };
    Ok((scene, camera))
}

/// A rectangle that the moved one passes through.
fn slope(device: &Device) -> Mesh {
    let (right, left) = ([0.1, 0.1], [-0.3, 1.3]);
    let at = |[x, y]: [f64; 2], z: f64| [x, y, z];
    shapes::quad(
        at(right, -0.6),
        at(right, 0.6),
        at(left, 0.6),
        at(left, -0.6),
        device,
    )
}

/// A lamp that touches the wall and faces up.
fn beside_the_wall(device: &Device) -> Mesh {
    let at = |x: f64, z: f64| [x, 0.8, z];
    shapes::quad(
        at(0.2, -0.9),
        at(0.2, -0.4),
        at(0.8, -0.4),
        at(0.8, -0.9),
        device,
    )
}

/// A map with a sun of one texel.
fn map(point: &Point) -> Environment {
    let sun = |i: usize| if i / 3 == 35 { 30.0 } else { 0.0 };
    let texel = |i: usize| 0.3 + ((i * 37) % 11) as f64 * 0.1 + sun(i);
    let texels: Vec<f64> = (0..8 * 16 * 3).map(texel).collect();
    Environment::map(tensor(&texels, [8, 16, 3], &point.device, point.dtype))
}

/// A rectangle of a texture in one of its triangles and a color in the other.
fn seam(quad: Mesh, point: &Point) -> Object {
    let texels = [0.8, 0.1, 0.1, 0.1, 0.8, 0.1, 0.1, 0.1, 0.8, 0.7, 0.7, 0.2];
    let texels = tensor(&texels, [2, 2, 3], &point.device, point.dtype);
    let mut object =
        Object::new(quad).with_material(Material::diffuse(ColorTexture::texture(texels)));
    object.materials.push(Material::diffuse([0.1, 0.6, 0.9]));
    object.face_materials = vec![0, 1].into();
    object
}
