//! Warnings of likely mistakes in scenes, cameras and options. They read nothing back from a device.

use glam::DVec3;

use super::batch::Batch;
use super::options::RenderOptions;
use crate::model::camera::HostCamera;
use crate::scene::{
    Bounds, HostLight, HostObject, HostScene, LightKind, Parameter, Projection, Scene,
    warn_of_radians,
};
use crate::tensors::Visibility;
use crate::warnings::warning;

/// A vertical field of view in degrees, below which an angle is likely meant in radians: it is a half turn in radians.
const NARROW: f64 = 3.2;

/// The number of bounces of a path through a body of glass.
const THROUGH_GLASS: u32 = 2;

/// The largest number of emitting faces of an object whose direction is checked.
const MAX_FACES: usize = 64;

/// The sum of a surface's face normals over its area, from which on it is open. It is 0 for a closed surface.
const OPEN: f64 = 1e-3;

/// Warns of settings that are likely mistakes. Only constants are checked.
pub(super) fn warn_of_settings(batch: &Batch, options: &RenderOptions) {
    if let Visibility::Cone { angle, .. } = options.form() {
        warn_of_radians("options: the angle of cones", &Parameter::Constant([angle]));
    }
    let narrow = batch.views.iter().enumerate().find_map(|(index, view)| {
        let Projection::Perspective { fov_y } = &view.1.projection else {
            return None;
        };
        let Parameter::Constant([degrees]) = *fov_y else {
            return None;
        };
        (degrees < NARROW).then_some((index, degrees))
    });
    if let Some((index, degrees)) = narrow {
        warning!(
            "the camera of view {index} has a vertical field of view of {degrees}°: it is in degrees, and \
             {degrees} radians are {:.1}°",
            degrees.to_degrees()
        );
    }
    let bounces = options.bounces;
    if bounces < THROUGH_GLASS && batch.scenes.iter().any(Scene::refracts) {
        warning!(
            "the scene has glass, but paths end after {bounces} bounces: light passes through a body of glass \
             with {THROUGH_GLASS} bounces or more (RenderOptions::with_bounces)"
        );
    }
}

/// Warns of scenes that are likely mistakes, and of cameras that see nothing of them. Each view has the index of a scene.
pub(super) fn warn_of_views(
    batch: &Batch,
    hosts: &[HostScene],
    cameras: &[HostCamera],
    options: &RenderOptions,
) {
    let views: Vec<(usize, &HostCamera)> = batch.views.iter().map(|v| v.0).zip(cameras).collect();
    for (s, host) in hosts.iter().enumerate().filter(|(_, host)| host.has_area()) {
        let boxes: Vec<Option<Bounds>> = host.objects.iter().map(|o| o.bounds()).collect();
        let of_scene = |view: &&(usize, &HostCamera)| view.0 == s;
        let cameras: Vec<&HostCamera> = views.iter().filter(of_scene).map(|v| v.1).collect();
        let name = |object: usize| &batch.scenes[s].objects[object].name;
        if let Some(object) = (0..boxes.len()).find(|&o| shines_away(host, o, &boxes, &cameras)) {
            warning!(
                "the light {} faces away from all objects and cameras: emitters shine from the front of their faces \
                 alone, from where the corners are counter-clockwise",
                name(object)
            );
        }
        if let Some(object) = open_glass(host) {
            warning!(
                "{} is of glass but not closed: the inside of glass is behind its front faces, and light that enters an \
                 open surface does not leave it again",
                name(object)
            );
        }
        let boxes: Vec<Bounds> = boxes.into_iter().flatten().collect();
        if let Some(light) = host.lights.iter().position(|l| misses(l, &boxes)) {
            warning!("light {light} is a spot light whose cone contains nothing of the scene");
        }
        let unseen = views.iter().position(|&(scene, camera)| {
            let aspect = options.width as f64 / options.height as f64;
            scene == s && !camera.may_see(&boxes, aspect, beyond(camera, options))
        });
        if let (Some(view), Some(all)) = (unseen, boxes.into_iter().reduce(|a, b| a.union(&b))) {
            let [eye, target] = views[view].1.line_of_sight();
            warning!(
                "nothing of the scene is in view {view}: the camera at {eye} looks at {target}, and all objects lie \
                 between {:?} and {:?} (Camera::framing has all of them in view)",
                all.min,
                all.max
            );
        }
    }
}

