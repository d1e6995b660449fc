//! The Cornell box.

use burn::tensor::Device;

use super::{Camera, Material, Mesh, Object, Scene};

/// A quad, one corner after another, which faces the side from which these run counter-clockwise.
type Quad = [[f64; 3]; 4];

const WHITE: [f64; 3] = [0.725, 0.71, 0.68];
const RED: [f64; 3] = [0.63, 0.065, 0.05];
const GREEN: [f64; 3] = [0.14, 0.45, 0.091];
/// The radiance of the lamp.
const LAMP: [f64; 3] = [17.0, 12.0, 4.0];

const WALLS: [(&str, Quad, [f64; 3]); 5] = [
    (
        "floor",
        [
            [5.528, 0.0, 0.0],
            [0.0, 0.0, 0.0],
            [0.0, 0.0, 5.592],
            [5.496, 0.0, 5.592],
        ],
        WHITE,
    ),
    (
        "ceiling",
        [
            [5.56, 5.488, 0.0],
            [5.56, 5.488, 5.592],
            [0.0, 5.488, 5.592],
            [0.0, 5.488, 0.0],
        ],
        WHITE,
    ),
    (
        "back",
        [
            [5.496, 0.0, 5.592],
            [0.0, 0.0, 5.592],
            [0.0, 5.488, 5.592],
            [5.56, 5.488, 5.592],
        ],
        WHITE,
    ),
    (
        "right",
        [
            [0.0, 0.0, 5.592],
            [0.0, 0.0, 0.0],
            [0.0, 5.488, 0.0],
            [0.0, 5.488, 5.592],
        ],
        GREEN,
    ),
    (
        "left",
        [
            [5.528, 0.0, 0.0],
            [5.496, 0.0, 5.592],
            [5.56, 5.488, 5.592],
            [5.56, 5.488, 0.0],
        ],
        RED,
    ),
];
const LIGHT: Quad = [
    [3.43, 5.487, 2.27],
    [3.43, 5.487, 3.32],
    [2.13, 5.487, 3.32],
    [2.13, 5.487, 2.27],
];
/// The blocks: the corners (x, z) of the top, and its height.
#[allow(clippy::approx_constant)] // a coordinate of 3.14
const BLOCKS: [(&str, [[f64; 2]; 4], f64); 2] = [
    (
        "short",
        [[1.3, 0.65], [0.82, 2.25], [2.4, 2.72], [2.9, 1.14]],
        1.65,
    ),
    (
        "tall",
        [[4.23, 2.47], [2.65, 2.96], [3.14, 4.56], [4.72, 4.06]],
        3.3,
    ),
];

/// Creates the Cornell box with the camera that looks into it.
///
/// The scene is the one that Cornell University measured, in units of 10 cm: five walls (`floor`, `ceiling`, `back`, a
/// red one to the `left` and a green one to the `right`), two blocks (`short`, `tall`) and a lamp (`light`) at the
/// ceiling. The box is open towards the camera, and about 5.5 wide, high and deep.
///
/// ```
/// use softray::prelude::*;
/// let (room, camera) = softray::scene::cornell_box(&Device::flex());
/// let image = render(&room, &camera, &RenderOptions::new(16, 16).with_samples(4))?;
/// assert!(image.radiance.mean().into_scalar::<f32>() > 0.1);
/// # Ok::<(), softray::Error>(())
/// ```
pub fn cornell_box(device: &Device) -> (Scene, Camera) {
    let quads = |quads: &[Quad]| {
        let vertices: Vec<[f64; 3]> = quads.iter().flatten().copied().collect();
        let corners = (0..quads.len() as u32).map(|quad| 4 * quad);
        let faces = corners.flat_map(|a| [[a, a + 1, a + 2], [a, a + 2, a + 3]]);
        Mesh::from_host(&vertices, faces.collect(), device)
    };
    let mut scene = Scene::new();
    for (name, quad, albedo) in WALLS {
        let material = Material::diffuse(albedo);
        scene = scene.with_object(
            Object::new(quads(&[quad]))
                .with_name(name)
                .with_material(material),
        );
    }
    for (name, corners, height) in BLOCKS {
        let material = Material::diffuse(WHITE);
        let block = Object::new(block(corners, height, device));
        scene = scene.with_object(block.with_name(name).with_material(material));
    }
    let lamp = Material::diffuse([0.78; 3]).with_emission(LAMP);
    let scene = scene.with_object(
        Object::new(quads(&[LIGHT]))
            .with_name("light")
            .with_material(lamp),
    );
    let camera = Camera::look_at([2.78, 2.73, -8.0], [2.78, 2.73, 0.0]).with_fov_y(39.3077);
    (scene, camera)
}

/// A block without a bottom. Its sides share their vertices.
fn block(corners: [[f64; 2]; 4], height: f64, device: &Device) -> Mesh {
    let at = |y: f64| corners.map(|[x, z]| [x, y, z]);
    let vertices = [at(height), at(0.0)].concat();
    let side = |k: u32| {
        let next = (k + 1) % 4;
        [[k, k + 4, next + 4], [k, next + 4, next]]
    };
    let mut faces = vec![[0, 1, 2], [0, 2, 3]];
    faces.extend((0..4).flat_map(side));
    Mesh::from_host(&vertices, faces, device)
}
