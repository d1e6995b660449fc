//! Warnings of likely mistakes in scenes, cameras and options. They read nothing back from a device.

use glam::DVec3;

use super::batch::Batch;
use super::options::RenderOptions;
use crate::scene::{Bounds, Parameter, Projection, Scene, narrow_in_radians, warn_of_radians};
use crate::tensors::Visibility;
use softray_kernels::host::{HostLight, HostMaterial, HostObject, HostScene, LightKind};
use softray_kernels::model::camera::HostCamera;
use softray_kernels::warning_once;

/// The radius of a scene in halves of the image's height at its far end, from which on a field of view may be in
/// radians. If it is and would show the whole scene, the radius is about 60 or more.
const NARROW: f64 = 10.0;

/// The number of bounces of a path through a body of glass.
const THROUGH_GLASS: u32 = 2;

/// The largest number of emitting faces of an object whose direction is checked.
const MAX_FACES: usize = 64;

/// The largest number of emitting faces that are compared with all of a scene.
const MAX_COMPARED: usize = 4 * MAX_FACES;

/// The sum of a surface's face normals over its area, from which on it is open. It is 0 for a closed surface.
const OPEN: f64 = 1e-3;

/// Warns of settings that are likely mistakes. Only constants are checked.
pub(super) fn warn_of_settings(batch: &Batch, options: &RenderOptions) {
    if let Visibility::Cone { angle, .. } = options.form() {
        warn_of_radians("options: the angle of cones", &Parameter::Constant([angle]));
    }
    for (_, camera) in &batch.views {
        if let Projection::Perspective { fov_y } = &camera.projection {
            warn_of_radians("the vertical field of view of a camera", fov_y);
        }
    }
    let bounces = options.bounces;
    if bounces < THROUGH_GLASS && batch.scenes.iter().any(Scene::refracts) {
        warning_once!(
            "the scene has glass, but paths end after {bounces} bounce{}: light passes through a body of glass \
             with {THROUGH_GLASS} bounces or more (RenderOptions::with_bounces)",
            if bounces == 1 { "" } else { "s" }
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
        let of_scene = views.iter().filter(|view| view.0 == s);
        let of_scene: Vec<&HostCamera> = of_scene.map(|v| v.1).collect();
        let name = |object: usize| &batch.scenes[s].objects[object].name;
        if let Some(object) = shines_away(host, &boxes, &of_scene) {
            warning_once!(
                "the light {} faces away from all objects and cameras: emitters shine from the front of their faces \
                 alone, from where the corners are counter-clockwise",
                name(object)
            );
        }
        if let Some(object) = open_glass(host) {
            warning_once!(
                "{} is of glass but not closed: the inside of glass is behind its front faces, and light that enters it \
                 does not leave it again, unless another object closes it",
                name(object)
            );
        }
        let boxes: Vec<Bounds> = boxes.into_iter().flatten().collect();
        if let Some(light) = host.lights.iter().position(|l| misses(l, &boxes)) {
            warning_once!("light {light} is a spot light whose cone contains nothing of the scene");
        }
        if let Some((view, angle, degrees)) = narrow_view(batch, s, cameras, &boxes) {
            warning_once!(
                "the camera of view {view} has a vertical field of view of {angle}°, which shows a small part of the \
                 scene: it is in degrees, and {angle} radians are {degrees:.1}° (if it is meant, ignore this)"
            );
        }
        let unseen = views.iter().position(|&(scene, camera)| {
            let aspect = options.width as f64 / options.height as f64;
            scene == s && !camera.may_see(&boxes, aspect, beyond(camera, options))
        });
        if let (Some(view), Some(all)) = (unseen, boxes.into_iter().reduce(|a, b| a.union(&b))) {
            let [eye, target] = views[view].1.line_of_sight();
            warning_once!(
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

/// Returns the first view of a scene with a field of view that is likely in radians, and its angle: in radians it is a
/// common one, and in degrees far smaller than the scene, even at its far end.
fn narrow_view(
    batch: &Batch,
    scene: usize,
    cameras: &[HostCamera],
    boxes: &[Bounds],
) -> Option<(usize, f64, f64)> {
    let all = boxes.iter().copied().reduce(|a, b| a.union(&b))?;
    let mut views = batch.views.iter().zip(cameras).enumerate();
    views.find_map(|(index, ((of, camera), host))| {
        let Projection::Perspective { fov_y } = &camera.projection else {
            return None;
        };
        let Parameter::Constant([angle]) = *fov_y else {
            return None;
        };
        let degrees = narrow_in_radians(angle).filter(|_| *of == scene)?;
        let [eye, _] = host.line_of_sight();
        let far = eye.distance(all.center().into()) + all.radius();
        let is_narrow = all.radius() > NARROW * host.half_height * far;
        is_narrow.then_some((index, angle, degrees))
    })
}

/// Returns an object that emits light, but no other object, no vertex of its own and no camera is in front of a face
/// that does. Objects that move or have many such faces are not checked. The time grows with the number of objects, not
/// with its square.
fn shines_away(
    scene: &HostScene,
    boxes: &[Option<Bounds>],
    cameras: &[&HostCamera],
) -> Option<usize> {
    let shine: Vec<bool> = scene.materials.iter().map(HostMaterial::shines).collect();
    if !shine.contains(&true) || boxes.iter().flatten().count() < 2 {
        return None;
    }
    let corners = boxes.iter().enumerate().flat_map(|(object, of_object)| {
        let corners = of_object.map(|b| b.corners());
        let corners = corners.into_iter().flatten();
        corners.map(move |corner| (object, corner))
    });
    let corners: Vec<(usize, [f64; 3])> = corners.collect();
    // Most lamps face the same corner. Faces that do not are compared with all corners, so their number is limited.
    let (mut last, mut left) = (0, MAX_COMPARED);
    (0..boxes.len()).find(|&index| {
        let object = &scene.objects[index];
        let faces = (0..object.faces.len()).filter(|&f| shine[object.material_of(f)]);
        let planes = faces.map(|f| plane(object, f));
        let planes = planes.filter(|(_, normal)| *normal != DVec3::ZERO);
        let planes: Vec<(DVec3, DVec3)> = planes.take(MAX_FACES + 1).collect();
        if planes.is_empty() || planes.len() > MAX_FACES || object.velocity.is_some() {
            return false;
        }
        planes.iter().all(|&(a, normal)| {
            // More than rounding.
            let before = |p: &[f64; 3]| {
                let p = DVec3::from(*p);
                (p - a).dot(normal) > 1e-5 * (p - a).length()
            };
            let is_other = |(of, corner): &(usize, [f64; 3])| *of != index && before(corner);
            if left == 0 || is_other(&corners[last]) {
                return false;
            }
            left -= 1;
            if let Some(corner) = corners.iter().position(is_other) {
                last = corner;
                return false;
            }
            let is_seen = cameras.iter().any(|camera| camera.is_before(a, normal));
            !is_seen && !object.positions.iter().any(before)
        })
    })
}

/// Returns a corner of a face and its unit normal, which is 0 without an area.
fn plane(object: &HostObject, face: usize) -> (DVec3, DVec3) {
    let [a, b, c] = object.faces[face].map(|v| DVec3::from(object.positions[v as usize]));
    (a, (b - a).cross(c - a).normalize_or_zero())
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
