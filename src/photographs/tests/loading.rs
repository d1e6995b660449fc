//! Photographs as they are loaded.

use std::fs;
use std::io::Cursor;

use serde_json::json;

use super::{Folder, SIZE, cameras, sets};
use crate::photographs::{Loaded, Photograph, PhotographOptions, Photographs};

/// The linear value of an sRGB byte.
pub fn linear(byte: u8) -> f32 {
    let v = f32::from(byte) / 255.0;
    match v <= 0.04045 {
        true => v / 12.92,
        false => ((v + 0.055) / 1.055).powf(2.4),
    }
}

pub fn set(folder: &Folder) -> Photographs {
    sets::nerfstudio(folder, &cameras([50.0, 53.0], [18.0, 16.0]), &json!({}));
    Photographs::open(folder).expect("a set")
}

#[track_caller]
pub fn load(set: &Photographs, options: &PhotographOptions) -> Loaded {
    let all: Vec<usize> = (0..set.views.len()).collect();
    set.load(&all, options).expect("photographs")
}

#[track_caller]
pub fn assert_near(found: f32, expected: f32) {
    assert!((found - expected).abs() < 1e-5, "{found} {expected}");
}

/// Images with a photograph of its own in the first place.
pub fn folder_with(size: [u32; 2], color: impl Fn(u32, u32) -> [u8; 4]) -> Folder {
    let folder = Folder::new();
    folder.gray_images("images", 3, SIZE.map(|n| n as u32));
    folder.image("images/000.png", size, color);
    folder
}

#[test]
fn photographs_shrink_in_linear_light_with_their_cameras() {
    let folder = folder_with([40, 30], |x, _| {
        [if x % 2 == 0 { 255 } else { 0 }, 128, 0, 255]
    });
    let set = set(&folder);
    let loaded = load(&set, &PhotographOptions::new().with_longest_side(20));
    let photo = &loaded.photographs[0];
    assert_eq!([photo.color.width, photo.color.height], [20, 15]);
    assert_near(photo.color.pixels[0], 0.5);
    assert_near(photo.color.pixels[1], linear(128));
    assert!(!photo.masked && photo.mask.iter().chain(&photo.weight).all(|&v| v == 1.0));
    assert_eq!(photo.camera.focal, [25.0, 26.5]);
    assert_eq!(photo.camera.principal, [9.0, 8.0]);
    // The same point of the image has the same ray.
    let [small, large] = [
        photo.camera.ray([5.0, 10.0]),
        set.views[0].camera.ray([10.0, 20.0]),
    ];
    assert_eq!(small, large);
}

#[test]
fn alpha_is_a_soft_mask_and_composites_on_black() {
    let folder = folder_with([40, 30], |x, _| {
        [255, 255, 255, if x % 2 == 0 { 51 } else { 255 }]
    });
    let loaded = load(
        &set(&folder),
        &PhotographOptions::new().with_longest_side(20),
    );
    let photo = &loaded.photographs[0];
    assert!(photo.masked && !loaded.photographs[1].masked);
    assert!(
        photo
            .mask
            .iter()
            .chain(&photo.color.pixels)
            .all(|v| (v - 0.6).abs() < 1e-5)
    );
}

#[test]
fn masks_of_files() {
    // As the file of cameras names it, as COLMAP names it, and by the stem.
    for name in [
        "masks/000.png.png",
        "masks/000.jpg",
        "mask/000.png",
        "other/m.png",
    ] {
        let folder = folder_with([40, 30], |_, _| [255, 255, 255, 255]);
        folder.image(name, [40, 30], |x, _| {
            [if x < 10 { 255 } else { 0 }; 3].into_rgba()
        });
        let _ = set(&folder);
        if name.starts_with("other") {
            let path = folder.at("transforms.json");
            let text = fs::read_to_string(&path).expect("a text");
            let text = text.replacen(
                "\"file_path\"",
                "\"mask_path\":\"./other/m.png\",\"file_path\"",
                1,
            );
            fs::write(path, text).expect("a file");
        }
        let set = Photographs::open(&folder).expect("a set");
        let options = PhotographOptions::new().with_longest_side(4);
        let photo = &load(&set, &options).photographs[0];
        assert!(photo.masked);
        assert!(
            (photo.mask[0] - 1.0).abs() < 0.05 && photo.mask[3] < 0.05,
            "{:?}",
            photo.mask
        );
        assert!(photo.color.pixels[11] > 0.9);
        let black = &load(&set, &options.with_black_backdrop(true)).photographs[0];
        assert!(black.color.pixels[11] < 0.05 && black.color.pixels[0] > 0.9);
        if !name.starts_with("other") {
            let note = &set.notes[0];
            assert!(
                note.contains("there is no mask in")
                    && note.ends_with("images/001.png, images/002.png")
            );
        }
    }
}

