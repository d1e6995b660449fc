//! Rendered images and animations in files.

use std::fs;

use crate::common::errors::{message, says};
use crate::common::folder::Folder;
use crate::common::scenes::{diffuse, emitting, on_axis, under_sky};
use crate::common::tensors::{leaf, values};
use image::{AnimationDecoder, GenericImageView};
use softray::io::Animation;
use softray::prelude::*;

/// A view of a batch with all outputs that files hold: a ball beside the middle, of 32 × 24 pixels.
fn ball_with_outputs() -> Image {
    let device = Device::flex();
    let ball = shapes::icosphere(2, &device);
    let scene = Scene::new()
        .with_object(Object::new(
            ball.translated(Tensor::from_floats([0.2, 0.0, 0.0], &device)),
        ))
        .with_environment([0.9, 0.7, 1.5]);
    let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3]).with_fov_y(40.0);
    let options = RenderOptions::new(32, 24).with_samples(4).with_bounces(0);
    let options = options
        .with_depth()
        .with_normals()
        .with_opacity()
        .with_albedo();
    let batch = Batch::new(vec![scene], vec![camera.clone(), camera]).expect("a batch");
    render_batch(&batch, &options).expect("images").view(1)
}

/// EXR layers say which form they hold.
fn assert_layers_are_named(folder: &Folder) {
    for (file, layer) in [
        ("depth", "depth.premultiplied"),
        ("normals", "normals.premultiplied"),
    ] {
        let path = folder.path(&format!("{file}.exr"));
        let read = exr::prelude::read_first_flat_layer_from_file(path).expect("a layer");
        let attributes = read.layer_data.attributes;
        assert_eq!(attributes.layer_name.expect("a name").to_string(), layer);
        let comment = attributes.comments.expect("a comment").to_string();
        assert!(comment.contains("divide by the opacity"), "{comment}");
    }
}

#[test]
fn outputs_are_pictures_and_data() {
    let folder = Folder::new("outputs");
    let image = ball_with_outputs();
    for ending in ["png", "exr", "pfm"] {
        let path = |name: &str| folder.path(&format!("{name}.{ending}"));
        image.write(path("radiance")).expect("a file");
        image.write_depth(path("depth")).expect("a file");
        image.write_normals(path("normals")).expect("a file");
        image.write_opacity(path("opacity")).expect("a file");
        image.write_albedo(path("albedo")).expect("a file");
    }
    let data = |name: &str| HostImage::read(folder.path(name)).expect("an image").pixels;
    let same = |found: Vec<f32>, expected: &[f64], times: usize| {
        assert_eq!(found.len(), expected.len() * times);
        let repeated = expected.iter().flat_map(|&v| vec![v as f32; times]);
        assert!(found.into_iter().eq(repeated));
    };
    let depth = values(image.depth.as_ref().expect("depth"));
    let normals = values(image.normals.as_ref().expect("normals"));
    let opacity = values(image.opacity.as_ref().expect("opacity"));
    same(data("radiance.exr"), &values(&image.radiance), 1);
    same(data("depth.exr"), &depth, 3);
    same(data("normals.exr"), &normals, 1);
    same(data("opacity.exr"), &opacity, 3);
    let albedo = values(image.albedo.as_ref().expect("albedo"));
    same(data("albedo.exr"), &albedo, 1);

    // Portable float maps: rows from the bottom up, little endian.
    let file = fs::read(folder.path("normals.pfm")).expect("a file");
    let rows = file.strip_prefix(b"PF\n32 24\n-1.0\n").expect("a header");
    let numbers = rows
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let numbers: Vec<f32> = numbers.collect();
    let from_top = numbers.chunks(3 * 32).rev().flatten().copied().collect();
    same(from_top, &normals, 1);

    assert_layers_are_named(&folder);

    let picture = |name: &str| image::open(folder.path(name)).expect("a picture");
    let radiance = picture("radiance.png");
    assert_eq!(radiance.dimensions(), (32, 24));
    // Of 0.9 and 0.7 in sRGB.
    assert_eq!(radiance.get_pixel(0, 0).0[..3], [243, 218, 255]);
    let (of_depth, of_normals) = (picture("depth.png"), picture("normals.png"));
    let of_opacity = picture("opacity.png");
    assert_eq!(of_opacity.color(), image::ColorType::L8);
    let of_albedo = picture("albedo.png");
    // Of the default albedo of 0.5 in sRGB.
    assert_eq!(of_albedo.get_pixel(16, 12).0[..3], [188; 3]);
    let byte = |v: f64| (255.0 * v.clamp(0.0, 1.0)).round();
    // Pictures show visible surfaces, files of data what whole pixels see.
    assert!(opacity.iter().any(|&o| o > 0.0 && o < 1.0));
    let of_surfaces = |v: f64, o: f64| if o > 0.0 { v / o } else { 0.0 };
    let depths = depth.iter().zip(&opacity).map(|(&d, &o)| of_surfaces(d, o));
    let depth: Vec<f64> = depths.collect();
    let seen = || depth.iter().copied().filter(|&d| d > 0.0);
    let (near, far) = (
        seen().fold(f64::INFINITY, f64::min),
        seen().fold(0.0, f64::max),
    );
    let mut found = [0; 3];
    for (i, (&d, &o)) in depth.iter().zip(&opacity).enumerate() {
        let (x, y) = (i as u32 % 32, i as u32 / 32);
        let close = |a: u8, b: f64| assert!((f64::from(a) - b).abs() <= 1.0, "{a}, {b}");
        close(of_opacity.get_pixel(x, y).0[0], byte(o));
        for c in 0..3 {
            let n = of_surfaces(normals[3 * i + c], o);
            close(of_normals.get_pixel(x, y).0[c], byte(0.5 + 0.5 * n));
        }
        let color = &of_depth.get_pixel(x, y).0[..3];
        if d == 0.0 {
            assert_eq!(color, [128; 3]);
            found[0] += 1;
        } else if d < near + 1e-5 {
            // The ends of viridis.
            assert!(color[0] > 60 && color[1] < 5 && color[2] > 80, "{color:?}");
            found[1] += 1;
        } else if d > far - 1e-5 {
            assert!(
                color[0] > 245 && color[1] > 225 && color[2] < 45,
                "{color:?}"
            );
            found[2] += 1;
        }
    }
    assert!(found.iter().all(|&n| n > 0), "{found:?}");
}

