//! Cameras of photographs show a scene where the photograph's pixels are.

use softray::photographs::{Distortion, ViewCamera, Window};
use softray::prelude::*;

/// A camera at (2, −1, 0.5) that looks along the world's x axis, with the world's z to the right.
fn view() -> ViewCamera {
    ViewCamera {
        to_world: [
            [0.0, 0.0, -1.0, 2.0],
            [0.0, 1.0, 0.0, -1.0],
            [1.0, 0.0, 0.0, 0.5],
        ],
        focal: [60.0, 75.0],
        principal: [21.5, 12.25],
        size: [48, 32],
        distortion: Distortion::None,
    }
}

/// The middle of what a camera sees of a small ball, in pixels.
fn seen(view: &ViewCamera, center: [f64; 3]) -> softray::Result<[f64; 2]> {
    let device = Device::flex();
    let ball = shapes::icosphere(2, &device)
        .scaled(0.15)
        .translated(center);
    let scene = Scene::new().with_object(Object::new(ball));
    let [width, height] = view.size;
    let options = RenderOptions::new(width, height).with_samples(64);
    let options = options.with_bounces(0).with_opacity();
    let image = render(&scene, &view.to_camera()?, &options)?;
    let opacity = image.opacity.expect("an opacity").into_data();
    let opacity = opacity.try_to_vec::<f32>().expect("floats");
    let mut sums = [0.0; 3];
    for (i, &o) in opacity.iter().enumerate() {
        let o = f64::from(o);
        sums[0] += o * ((i % width) as f64 + 0.5);
        sums[1] += o * ((i / width) as f64 + 0.5);
        sums[2] += o;
    }
    Ok([sums[0] / sums[2], sums[1] / sums[2]])
}

#[test]
fn renders_show_points_where_cameras_project_them() {
    let window = Window {
        start: [20, 2],
        size: [25, 17],
    };
    let part = view().cropped(window).expect("a part");
    for view in [view(), part, view().scaled_to([96, 64])] {
        for center in [[7.0, -0.75, 0.75], [8.0, -0.5, 1.5]] {
            let [x, y] = seen(&view, center).expect("a render");
            let [u, v] = view.project(center).expect("a pixel");
            // A ball's outline is an ellipse whose middle is a little farther out than the ball's.
            let apart = (x - u).abs().max((y - v).abs());
            assert!(apart < 0.1, "{:?}: {x} {y}, expected {u} {v}", view.size);
        }
    }
}
