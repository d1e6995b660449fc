//! Warnings: where they are seen, and what is a reason for one.

use std::process::Stdio;

use crate::common::mistakes::{ball, camera, flex, lit, small, warnings};
use crate::common::process::{again, alone};
use softray::prelude::*;

/// What the process that is watched does.
const WATCHED: &str = "SOFTRAY_WARNED";

/// A black image twice, more fields of view and azimuths in radians than are printed, and a rotation twice.
fn mistakes() {
    let dark = Scene::new().with_object(ball());
    for _ in 0..2 {
        render(&dark, &camera(), &small()).expect("an image");
    }
    for i in 0..12 {
        let narrow = camera().with_fov_y(1.0 + 0.1 * f64::from(i));
        render(&lit(ball()), &narrow, &small()).expect("an image");
    }
    // Two kinds of warnings from one place in the code.
    for i in 1..=9 {
        let azimuth = f64::from(i).to_radians();
        Camera::orbit([0.0; 3], 3.0, azimuth, 20.0).expect("a camera");
    }
    for _ in 0..2 {
        let _ = shapes::cube(&flex()).rotated([0.0, 1.0, 0.0], 30f64.to_radians());
    }
}

#[test]
fn warnings_are_printed_without_a_logger() {
    if let Some(how) = std::env::var_os(WATCHED) {
        match how.to_str() {
            // A logger has each text once, but those of images without light each time.
            Some("logged") => assert_eq!(warnings(mistakes).len(), 2 + 12 + 9 + 1),
            Some("hidden") => {
                softray::show_warnings(false);
                mistakes();
            }
            _ => mistakes(),
        }
        return;
    }
    let watch = |how: &str, variable: &str| {
        let output = again(warnings_are_printed_without_a_logger)
            .env(WATCHED, how)
            .env("SOFTRAY_WARNINGS", variable)
            .stdout(Stdio::null())
            .output()
            .expect("a process");
        let text = String::from_utf8(output.stderr).expect("text");
        assert!(output.status.success(), "{text}");
        text
    };
    let printed = watch("shown", "1");
    let lines: Vec<&str> = printed.lines().collect();
    let count = |part: &str| lines.iter().filter(|l| l.contains(part)).count();
    assert_eq!(lines.len(), 20, "{printed}");
    assert_eq!(count("softray: warning: "), 18, "{printed}");
    assert_eq!(count("the scene has no light"), 1, "{printed}");
    assert_eq!(count("field of view"), 8, "{printed}");
    assert_eq!(count("the azimuth"), 8, "{printed}");
    assert_eq!(count("the angle of a rotation"), 1, "{printed}");
    assert_eq!(count("more warnings of this kind"), 2, "{printed}");
    for [how, variable] in [["shown", "0"], ["hidden", "1"], ["logged", "1"]] {
        assert_eq!(watch(how, variable), "", "{how}, {variable}");
    }
}

/// That a render has one warning with this part, or none for an empty part. Each text is logged once in a process, so tests
/// of it have a process of their own.
fn expect(part: &str, (scene, camera, options): (&Scene, &Camera, &RenderOptions)) {
    let warned = warnings(|| render(scene, camera, options).expect("an image"));
    let is_right = match part {
        "" => warned.is_empty(),
        part => warned.len() == 1 && warned[0].contains(part),
    };
    assert!(is_right, "{part}: {warned:?}");
}