#[test]
fn outputs_that_were_not_asked_for_are_named() {
    let folder = Folder::new("missing");
    let (scene, camera) = (under_sky(shapes::cube(&Device::flex())), on_axis(4.0));
    let options = RenderOptions::new(2, 2).with_samples(1).with_bounces(0);
    let image = render(&scene, &camera, &options).expect("an image");
    let (exr, png) = (folder.path("a.exr"), folder.path("a.png"));
    says(
        message(image.write_depth(&png)),
        ["RenderOptions::with_depth"],
    );
    says(
        message(image.write_normals(exr)),
        ["RenderOptions::with_normals"],
    );
    says(
        message(image.write_albedo(&png)),
        ["RenderOptions::with_albedo"],
    );
    says(
        message(image.write_opacity(&png)),
        ["RenderOptions::with_opacity"],
    );
    let jpeg = image.write(folder.path("a.jpg"));
    says(message(jpeg), ["expected .exr or .pfm or .png"]);
    assert!(folder.files().is_empty());
}

#[test]
fn animations_loop_at_their_rate() {
    let folder = Folder::new("animation");
    let path = folder.path("turntable.gif");
    let device = Device::flex();
    let height = leaf(&[0.0, 0.1, 0.0], &device);
    let cube = shapes::cube(&device).translated(height);
    let scene = Scene::new()
        .with_object(diffuse(cube, [0.7, 0.3, 0.2]))
        .with_environment([0.4, 0.5, 0.6])
        .with_object(emitting(
            shapes::torus(1.6, 0.2, 12, 6, &device),
            [0.2, 0.9, 0.3],
        ));
    let cameras = (0..8).map(|i| {
        let (sin, cos) = (f64::from(i) / 8.0 * std::f64::consts::TAU).sin_cos();
        Camera::look_at([4.5 * sin, 2.0, 4.5 * cos], [0.3, 0.0, 0.0])
    });
    let options = RenderOptions::new(32, 24).with_samples(8).with_bounces(1);
    let animation = Animation::render(&scene, cameras, &options).expect("frames");
    let animation = animation.with_frames_per_second(30.0);
    animation.write(&path).expect("a file");
    let file = std::io::BufReader::new(fs::File::open(&path).expect("a file"));
    let decoder = image::codecs::gif::GifDecoder::new(file).expect("a GIF file");
    let frames = decoder.into_frames().collect_frames().expect("frames");
    assert_eq!(frames.len(), 8);
    let mut time = 0;
    for (frame, image) in frames.iter().zip(animation.frames()) {
        let (milliseconds, one) = frame.delay().numer_denom_ms();
        time += milliseconds / one;
        assert_eq!(frame.buffer().dimensions(), (32, 24));
        // What sRGB is of the linear values, as PNG files have it.
        let still = folder.path("still.png");
        image.write(&still).expect("a file");
        let still = image::open(&still).expect("a picture").into_rgba8();
        let apart = frame.buffer().iter().zip(still.iter());
        let apart: f64 = apart
            .map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2))
            .sum();
        let apart = (apart / still.len() as f64).sqrt();
        // 256 colors for 768 noisy pixels; linear bytes would be 60 off.
        assert!(apart < 8.0, "{apart}");
    }
    // Eight thirtieths of a second.
    assert_eq!(time, 270);
    let bytes = fs::read(&path).expect("a file");
    let forever = b"NETSCAPE2.0\x03\x01\x00\x00";
    assert!(bytes.windows(forever.len()).any(|w| w == forever));
    // The target is beside the axis.
    assert_ne!(animation.frames()[0], animation.frames()[4]);
}