pub trait IntoRgba {
    fn into_rgba(self) -> [u8; 4];
}

impl IntoRgba for [u8; 3] {
    fn into_rgba(self) -> [u8; 4] {
        [self[0], self[1], self[2], 255]
    }
}

#[test]
fn masks_of_another_size_are_an_error() {
    let folder = folder_with([40, 30], |_, _| [9, 9, 9, 255]);
    folder.image("masks/001.png", [30, 30], |_, _| [9, 9, 9, 255]);
    let error = set(&folder).load(&[0, 1, 2], &PhotographOptions::new());
    let error = error.expect_err("an error").to_string();
    assert!(error.contains("001.png") && error.contains("30 × 30") && error.contains("40 × 30"));
}

#[test]
fn plain_backgrounds_become_masks() {
    // A white object on black that has black in it.
    let inside = |v: u32, size: u32| v > 5 && v < size - 5;
    let folder = folder_with([40, 30], |x, y| {
        let black = !(inside(x, 40) && inside(y, 30)) || (x == 20 && y == 15);
        if black { [2, 1, 0, 255] } else { [255; 4] }
    });
    let set = set(&folder);
    let loaded = load(&set, &PhotographOptions::new());
    let expected = ["the mask is all but the black background: images/000.png"];
    assert_eq!(loaded.notes, expected);
    let photo = &loaded.photographs[0];
    assert_eq!(photo.mask.iter().sum::<f32>(), 29.0 * 19.0);
    assert_eq!(photo.mask[15 * 40 + 20], 1.0);
    let options = PhotographOptions::new().with_plain_background(false);
    assert!(!load(&set, &options).photographs[0].masked);
}

/// A JPEG file whose corners are red, green, blue (upper left, upper right, lower left) and white, with an orientation.
fn jpeg(orientation: u8) -> Vec<u8> {
    let image = image::RgbImage::from_fn(64, 32, |x, y| {
        image::Rgb(match (x < 32, y < 16) {
            (true, true) => [255, 0, 0],
            (false, true) => [0, 255, 0],
            (true, false) => [0, 0, 255],
            (false, false) => [255, 255, 255],
        })
    });
    let mut bytes = Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Jpeg)
        .expect("a JPEG");
    let bytes = bytes.into_inner();
    let mut exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
    exif.extend([orientation, 0, 0, 0, 0, 0, 0]);
    let mut all = bytes[..2].to_vec();
    all.extend([0xff, 0xe1]);
    all.extend((exif.len() as u16 + 2).to_be_bytes());
    all.extend(exif);
    all.extend(&bytes[2..]);
    all
}

/// The colors of the corners, as the letters r, g, b and w.
fn corners(photo: &Photograph) -> String {
    let [w, h] = photo.camera.size;
    let places = [[2, 2], [w - 3, 2], [2, h - 3], [w - 3, h - 3]];
    let letter = |[x, y]: [usize; 2]| {
        let color = &photo.color.pixels[3 * (y * w + x)..][..3];
        match [0, 1, 2].map(|c| color[c] > 0.5) {
            [true, false, false] => 'r',
            [false, true, false] => 'g',
            [false, false, true] => 'b',
            _ => 'w',
        }
    };
    places.into_iter().map(letter).collect()
}

