//! What the page's worker calls: the search for the caster of a shadow, derivative images, and the view of a file.
//!
//! Images are RGBA bytes for a canvas, row by row from the top. Errors become JavaScript's, with the crate's sentence.

mod room;
mod search;
mod view;
#[cfg(feature = "webgpu")]
mod webgpu;

use softray::prelude::*;
use wasm_bindgen::prelude::*;

pub use room::Room;
pub use search::Search;
pub use view::View;

/// Sends messages of panics to the browser's console.
#[wasm_bindgen(start)]
pub fn start() {
    console_error_panic_hook::set_once();
    softray::show_warnings(false);
}

/// Whether the program was compiled for vectors of 128 bits.
#[wasm_bindgen]
pub fn has_simd() -> bool {
    cfg!(target_feature = "simd128")
}

/// Returns an image as RGBA bytes.
fn rgba(image: &HostImage) -> Vec<u8> {
    let bytes = image.to_srgb();
    let opaque = |rgb: &[u8]| [rgb[0], rgb[1], rgb[2], 255];
    bytes.chunks_exact(3).flat_map(opaque).collect()
}

/// The sum of the passes over an image that is refined.
#[derive(Default)]
struct Refined {
    sum: Vec<f32>,
    size: [usize; 2],
    passes: u32,
}

/// The passes over an image.
const PASSES: u32 = 128;

impl Refined {
    /// Renders the next pass with a path a pixel, and returns the mean of all passes so far; `None` after the last pass. An
    /// image of another size starts anew.
    fn refine(
        &mut self,
        scene: &Scene,
        camera: &Camera,
        options: &RenderOptions,
    ) -> softray::Result<Option<HostImage>> {
        let size = [options.width, options.height];
        if self.size != size {
            *self = Self {
                sum: vec![0.0; 3 * size[0] * size[1]],
                size,
                passes: 0,
            };
        }
        if self.passes == PASSES {
            return Ok(None);
        }
        let options = options.clone().with_samples(PASSES);
        let image = render(scene, camera, &options.with_pass(self.passes, PASSES))?;
        let image = HostImage::from_tensor(&image.radiance)?;
        for (sum, value) in self.sum.iter_mut().zip(image.pixels) {
            *sum += value;
        }
        self.passes += 1;
        let [width, height] = self.size;
        let passes = self.passes as f32;
        let means = self.sum.iter().map(|v| v / passes).collect();
        HostImage::new(width, height, means).map(Some)
    }
}