#[test]
fn cameras_that_see_nothing() {
    if !alone(cameras_that_see_nothing) {
        return;
    }
    let scene = lit(Object::new(shapes::cube(&flex())).with_name("box"));
    let eye = [0.0, 0.0, 4.0];
    let look_at = |target| Camera::look_at(eye, target);
    let unseen = "nothing of the scene is in view 0";
    for (part, camera) in [
        ("", look_at([0.0; 3])),
        // A corner of the box is in view.
        ("", look_at([2.0, 0.0, 0.0])),
        (unseen, look_at([0.0, 0.0, 9.0])),
        (unseen, look_at([4.0, 0.0, 2.0])),
        (unseen, look_at([0.0, -9.0, 0.0]).with_up([0.0, 0.0, 1.0])),
        ("", look_at([0.0; 3]).with_orthographic(0.1)),
        (unseen, look_at([0.0, 0.0, 8.0]).with_orthographic(9.0)),
        // From inside, where it is dark.
        (
            "view 0 is black",
            Camera::look_at([0.0; 3], [1.0, 0.0, 0.0]),
        ),
        ("", look_at([2.0, 0.0, 0.0]).with_thin_lens(0.5, 3.0)),
    ] {
        expect(part, (&scene, &camera, &small()));
    }
    // The box comes into view while the shutter is open.
    let moving = scene.map_object("box", |o| {
        let mesh = o.mesh.clone().translated([30.0, 0.0, 0.0]);
        Object::new(mesh).with_velocity([-30.0, 0.0, 0.0])
    });
    let moving = moving.expect("an object");
    expect("", (&moving, &look_at([0.0; 3]), &small()));
}

#[test]
fn lights_that_face_away() {
    if !alone(lights_that_face_away) {
        return;
    }
    let device = flex();
    let floor = || Object::new(shapes::plane_grid(4.0, 4.0, 1, 1, &device));
    let lamp = |up: bool| {
        let [a, b, c, d] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let at = |[x, z]: [f64; 2]| [x, 2.0, z];
        let corners = if up { [d, c, b, a] } else { [a, b, c, d] }.map(at);
        let [a, b, c, d] = corners;
        Object::new(shapes::quad(a, b, c, d, &device))
            .with_name("lamp")
            .with_material(Material::emitter([5.0; 3]))
    };
    let scene = |up| Scene::new().with_object(floor()).with_object(lamp(up));
    let below = Camera::look_at([0.0, 1.0, 4.0], [0.0, 0.5, 0.0]);
    let above = Camera::look_at([0.0, 4.0, 4.0], [0.0, 2.0, 0.0]);
    expect("", (&scene(false), &below, &small()));
    expect("", (&scene(true), &above, &small()));
    let warned = warnings(|| render(&scene(true), &below, &small()).expect("an image"));
    assert!(
        warned[0].contains("the light lamp faces away"),
        "{warned:?}"
    );

    // Many lamps above the floor, one of which faces away.
    let lamps = |up: &dyn Fn(usize) -> bool| {
        let lamps = (0..200).map(|i| lamp(up(i)).with_name(format!("lamp {i}")));
        let scene = lamps.fold(Scene::new(), |scene, lamp| scene.with_object(lamp));
        scene.with_object(floor())
    };
    expect("", (&lamps(&|_| false), &below, &small()));
    let one = lamps(&|i| i == 150);
    expect("the light lamp 150 faces away", (&one, &below, &small()));

    let spot = |direction: [f64; 3]| {
        let light = Light::spot([0.0, 2.0, 0.0], direction, [5.0; 3], 10.0, 20.0);
        lit(floor()).with_light(light)
    };
    expect("", (&spot([0.0, -1.0, 0.0]), &below, &small()));
    let up = spot([0.0, 1.0, 0.0]);
    expect("cone contains nothing", (&up, &below, &small()));
}

#[test]
fn glass_that_is_open_or_lacks_bounces() {
    if !alone(glass_that_is_open_or_lacks_bounces) {
        return;
    }
    let device = flex();
    let glass = |mesh: Mesh| Object::new(mesh).with_material(Material::dielectric(1.5, 0.1));
    let two = small().with_bounces(2);
    let closed = lit(glass(shapes::sphere(16, 8, &device)).with_name("bowl"));
    expect("", (&closed, &camera(), &two));
    let few = small().with_bounces(1);
    expect("after 1 bounce:", (&closed, &camera(), &few));
    // A ball without its last faces, alone and with a second object that closes it.
    let whole = shapes::icosphere(1, &device);
    let part = |range: std::ops::Range<usize>| {
        let mut mesh = whole.clone();
        mesh.faces = std::sync::Arc::new(mesh.faces[range].to_vec());
        glass(mesh).with_name("bowl")
    };
    let open = lit(part(0..60));
    expect("bowl is of glass but not closed", (&open, &camera(), &two));
    let both = open.with_object(part(60..80));
    expect("", (&both, &camera(), &two));
}