#[test]
fn animations_have_frames_of_one_size() {
    let black = |w, h| HostImage::new(w, h, vec![0.0; w * h * 3]).expect("an image");
    says(message(Animation::new(Vec::new())), ["at least one"]);
    let sizes = Animation::new(vec![black(2, 3), black(2, 3), black(3, 2)]);
    says(message(sizes), ["frame 2", "2 × 3"]);
    let folder = Folder::new("animation-errors");
    let animation = Animation::new(vec![black(2, 3)]).expect("one frame");
    for rate in [0.0, f64::NAN, 51.0] {
        let at = animation.clone().with_frames_per_second(rate);
        let error = at.write(folder.path("a.gif"));
        says(message(error), ["frames_per_second"]);
    }
    says(
        message(animation.write(folder.path("a.mp4"))),
        ["expected .gif"],
    );
    let wide = Animation::new(vec![black(65_536, 1)]).expect("one frame");
    says(message(wide.write(folder.path("a.gif"))), ["65535"]);
    assert!(folder.files().is_empty());
}

fn ramp(width: usize, height: usize) -> HostImage {
    let n = width * height * 3;
    let pixels = (0..n).map(|i| i as f32 / n as f32 * 1.5).collect();
    HostImage::new(width, height, pixels).expect("size")
}

#[test]
fn png_is_clipped_srgb() {
    let folder = Folder::new("ramp");
    let path = folder.path("ramp.png");
    let image = ramp(5, 4);
    image.write(&path).expect("write");
    let read = HostImage::read(&path).expect("read");
    assert!(read.rmse(&image, true).expect("size") < 3e-3);
    assert!(read.pixels.iter().all(|v| (0.0..=1.0).contains(v)));
}

#[test]
fn statistics() {
    let image = HostImage::new(2, 1, vec![0.0, 1.0, 2.0, 2.0, 3.0, 4.0]).expect("size");
    let black = HostImage::new(2, 1, vec![0.0; 6]).expect("size");
    assert_eq!(image.mean(), [1.0, 2.0, 3.0]);
    assert_eq!(image.mean_ratio(&image), 1.0);
    let rmse = |clipped| image.rmse(&black, clipped).expect("size");
    assert!((rmse(false) - (34f64 / 6.0).sqrt()).abs() < 1e-12);
    assert!((rmse(true) - (5f64 / 6.0).sqrt()).abs() < 1e-12);
    let error = image.rmse(&ramp(1, 1), false).expect_err("sizes differ");
    assert!(error.to_string().contains("2 × 1"), "{error}");
}

#[test]
fn side_by_side_has_white_gaps() {
    let (a, b) = (ramp(2, 2), ramp(1, 1));
    let row = HostImage::side_by_side(&[&a, &b]);
    assert_eq!((row.width, row.height), (5, 2));
    assert_eq!(row.pixels[..6], a.pixels[..6]);
    assert_eq!(row.pixels[6..12], [1.0; 6]);
    assert_eq!(row.pixels[12..15], b.pixels[..]);
    assert_eq!(row.pixels[15..21], a.pixels[6..]);
}
