//! Objects that a seed determines, and their images.

use burn::tensor::TensorData;
use glam::{DQuat, DVec3};
use softray::meshing::TriangleMesh;
use softray::prelude::*;

use super::numbers::Numbers;
use super::render::{Eye, Light, Seen, options, scene, see};
use super::settings::Settings;
use super::shape::{KINDS, Shape};

/// Paths per pixel of the images.
const SAMPLES: u32 = 16;
/// The radiance that is stored as 255, by its square root. Nothing that a camera sees is brighter.
const BRIGHTEST: f32 = 2.0;

/// An object with its pose, light and cameras.
#[derive(Clone, Debug)]
pub struct Item {
    pub shape: Shape,
    /// Whether the shape is mirrored in x before it is turned.
    pub mirrored: bool,
    pub rotation: DQuat,
    pub translation: DVec3,
    /// Albedo, RGB.
    pub color: [f64; 3],
    pub light: Light,
    /// The first eye is [`Eye::INPUT`]. The other eyes have random directions.
    pub eyes: Vec<Eye>,
}

impl Item {
    /// Creates the `index`-th item of a seed, with `eyes` eyes.
    pub fn new(seed: u64, index: usize, eyes: usize) -> Self {
        let n = &mut Numbers::new(seed, index as u64);
        let shape = Shape::random(n.index(KINDS.len()), n);
        let yaw = DQuat::from_rotation_y(shape.turn * n.uniform(-1.0, 1.0));
        let tilt = DQuat::from_rotation_x(n.uniform(0.0, 0.7));
        let rotation = tilt * yaw * DQuat::from_rotation_z(n.uniform(-0.3, 0.3));
        let power = n.uniform(8.0, 20.0);
        let sky = n.uniform(0.2, 0.5);
        let tint: [f64; 3] = n.vector(0.85, 1.15);
        let light = Light {
            place: Eye {
                azimuth: n.uniform(-1.6, 1.6),
                elevation: n.uniform(0.9, 1.4),
            },
            radiance: tint.map(|t| t * power),
            environment: n.vector(0.85, 1.15).map(|t: f64| t * sky),
        };
        let other = |n: &mut Numbers| Eye {
            azimuth: n.uniform(0.6, std::f64::consts::TAU - 0.6),
            elevation: n.uniform(-0.1, 0.6),
        };
        let color = n.vector(0.1, 0.9);
        let others = (1..eyes).map(|_| other(n));
        let eyes = std::iter::once(Eye::INPUT).chain(others).collect();
        Self {
            shape,
            mirrored: false,
            rotation,
            translation: DVec3::from(n.vector(-0.08, 0.08)),
            color,
            light,
            eyes,
        }
    }

    /// Returns the item mirrored in x.
    fn mirrored(&self) -> Self {
        let aside = |eye: Eye| Eye {
            azimuth: -eye.azimuth,
            ..eye
        };
        let [x, y, z, w] = self.rotation.to_array();
        Self {
            mirrored: true,
            rotation: DQuat::from_xyzw(x, -y, -z, w),
            translation: self.translation * DVec3::new(-1.0, 1.0, 1.0),
            light: Light {
                place: aside(self.light.place),
                ..self.light
            },
            eyes: self.eyes.iter().map(|&eye| aside(eye)).collect(),
            ..self.clone()
        }
    }

    /// Returns the object's mesh in world space.
    pub fn mesh(&self) -> TriangleMesh {
        let mut mesh = self.shape.mesh.clone();
        let x = if self.mirrored { -1.0 } else { 1.0 };
        for position in &mut mesh.positions {
            let p = DVec3::from(*position) * DVec3::new(x, 1.0, 1.0);
            *position = (self.rotation * p + self.translation).to_array();
        }
        if self.mirrored {
            mesh.faces.iter_mut().for_each(|face| face.swap(1, 2));
        }
        mesh
    }

    /// Renders the item from its first `views` eyes.
    pub fn see(
        &self,
        views: usize,
        options: &RenderOptions,
        device: &Device,
    ) -> softray::Result<Seen> {
        let TriangleMesh { positions, faces } = self.mesh();
        let mesh = Mesh::from_host(&positions, faces, device);
        let scene = scene(mesh, self.color, &self.light);
        let cameras = self.eyes[..views].iter().map(|eye| eye.camera()).collect();
        let batch = Batch::new(vec![scene], cameras)?;
        see(&batch, options)
    }
}

