//! Objects that a seed determines, and their images.

use burn::tensor::TensorData;
use glam::{DQuat, DVec3};
use softray::prelude::*;

use super::numbers::Numbers;
use super::render::{Eye, Light, SIZE, Seen, options, scene, see};
use super::shape::Shape;

/// Paths per pixel of the images.
const SAMPLES: u32 = 16;

/// An object with its pose, light and cameras.
#[derive(Clone, Debug)]
pub struct Item {
    pub shape: Shape,
    pub rotation: DQuat,
    pub translation: DVec3,
    /// ColorTexture, RGB.
    pub color: [f64; 3],
    pub light: Light,
    /// The first eye is [`Eye::INPUT`]. The other eyes have random directions.
    pub eyes: Vec<Eye>,
}

impl Item {
    /// Creates the `index`-th item of a seed, with `views` views.
    pub fn new(seed: u64, index: usize, views: usize) -> Self {
        let n = &mut Numbers::new(seed, index as u64);
        let shape = Shape::random(n);
        let yaw = DQuat::from_rotation_y(n.uniform(0.0, std::f64::consts::TAU));
        let rotation = yaw * DQuat::from_rotation_x(n.uniform(-0.4, 0.4));
        let [x, y, z] = n.vector(-1.0, 1.0);
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
            elevation: n.uniform(0.0, 0.6),
        };
        let color = n.vector(0.1, 0.9);
        let mut eyes = vec![Eye::INPUT];
        eyes.extend((1..views).map(|_| other(n)));
        Self {
            shape,
            rotation,
            translation: DVec3::new(0.3 * x, 0.22 * y, 0.15 * z),
            color,
            light,
            eyes,
        }
    }

    /// Returns the item mirrored in x. All shapes are their own mirror images.
    fn mirrored(&self) -> Self {
        let aside = |eye: Eye| Eye {
            azimuth: -eye.azimuth,
            ..eye
        };
        let [x, y, z, w] = self.rotation.to_array();
        Self {
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
    fn mesh(&self, device: &Device) -> Mesh {
        let (vertices, faces) = self.shape.mesh();
        let placed = |v: DVec3| (self.rotation * v + self.translation).to_array();
        let vertices: Vec<[f64; 3]> = vertices.into_iter().map(placed).collect();
        Mesh::from_host(&vertices, faces, device)
    }

    /// Renders the item from its cameras.
    fn see(&self, device: &Device, seed: u64) -> softray::Result<Seen> {
        let scene = scene(self.mesh(device), self.color, &self.light);
        let cameras = self.eyes.iter().map(|eye| eye.camera()).collect();
        let batch = Batch::new(vec![scene], cameras)?;
        see(&batch, &options(SAMPLES).with_seed(seed))
    }
}

/// The images of an item from one of its eyes, on the host.
struct View {
    /// `[H, W, 3]`.
    radiance: Vec<f32>,
    /// `[H, W]`.
    opacity: Vec<f32>,
}

/// Items with their images.
pub struct Dataset {
    /// Items past the number of `views` are mirror images of the first ones.
    pub items: Vec<Item>,
    views: Vec<Vec<View>>,
}

impl Dataset {
    /// Makes items and renders them, without blur, on a device without autodiff.
    pub fn new(
        (name, seed): (&'static str, u64),
        (count, views): (usize, usize),
        device: &Device,
    ) -> softray::Result<Self> {
        let bar = super::common::bar(count as u64, name);
        let mut data = Self {
            items: (0..count).map(|i| Item::new(seed, i, views)).collect(),
            views: Vec::with_capacity(count),
        };
        for (i, item) in data.items.iter().enumerate() {
            let seen = item.see(device, (i * views) as u64)?;
            let host = |v: TensorData| -> Vec<f32> { v.iter::<f32>().collect() };
            let radiance = host(seen.radiance.into_data());
            let opacity = host(seen.opacity.into_data());
            let pixels = SIZE * SIZE;
            let pairs = radiance.chunks(3 * pixels).zip(opacity.chunks(pixels));
            let view = |(radiance, opacity): (&[f32], &[f32])| View {
                radiance: radiance.to_vec(),
                opacity: opacity.to_vec(),
            };
            data.views.push(pairs.map(view).collect());
            bar.inc(1);
        }
        bar.finish_and_clear();
        Ok(data)
    }

    /// Adds the mirror image of every item, which doubles the data without more renders.
    pub fn with_mirrored(mut self) -> Self {
        let mirrored: Vec<Item> = self.items.iter().map(Item::mirrored).collect();
        self.items.extend(mirrored);
        self
    }

    /// Returns the numbers of items and of views per item.
    pub fn counts(&self) -> (usize, usize) {
        (self.items.len(), self.views.first().map_or(0, Vec::len))
    }

    /// Returns the images of (item, eye) pairs as tensors on a device.
    pub fn images(&self, which: &[(usize, usize)], device: &Device) -> Seen {
        let (mut radiance, mut opacity) = (Vec::new(), Vec::new());
        for &(item, eye) in which {
            let rendered = self.views.len();
            let view = &self.views[item % rendered][eye];
            if item < rendered {
                radiance.extend_from_slice(&view.radiance);
                opacity.extend_from_slice(&view.opacity);
            } else {
                for row in view.radiance.chunks(3 * SIZE) {
                    radiance.extend(row.chunks(3).rev().flatten());
                }
                for row in view.opacity.chunks(SIZE) {
                    opacity.extend(row.iter().rev());
                }
            }
        }
        let n = which.len();
        Seen {
            radiance: Tensor::from_data(TensorData::new(radiance, [n, SIZE, SIZE, 3]), device),
            opacity: Tensor::from_data(TensorData::new(opacity, [n, SIZE, SIZE]), device),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Items differ from each other, and do not depend on the length of the data set. Objects are inside the image,
    /// and lamps are outside.
    #[test]
    fn items_are_by_seed_and_in_view() {
        let device = Device::flex();
        let data = Dataset::new(("testing", 3), (6, 3), &device).expect("renders");
        let again = Dataset::new(("testing", 3), (2, 3), &device).expect("renders");
        assert_eq!(data.views[1][2].radiance, again.views[1][2].radiance);
        assert_ne!(data.views[0][0].opacity, data.views[1][0].opacity);
        for view in data.views.iter().flatten() {
            let covered: f32 = view.opacity.iter().sum::<f32>() / (SIZE * SIZE) as f32;
            assert!((0.02..0.5).contains(&covered), "{covered}");
            // A lamp is brighter than anything it lights.
            assert!(view.radiance.iter().all(|&r| r < 4.0));
        }
    }

    /// The render of a mirrored item is the mirrored image, except for noise of light.
    #[test]
    fn mirrored_items_look_mirrored() {
        let device = Device::flex();
        let data = Dataset::new(("testing", 3), (4, 3), &device);
        let data = data.expect("renders").with_mirrored();
        for i in 4..8 {
            let expected = data.images(&[(i, 0), (i, 1), (i, 2)], &device);
            let found = data.items[i].see(&device, 99).expect("renders");
            let apart = |a: Tensor<1>, b: Tensor<1>| (a - b).powi_scalar(2).mean();
            let silhouettes = apart(found.opacity.flatten(0, 2), expected.opacity.flatten(0, 2));
            assert!(silhouettes.into_scalar::<f32>() < 1e-3);
            let (found, expected) = (found.radiance, expected.radiance);
            let still = expected.clone().flip([2]);
            let images = apart(found.clone().flatten(0, 3), expected.flatten(0, 3));
            let images = images.into_scalar::<f32>();
            let unlike = apart(found.flatten(0, 3), still.flatten(0, 3));
            assert!(images < 1e-3, "{images}");
            assert!(images < 0.2 * unlike.into_scalar::<f32>());
        }
    }
}