#[test]
fn orientations_follow_the_camera() {
    // What is seen if the stored image is turned by the orientation (the standard's table).
    for (orientation, turned) in [(5, "rbgw"), (6, "brwg"), (7, "wgbr"), (8, "gwrb")] {
        let folder = Folder::new();
        folder.write("images/0.jpg", jpeg(orientation));
        for (size, expected) in [([64, 32], "rgbw"), ([32, 64], turned)] {
            let mut camera = cameras([50.0; 2], [10.0, 20.0])[0];
            camera.size = size;
            let frame =
                json!({"file_path": "images/0.jpg", "transform_matrix": sets::matrix(&camera)});
            let whole = json!({"fl_x": 50.0, "w": size[0], "h": size[1], "frames": [frame]});
            folder.write("transforms.json", whole.to_string());
            let set = Photographs::open(&folder).expect("a set");
            assert!(set.notes[0].contains("EXIF orientation"), "{:?}", set.notes);
            let photo = &load(&set, &PhotographOptions::new()).photographs[0];
            assert_eq!(photo.camera.size, size);
            assert_eq!(corners(photo), expected, "orientation {orientation}");
        }
    }
}

#[test]
fn memory_is_checked_before_a_file_is_read() {
    let folder = folder_with([40, 30], |_, _| [9, 9, 9, 255]);
    let set = set(&folder);
    fs::remove_file(folder.at("images/000.png")).expect("a file");
    let options = PhotographOptions::new().with_memory(20_000);
    let error = set
        .load(&[0, 1, 2], &options)
        .expect_err("an error")
        .to_string();
    assert!(error.contains("72000 bytes for 3 photographs"), "{error}");
    assert!(
        error.contains("a longest side of 20 pixels fits"),
        "{error}"
    );
    let error = set
        .load(&[0, 1, 2], &PhotographOptions::new())
        .expect_err("an error");
    assert!(error.to_string().contains("000.png"));
    assert!(set.load(&[3], &options).is_err());
}

#[test]
fn deep_and_linear_images() {
    let folder = Folder::new();
    let deep = image::ImageBuffer::from_pixel(4, 3, image::Rgba([32768u16, 65535, 0, 13107]));
    let deep: image::DynamicImage = deep.into();
    deep.save(folder.at("images/0.png")).expect("a PNG");
    for ending in ["exr", "hdr"] {
        let linear = image::ImageBuffer::from_pixel(4, 3, image::Rgb([0.5f32, 4.0, 0.25]));
        let linear: image::DynamicImage = linear.into();
        linear
            .save(folder.at(&format!("images/1.{ending}")))
            .expect("an image");
    }
    let frame = |name: &str| {
        let pose = sets::matrix(&cameras([50.0; 2], [2.0; 2])[0]);
        json!({"file_path": format!("images/{name}"), "transform_matrix": pose})
    };
    let frames = ["0.png", "1.exr", "1.hdr"].map(frame);
    let whole = json!({"camera_angle_x": 0.7, "frames": frames});
    folder.write("transforms.json", whole.to_string());
    let set = Photographs::open(&folder).expect("a set");
    let photos = load(&set, &PhotographOptions::new()).photographs;
    // sRGB, on black by an alpha of 0.2.
    let half = (0.5f32 + 0.055 + 0.5 / 65535.0) / 1.055;
    assert_near(photos[0].color.pixels[0], 0.2 * half.powf(2.4));
    assert_near(photos[0].color.pixels[1], 0.2);
    assert_near(photos[0].mask[0], 0.2);
    for photo in &photos[1..] {
        assert_eq!(photo.color.pixels[..3], [0.5, 4.0, 0.25]);
        assert!(!photo.masked);
    }
}

#[test]
fn pixels_that_are_no_number_are_an_error() {
    let folder = folder_with([40, 30], |_, _| [9, 9, 9, 255]);
    let mut image = image::Rgb32FImage::new(40, 30);
    image.put_pixel(7, 9, image::Rgb([f32::NAN, 0.0, 0.0]));
    let image: image::DynamicImage = image.into();
    image.save(folder.at("images/x.exr")).expect("an image");
    fs::rename(folder.at("images/x.exr"), folder.at("images/000.png")).expect("a file");
    let error = set(&folder).load(&[0], &PhotographOptions::new());
    let error = error.expect_err("an error").to_string();
    assert!(
        error.contains("000.png") && error.contains("(7, 9)"),
        "{error}"
    );
}