/// Returns how far camera rays leave the image, in halves of its height, or more.
fn beyond(camera: &HostCamera, options: &RenderOptions) -> f64 {
    let Visibility::Cone { pixels, .. } = options.form() else {
        return f64::INFINITY;
    };
    let filter = 2.0 * pixels / options.height as f64;
    2.0 * filter.max(options.blur_slope() / camera.half_height)
}

/// Returns whether an object emits light, but no other object, no vertex of its own and no camera is in front of a face
/// that does. The result is false for objects that move or have many such faces.
fn shines_away(
    scene: &HostScene,
    index: usize,
    boxes: &[Option<Bounds>],
    cameras: &[&HostCamera],
) -> bool {
    let object = &scene.objects[index];
    let shines = |&f: &usize| scene.materials[object.material_of(f)].shines();
    let emitting = (0..object.faces.len()).filter(shines).take(MAX_FACES + 1);
    let faces: Vec<usize> = emitting.collect();
    let others = boxes.iter().enumerate().filter(|(i, _)| *i != index);
    let others: Vec<[f64; 3]> = others
        .filter_map(|(_, b)| *b)
        .flat_map(|b| b.corners())
        .collect();
    if faces.is_empty() || faces.len() > MAX_FACES || others.is_empty() || object.velocity.is_some()
    {
        return false;
    }
    faces.iter().all(|&f| {
        let [a, b, c] = object.faces[f].map(|v| DVec3::from(object.positions[v as usize]));
        let normal = (b - a).cross(c - a).normalize_or_zero();
        // More than rounding.
        let before = |p: &[f64; 3]| {
            let p = DVec3::from(*p);
            (p - a).dot(normal) > 1e-5 * (p - a).length()
        };
        let mut points = others.iter().chain(&object.positions);
        !points.any(before) && !cameras.iter().any(|camera| camera.is_before(a, normal))
    })
}

/// Returns whether a light is a spot light whose cone, which has at most a half-angle of 90°, contains no point of some
/// boxes, judged by their corners and the spheres about them.
fn misses(light: &HostLight, boxes: &[Bounds]) -> bool {
    let axis = DVec3::from(light.direction);
    let meets = |b: &Bounds| {
        let to = DVec3::from(b.center()) - DVec3::from(light.position);
        let radius = b.radius();
        // The angle that the sphere fills.
        let wide = (radius / to.length()).min(1.0).asin();
        let near = to.length() <= radius || to.angle_between(axis) <= light.angles[1] + wide;
        let before = |corner| (DVec3::from(corner) - DVec3::from(light.position)).dot(axis) > 0.0;
        near && b.corners().into_iter().any(before)
    };
    light.kind == LightKind::Spot && !boxes.iter().any(meets)
}

/// Returns an object with faces of glass that enclose nothing, unless all such faces of the scene do together.
fn open_glass(scene: &HostScene) -> Option<usize> {
    let is_glass = |m: usize| scene.materials[m].kind.bsdf.refracts();
    let sums = |object: &HostObject| {
        let faces = (0..object.faces.len()).filter(|&f| is_glass(object.material_of(f)));
        let area = faces.map(|f| {
            let [a, b, c] = object.faces[f].map(|v| DVec3::from(object.positions[v as usize]));
            (b - a).cross(c - a)
        });
        area.fold((DVec3::ZERO, 0.0), |sum, area| {
            (sum.0 + area, sum.1 + area.length())
        })
    };
    if !(0..scene.materials.len()).any(is_glass) {
        return None;
    }
    let is_open = |&(sum, area): &(DVec3, f64)| sum.length() > OPEN * area;
    let all: Vec<(DVec3, f64)> = scene.objects.iter().map(sums).collect();
    let whole = all
        .iter()
        .fold((DVec3::ZERO, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    all.iter().position(is_open).filter(|_| is_open(&whole))
}
