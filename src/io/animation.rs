//! Writes animations as GIF files.

use std::path::Path;

use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, RgbaImage};

use super::HostImage;
use super::whole::{ending, write_whole};
use crate::error::{Error, Result};
use crate::render::{Batch, RenderOptions, render_batch};
use crate::scene::{Camera, Detach, Scene, visit_camera, visit_scene};

/// The speed of the search for the 256 colors of a frame, from 1 (best) to 30 (fastest).
const QUANTIZER_SPEED: i32 = 3;

/// GIF measures time in hundredths of a second.
const TICKS_PER_SECOND: f64 = 100.0;

/// An animation: frames that are shown in sequence, in a loop.
///
/// ```no_run
/// # use softray::prelude::*;
/// use softray::io::Animation;
/// # let device = Device::flex();
/// # let scene = Scene::new().with_object(Object::new(shapes::cube(&device))).with_environment([1.0; 3]);
/// // A turntable: the camera goes once about the y axis.
/// let cameras = (0..48).map(|i| {
///     let (sin, cos) = (f64::from(i) / 48.0 * std::f64::consts::TAU).sin_cos();
///     Camera::look_at([4.0 * sin, 2.0, 4.0 * cos], [0.0, 0.0, 0.0])
/// });
/// let options = RenderOptions::new(256, 256).with_samples(64);
/// Animation::render(&scene, cameras, &options)?.write("turntable.gif")?;
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Animation {
    frames: Vec<HostImage>,
    frames_per_second: f64,
}

impl Animation {
    /// Creates an animation from linear RGB images, with 25 frames per second.
    ///
    /// # Errors
    /// If there are no images, or their sizes differ.
    pub fn new(frames: Vec<HostImage>) -> Result<Self> {
        let Some(first) = frames.first() else {
            let expected = "at least one";
            return Err(Error::invalid("animation", "frames", "empty", expected));
        };
        let size = |i: &HostImage| format!("{} × {}", i.width, i.height);
        for (k, frame) in frames.iter().enumerate() {
            frame.check_size()?;
            if (frame.width, frame.height) != (first.width, first.height) {
                return Err(Error::invalid(
                    "animation",
                    format!("size of frame {k}"),
                    size(frame),
                    format!("{} like the first", size(first)),
                ));
            }
        }
        Ok(Self {
            frames,
            frames_per_second: 25.0,
        })
    }

    /// Renders a scene from each camera, for example as a turntable.
    ///
    /// Nothing is recorded for gradients. Every frame has its own random numbers ([`RenderOptions::of_view`]).
    ///
    /// # Errors
    /// As [`render_batch`], or if there is no camera.
    pub fn render(
        scene: &Scene,
        cameras: impl IntoIterator<Item = Camera>,
        options: &RenderOptions,
    ) -> Result<Self> {
        let mut scene = scene.clone();
        visit_scene(&mut scene, &mut Detach);
        let detached = cameras.into_iter().map(|mut camera| {
            visit_camera(&mut camera, &mut Detach);
            (0, camera)
        });
        let batch = Batch::views(vec![scene], detached.collect())?;
        let radiance = render_batch(&batch, options)?.radiance;
        let frames = radiance.iter_dim(0);
        let frames = frames.map(|frame| HostImage::take(frame.squeeze_dim::<3>(0)));
        Self::new(frames.collect::<Result<_>>()?)
    }

    /// Sets the number of frames per second, in (0, 50].
    pub fn with_frames_per_second(mut self, frames_per_second: f64) -> Self {
        self.frames_per_second = frames_per_second;
        self
    }

    /// Returns the frames.
    pub fn frames(&self) -> &[HostImage] {
        &self.frames
    }

    /// Writes a `.gif` that loops forever, in sRGB clipped to [0, 1], with 256 colors for each frame.
    ///
    /// Each frame lasts a whole number of hundredths of a second. If 100 is not a multiple of the frame rate, some
    /// frames last one hundredth longer than others, so that the average rate is kept. The file appears under its
    /// name only when it is complete.
    ///
    /// # Errors
    /// If the extension is another one, the rate is out of range, frames have more than 65,535 columns or rows, or
    /// the file cannot be written.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<()> {
        self.write_file(path.as_ref())
    }

    fn write_file(&self, path: &Path) -> Result<()> {
        ending(path, &["gif"])?;
        let rate = self.frames_per_second;
        // Viewers show frames of less than two hundredths for ten hundredths.
        let valid = rate > 0.0 && rate <= 50.0;
        let field = "frames_per_second";
        Error::unless(valid, "animation", field, rate, "a number in (0, 50]")?;
        let [w, h] = self.frames[0].check_size()?;
        let valid = w.max(h) <= u32::from(u16::MAX);
        let size = format!("{w} × {h}");
        let expected = "at most 65535 columns and rows";
        Error::unless(valid, "animation", "size", size, expected)?;
        let encoded = |e| Error::format(path, format!("it can't be written: {e}"));
        write_whole(path, |file| {
            let mut encoder = GifEncoder::new_with_speed(file, QUANTIZER_SPEED);
            encoder.set_repeat(Repeat::Infinite).map_err(encoded)?;
            for (index, image) in self.frames.iter().enumerate() {
                let duration = Delay::from_numer_denom_ms(10 * ticks(index, rate), 1);
                let frame = Frame::from_parts(as_rgba(image)?, 0, 0, duration);
                encoder.encode_frame(frame).map_err(encoded)?;
            }
            Ok(())
        })
    }
}

/// Returns the duration of a frame in hundredths of a second, rounded so that the average rate is kept.
fn ticks(frame: usize, rate: f64) -> u32 {
    let end = |frame: usize| (frame as f64 * TICKS_PER_SECOND / rate).round();
    // The longest duration in a GIF.
    (end(frame + 1) - end(frame)).min(f64::from(u16::MAX)) as u32
}

fn as_rgba(image: &HostImage) -> Result<RgbaImage> {
    let [w, h] = image.check_size()?;
    let bytes = image.to_srgb();
    let opaque = bytes.chunks_exact(3).flat_map(|c| [c[0], c[1], c[2], 255]);
    RgbaImage::from_raw(w, h, opaque.collect()).ok_or_else(|| {
        let size = format!("{w} × {h}");
        Error::invalid("animation", "size", size, "as many pixels as values")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_add_up_to_the_rate() {
        let of = |rate: f64, frames: usize| (0..frames).map(|k| ticks(k, rate)).collect::<Vec<_>>();
        assert_eq!(of(25.0, 3), [4, 4, 4]);
        assert_eq!(of(30.0, 30).iter().sum::<u32>(), 100);
        assert!(of(30.0, 30).iter().all(|t| (3..=4).contains(t)));
        assert_eq!(of(1e-9, 1), [u32::from(u16::MAX)]);
    }
}