/// The images of an item, with 8 bits.
#[derive(PartialEq)]
struct Images {
    /// √(radiance/[`BRIGHTEST`]), `[V, H, W, 3]`.
    radiance: Vec<u8>,
    /// `[V, H, W]`.
    opacity: Vec<u8>,
    /// 128 + 127 × [`Seen::depth`], `[V, H, W]`, if the settings have depth. Objects have depths between −1 and 1.
    depth: Option<Vec<u8>>,
    /// Small silhouettes of all eyes, `[E, S, S]`.
    silhouettes: Vec<u8>,
}

/// Items with their images.
pub struct Dataset {
    /// Items past the number of `images` are mirror images of the first ones.
    pub items: Vec<Item>,
    images: Vec<Images>,
    /// The number of eyes of each item that have images. All eyes have small silhouettes.
    pub views: usize,
    /// Rows and columns of the images.
    pub size: usize,
    /// Rows and columns of small silhouettes.
    small: usize,
}

impl Dataset {
    /// Makes items and renders them, without blur, on a device without autodiff.
    pub fn new(
        (name, seed): (&'static str, u64),
        count: usize,
        settings: &Settings,
        device: &Device,
    ) -> softray::Result<Self> {
        let bar = super::common::bar(count as u64, name);
        let (views, eyes) = (settings.views, settings.silhouettes);
        let mut data = Self {
            items: (0..count).map(|i| Item::new(seed, i, eyes)).collect(),
            images: Vec::with_capacity(count),
            views,
            size: settings.size,
            small: settings.nodes,
        };
        let bytes = |v: TensorData| -> Vec<u8> {
            v.iter::<f32>().map(|v| (v * 255.0).round() as u8).collect()
        };
        for (i, item) in data.items.iter().enumerate() {
            let large = settings.options(data.size, SAMPLES).with_seed(i as u64);
            let seen = item.see(views, &large, device)?;
            let small = options(data.small, SAMPLES).with_seed(i as u64);
            let small = item.see(eyes, &small, device)?.opacity;
            let radiance = (seen.radiance / BRIGHTEST).clamp(0.0, 1.0).sqrt();
            data.images.push(Images {
                radiance: bytes(radiance.into_data()),
                opacity: bytes(seen.opacity.into_data()),
                depth: seen
                    .depth
                    .map(|d| bytes(((d * 127.0 + 128.0) / 255.0).into_data())),
                silhouettes: bytes(small.into_data()),
            });
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(data)
    }

    /// Returns the first `count` items.
    pub fn truncated(mut self, count: usize) -> Self {
        self.items.truncate(count);
        self.images.truncate(count);
        self
    }

    /// Adds the mirror image of every item, which doubles the data without more renders.
    pub fn with_mirrored(mut self) -> Self {
        let mirrored: Vec<Item> = self.items.iter().map(Item::mirrored).collect();
        self.items.extend(mirrored);
        self
    }

    /// Returns the images of (item, eye) pairs as tensors on a device.
    pub fn images(&self, which: &[(usize, usize)], device: &Device) -> Seen {
        let size = self.size;
        let plane = |of: &dyn Fn(&Images) -> &[u8]| {
            let values = self.values(which, [size, 1], of);
            let values = TensorData::new(values, [which.len(), size, size]);
            Tensor::<3>::from_data(values, device)
        };
        let radiance = self.values(which, [size, 3], |images| &images.radiance);
        let radiance = TensorData::new(radiance, [which.len(), size, size, 3]);
        let depth = self.images[0].depth.is_some().then(|| {
            let bytes = plane(&|images| images.depth.as_ref().expect("all images have depth"));
            (bytes * 255.0 - 128.0) / 127.0
        });
        Seen {
            radiance: Tensor::<4>::from_data(radiance, device).powi_scalar(2) * BRIGHTEST,
            opacity: plane(&|images| &images.opacity),
            depth,
        }
    }

    /// Returns the small silhouettes of (item, eye) pairs, `[N, H, W]`.
    pub fn silhouettes(&self, which: &[(usize, usize)], device: &Device) -> Tensor<3> {
        let size = self.small;
        let values = self.values(which, [size, 1], |images| &images.silhouettes);
        Tensor::from_data(TensorData::new(values, [which.len(), size, size]), device)
    }

    /// Returns the values of square images of (item, eye) pairs, from 0 to 1.
    fn values(
        &self,
        which: &[(usize, usize)],
        [size, channels]: [usize; 2],
        of: impl Fn(&Images) -> &[u8],
    ) -> Vec<f32> {
        let rendered = self.images.len();
        let (row, image) = (size * channels, size * size * channels);
        let mut bytes = Vec::with_capacity(which.len() * image);
        for &(item, eye) in which {
            let own = &of(&self.images[item % rendered])[eye * image..][..image];
            if item < rendered {
                bytes.extend_from_slice(own);
            } else {
                for row in own.chunks(row) {
                    bytes.extend(row.chunks(channels).rev().flatten());
                }
            }
        }
        bytes.into_iter().map(|v| f32::from(v) / 255.0).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Items differ from each other, and do not depend on the length of the data set. Objects are inside the image,
    /// and lamps are outside.
    #[test]
    fn items_are_by_seed_and_in_view() {
        let (device, settings) = (Device::flex(), Settings::tiny());
        let make = |count| Dataset::new(("testing", 3), count, &settings, &device);
        let (data, again) = (make(24).expect("renders"), make(2).expect("renders"));
        assert!(data.images[1] == again.images[1] && data.images[0] != data.images[1]);
        let size = settings.size;
        let views = data.images.iter().flat_map(|images| {
            let radiance = images.radiance.chunks(3 * size * size);
            radiance.zip(images.opacity.chunks(size * size))
        });
        for (radiance, opacity) in views {
            let covered = opacity.iter().map(|&v| f64::from(v)).sum::<f64>();
            let covered = covered / 255.0 / (size * size) as f64;
            assert!((0.02..0.5).contains(&covered), "{covered}");
            let border = |i: usize| {
                [i, size - 1 - i]
                    .iter()
                    .any(|p| p % size == 0 || p / size == 0)
            };
            let cut = (0..size * size).filter(|&i| border(i) && opacity[i] > 0);
            assert_eq!(cut.count(), 0);
            // A lamp is brighter than anything it lights.
            assert!(radiance.iter().all(|&r| r < 255));
        }
    }

    /// The render of a mirrored item is the mirrored image, except for noise of light.
    #[test]
    fn mirrored_items_look_mirrored() {
        let device = Device::flex();
        let settings = Settings {
            depth: true,
            ..Settings::tiny()
        };
        let data = Dataset::new(("testing", 3), 4, &settings, &device);
        let data = data.expect("renders").with_mirrored();
        for i in 4..8 {
            let expected = data.images(&[(i, 0), (i, 1)], &device);
            let few = settings.options(data.size, SAMPLES).with_seed(99);
            let found = data.items[i].see(2, &few, &device).expect("renders");
            let apart = |a: Tensor<1>, b: Tensor<1>| (a - b).powi_scalar(2).mean();
            let wanted = expected.opacity.clone().flatten(0, 2);
            let silhouettes = apart(found.opacity.clone().flatten(0, 2), wanted);
            assert!(silhouettes.into_scalar::<f32>() < 2e-3);
            let depths = [&found, &expected].map(|seen| seen.depth.clone().expect("requested"));
            // A pixel at a border may have half of an object's depth.
            let [depth, wanted] = depths.map(|depth| depth.flatten(0, 2));
            assert!(apart(depth, wanted.clone()).into_scalar::<f32>() < 2e-3);
            let empty = expected.opacity.clone().equal_scalar(0).flatten(0, 2);
            let empty = wanted.mask_select(empty).abs().max();
            assert_eq!(empty.into_scalar::<f32>(), 0.0);
            let small = data.silhouettes(&[(i, 0), (i, 1)], &device);
            let shrunk = expected.clone().shrunk(settings.nodes).expect("a size");
            let silhouettes = apart(small.flatten(0, 2), shrunk.opacity.flatten(0, 2));
            assert!(silhouettes.into_scalar::<f32>() < 2e-3);
            let (found, expected) = (found.radiance, expected.radiance);
            let still = expected.clone().flip([2]);
            let images = apart(found.clone().flatten(0, 3), expected.flatten(0, 3));
            let images = images.into_scalar::<f32>();
            let unlike = apart(found.flatten(0, 3), still.flatten(0, 3));
            assert!(images < 2e-3, "{images}");
            assert!(images < 0.2 * unlike.into_scalar::<f32>());
        }
    }
}
