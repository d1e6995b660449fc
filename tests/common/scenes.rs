//! Rectangles, and the scenes of the reference data.

use burn::tensor::Device;
use softray::prelude::*;

/// A rectangle in the plane of a height y that faces up.
pub fn facing_up(x: [f64; 2], z: [f64; 2], y: f64, device: &Device) -> Mesh {
    let [a, b, c, d] = corners(x, z, y);
    shapes::quad(a, b, c, d, device)
}

/// A rectangle in the plane of a height y that faces down.
pub fn facing_down(x: [f64; 2], z: [f64; 2], y: f64, device: &Device) -> Mesh {
    let [a, b, c, d] = corners(x, z, y);
    shapes::quad(d, c, b, a, device)
}

fn corners([x0, x1]: [f64; 2], [z0, z1]: [f64; 2], y: f64) -> [[f64; 3]; 4] {
    [[x0, y, z1], [x1, y, z1], [x1, y, z0], [x0, y, z0]]
}

/// A rectangle in the plane of a z that faces +z.
pub fn facing_front([x0, x1]: [f64; 2], [y0, y1]: [f64; 2], z: f64, device: &Device) -> Mesh {
    shapes::quad([x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z], device)
}

/// A square about the y axis at a height that faces up, by half its width.
pub fn floor(half: f64, y: f64, device: &Device) -> Mesh {
    facing_up([-half, half], [-half, half], y, device)
}

/// A square about the y axis at a height that faces down and emits, by half its width.
pub fn lamp(half: f64, y: f64, radiance: [f64; 3], device: &Device) -> Object {
    emitting(
        facing_down([-half, half], [-half, half], y, device),
        radiance,
    )
}

/// An emitter.
pub fn emitting(mesh: Mesh, radiance: [f64; 3]) -> Object {
    Object::new(mesh).with_material(Material::emitter(radiance))
}

/// An object of a diffuse material.
pub fn diffuse(mesh: Mesh, albedo: [f64; 3]) -> Object {
    Object::new(mesh).with_material(Material::diffuse(albedo))
}

/// One mesh of the default material under a white sky.
pub fn under_sky(mesh: Mesh) -> Scene {
    Scene::new()
        .with_object(Object::new(mesh))
        .with_environment([1.0; 3])
}

/// A mesh with its faces wound the other way: a room.
pub fn inward(mesh: Mesh) -> Mesh {
    let faces = mesh.faces.iter().map(|f| [f[0], f[2], f[1]]).collect();
    Mesh::new(mesh.vertices, faces)
}

/// A camera on the z axis that looks at the origin.
pub fn on_axis(z: f64) -> Camera {
    Camera::look_at([0.0, 0.0, z], [0.0; 3])
}

/// A mesh that emits under a blue sky.
pub fn glowing(mesh: Mesh) -> Scene {
    let scene = Scene::new().with_object(emitting(mesh, [0.9, 0.5, 0.2]));
    scene.with_environment([0.1, 0.2, 0.4])
}

/// A camera that looks at the origin from the front, from a little to the right and above.
pub fn ahead() -> Camera {
    Camera::look_at([0.3, 0.5, 6.0], [0.0; 3])
}

/// The scene of a folder of the reference data.
#[track_caller]
pub fn scene_file(name: &str, device: &Device) -> SceneFile {
    let path = super::reference(&format!("{name}/scene.json"));
    SceneFile::load(path, device).expect("a scene")
}