#[test]
fn angles_in_radians() {
    if !alone(angles_in_radians) {
        return;
    }
    let expect_one = |part: &str, f: &dyn Fn()| {
        let warned = warnings(f);
        assert!(warned.len() == 1 && warned[0].contains(part), "{warned:?}");
    };
    let radians = |degrees: f64| degrees.to_radians();
    expect_one("which is 90° in radians", &|| {
        let _ = shapes::cube(&flex()).rotated([0.0, 1.0, 0.0], radians(90.0));
    });
    expect_one("the outer angle of a spot light", &|| {
        let _ = Light::spot([0.0; 3], [1.0, 0.0, 0.0], [1.0; 3], 0.2, radians(20.0));
    });
    expect_one("the azimuth of a camera", &|| {
        Camera::orbit([0.0; 3], 3.0, radians(30.0), 20.0).expect("a camera");
    });
    let blurred = small().with_blur(radians(2.0));
    expect("the angle of cones", (&lit(ball()), &camera(), &blurred));
    let degrees = small().with_blur(0.05);
    expect("", (&lit(ball()), &camera(), &degrees));
    let fov = |degrees| camera().with_fov_y(degrees);
    let part = "0.7 radians are 40.1°";
    expect(part, (&lit(ball()), &fov(0.7), &small()));
    let part = "the vertical field of view of a camera is 0.6";
    let exact = fov(radians(40.0));
    expect(part, (&lit(ball()), &exact, &small()));
    // A long lens that has a far object in view.
    let far = Camera::look_at([0.0, 0.0, 90.0], [0.0; 3]).with_fov_y(2.0);
    expect("", (&lit(ball()), &far, &small()));
    let pose = || {
        let pose = RigidTransformConfig::new().init(&flex());
        pose.expect("a pose")
    };
    expect_one("the angle of a rigid transform", &|| {
        let pose = pose().with_axis_angle([0.0, 1.0, 0.0], radians(60.0));
        pose.expect("a rotation");
    });
    expect_one("which is -45° in radians", &|| {
        pose()
            .with_euler([30.0, 0.0, radians(-45.0)])
            .expect("a rotation");
    });
    expect_one("1.2 radians are 68.8°", &|| {
        let camera = CameraParamsConfig::new([0.0, 0.0, 4.0], [0.0; 3]);
        camera.with_fov_y(1.2).init(&flex()).expect("a camera");
    });
}

/// The renders of a schedule have no bounces, which its user's own may have.
#[test]
fn schedules_render_without_warnings() {
    if !alone(schedules_render_without_warnings) {
        return;
    }
    let glass = lit(ball().with_material(Material::dielectric(1.5, 0.1)));
    let cube = lit(Object::new(shapes::cube(&flex())));
    let inside = Camera::look_at([0.0; 3], [1.0, 0.0, 0.0]);
    for (scene, camera) in [(&glass, &camera()), (&cube, &inside)] {
        let warned = warnings(|| BlurSchedule::auto(scene, camera, 16, 10).expect("a schedule"));
        assert_eq!(warned, [""; 0]);
    }
}

/// Other programs than the host's kernels do not look at their images, but files hold them.
#[test]
fn black_files() {
    let folder = crate::common::folder::Folder::new("black");
    let walls = Object::new(shapes::cube(&flex()));
    let lamp = Object::new(shapes::icosahedron(&flex()).scaled(0.1))
        .with_material(Material::emitter([1.0; 3]));
    let scene = Scene::new().with_object(walls).with_object(lamp);
    let options = small().with_engine(Engine::Tensors);
    let image = render(&scene, &camera(), &options).expect("an image");
    let warned = warnings(|| image.write(folder.path("a.png")).expect("a file"));
    assert!(
        warned.len() == 1 && warned[0].ends_with("a.png: the image is black"),
        "{warned:?}"
    );
}
