//! Tests of sets that the tests themselves write.

mod dialects;
mod faults;
mod geometry;
mod loading;
mod sets;

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DMat3, DVec3};

use super::{Distortion, ViewCamera};

/// A folder of one test, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static NUMBER: AtomicUsize = AtomicUsize::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("softray-photographs-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        fs::create_dir_all(&path).expect("a temporary folder");
        Self(path)
    }

    /// Writes a file, and the folders that it lies in.
    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) {
        let path = self.at(name);
        fs::write(path, bytes).expect("a file");
    }

    /// A path in the folder; the folders that it lies in are made.
    fn at(&self, name: &str) -> PathBuf {
        let path = self.0.join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        path
    }

    /// Writes an image of sRGB bytes with alpha.
    fn image(&self, name: &str, size: [u32; 2], color: impl Fn(u32, u32) -> [u8; 4]) {
        let image = image::RgbaImage::from_fn(size[0], size[1], |x, y| image::Rgba(color(x, y)));
        let path = self.at(name);
        let opaque = image.pixels().all(|p| p.0[3] == 255);
        let image = image::DynamicImage::from(image);
        match opaque {
            true => image.to_rgb8().save(path).expect("an image"),
            false => image.save(path).expect("an image"),
        }
    }

    /// Writes images that are all gray.
    fn gray_images(&self, folder: &str, count: usize, size: [u32; 2]) {
        for i in 0..count {
            self.image(&format!("{folder}/{i:03}.png"), size, |_, _| {
                [90, 90, 90, 255]
            });
        }
    }
}

impl AsRef<Path> for Folder {
    fn as_ref(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// The columns and rows of the images of a test's set.
const SIZE: [usize; 2] = [40, 30];

/// The rotation and the translation from world to camera, in the axes of OpenCV, of a camera at a point that looks
/// at another.
fn opencv(eye: DVec3, target: DVec3) -> (DMat3, DVec3) {
    let z = (target - eye).normalize();
    let x = z.cross(DVec3::new(0.1, 1.0, 0.0)).normalize();
    let y = z.cross(x);
    let rotation = DMat3::from_cols(x, y, z).transpose();
    (rotation, -(rotation * eye))
}

/// The positions and targets of a test's cameras.
fn poses() -> Vec<(DMat3, DVec3)> {
    let eyes = [[3.0, 1.0, 2.0], [-2.5, 0.4, 3.0], [0.5, 2.0, -4.0]];
    let target = DVec3::new(0.2, -0.1, 0.3);
    eyes.map(|eye| opencv(DVec3::from(eye), target)).into()
}

/// The cameras of a test, with a given K: made without the code of the library.
fn cameras(focal: [f64; 2], principal: [f64; 2]) -> Vec<ViewCamera> {
    let camera = |(rotation, translation): (DMat3, DVec3)| {
        let r = rotation;
        let eye = -(r.transpose() * translation);
        let (right, down, forward) = (r.row(0), r.row(1), r.row(2));
        ViewCamera {
            to_world: [0, 1, 2].map(|i| [right[i], -down[i], -forward[i], eye[i]]),
            focal,
            principal,
            size: SIZE,
            distortion: Distortion::None,
        }
    };
    poses().into_iter().map(camera).collect()
}

/// Checks that cameras have the same rays at several pixels.
#[track_caller]
fn assert_same_rays(found: &ViewCamera, expected: &ViewCamera) {
    assert_eq!(found.size, expected.size);
    for pixel in [
        [0.5, 0.5],
        [39.5, 0.5],
        [20.0, 15.0],
        [3.5, 29.5],
        [31.0, 8.0],
    ] {
        let [a, b] = [found, expected].map(|c| c.ray(pixel).expect("a ray"));
        let apart = |a: [f64; 3], b: [f64; 3]| DVec3::from(a).distance(b.into());
        assert!(apart(a.0, b.0) < 1e-5, "{:?} {:?}", a.0, b.0);
        assert!(apart(a.1, b.1) < 1e-5, "{pixel:?}: {:?} {:?}", a.1, b.1);
    }
}

/// The bytes of a `.npy` file of floats.
fn npy(shape: &[usize], values: &[f64]) -> Vec<u8> {
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({shape}), }}");
    while (10 + header.len() + 1) % 64 != 0 {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// The bytes of a `.npz` file of matrices `[4, 4]`.
fn npz(matrices: &[(String, Vec<f64>)]) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut zip = zip::ZipWriter::new(&mut bytes);
    let options = zip::write::SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Deflated);
    for (name, values) in matrices {
        zip.start_file(format!("{name}.npy"), options)
            .expect("an entry");
        zip.write_all(&npy(&[4, 4], values)).expect("an array");
    }
    zip.finish().expect("an archive");
    bytes.into_inner()
}
