//! The ranges of options.

use super::options::{Engine, RenderOptions};
use crate::error::{Error, Result};

/// The maximum number of bounces of a path.
const MAX_BOUNCES: u32 = 10_000;

/// The maximum number of samples per pixel with adaptive sampling.
const MAX_ADAPTIVE_SAMPLES: u32 = 1 << 24;

impl RenderOptions {
    /// Checks that images with `pixels` pixels in total are within the memory limit.
    pub(super) fn check_memory(&self, pixels: u128) -> Result<()> {
        let o = self.outputs;
        let planes = [o.need_opacity(), o.depth].map(u128::from);
        let colors = [true, o.normals, o.albedo].map(u128::from);
        let channels = planes.iter().sum::<u128>() + 3 * colors.iter().sum::<u128>();
        let bytes = 4 * channels * pixels;
        if bytes <= u128::from(self.memory_limit) {
            return Ok(());
        }
        let expected = format!(
            "images within {:.1} GB (RenderOptions::with_memory_limit); they take {:.1} GB",
            self.memory_limit as f64 / 1e9,
            bytes as f64 / 1e9
        );
        Err(self.size_error(expected))
    }

    /// Checks that options without gradients are off, for an image with gradients.
    pub(super) fn check_gradient(&self) -> Result<()> {
        let pass = self.pass.filter(|&(_, passes)| passes > 1);
        let pass = pass.map(|(index, passes)| format!("{index} of {passes}"));
        let clamp = self.indirect_clamp.map(|limit| limit.to_string());
        for (field, value) in [("pass", pass), ("indirect_clamp", clamp)] {
            if let Some(value) = value {
                let expected = "none, since a tensor of the scene or the camera is tracked, so that the image has \
                                gradients";
                return Err(Error::invalid("options", field, value, expected));
            }
        }
        Ok(())
    }

    pub(super) fn size_error(&self, expected: impl Into<String>) -> Error {
        let size = format!("{} × {}", self.width, self.height);
        Error::invalid("options", "width × height", size, expected)
    }

    /// Checks that an image can be rendered with these options, without rendering it: that all values are in their ranges,
    /// and that one image is within the memory limit. A program calls it before it loads a large scene.
    ///
    /// ```
    /// use softray::prelude::*;
    /// assert!(RenderOptions::new(64, 64).check().is_ok());
    /// assert!(RenderOptions::new(65_535, 65_535).check().is_err());
    /// ```
    ///
    /// # Errors
    /// As [`render`](super::render) for these options.
    pub fn check(&self) -> Result<()> {
        self.check_values()?;
        self.check_memory(self.width as u128 * self.height as u128)
    }

    /// Checks that all values are in their ranges.
    pub(crate) fn check_values(&self) -> Result<()> {
        let wrong = |field, value: &dyn ToString, expected: &str| {
            Err(Error::invalid(
                "options",
                field,
                value.to_string(),
                expected,
            ))
        };
        for (field, value) in [
            ("width", self.width),
            ("height", self.height),
            ("samples", self.samples as usize),
            ("rays_per_tile", self.rays_per_tile.unwrap_or(1)),
        ] {
            if value == 0 {
                return wrong(field, &value, "at least 1");
            }
        }
        if self.width.saturating_mul(self.height) > u32::MAX as usize {
            return Err(self.size_error("at most 2³² − 1 pixels"));
        }
        if self.bounces > MAX_BOUNCES {
            let surfaces = u64::from(self.bounces) + 1;
            let most =
                format!("at most {MAX_BOUNCES}; a path would go on for up to {surfaces} surfaces");
            return wrong("bounces", &self.bounces, &most);
        }
        self.form().check()?;
        if let Some(blur) = self.blur
            && self.visibility.is_softmax()
        {
            let expected = "none with the softmax, which has SoftmaxOptions::sigma";
            return wrong("blur", &blur, expected);
        }
        if self.engine == Engine::Kernels && self.visibility.is_softmax() {
            return wrong("engine", &"Kernels", "Auto or Tensors for the softmax");
        }
        if self.adaptive && (self.visibility.is_softmax() || self.engine == Engine::Tensors) {
            let expected = "false for the softmax and Engine::Tensors";
            return wrong("adaptive", &true, expected);
        }
        if self.adaptive && self.samples > MAX_ADAPTIVE_SAMPLES {
            let expected = "at most 2²⁴ with adaptive sampling";
            return wrong("samples", &self.samples, expected);
        }
        if let Some(limit) = self.indirect_clamp {
            if !(1e-30..=1e30).contains(&limit) {
                return wrong("indirect_clamp", &limit, "a radiance from 1e-30 to 1e30");
            }
            if self.visibility.is_softmax() {
                return wrong("indirect_clamp", &limit, "none with the softmax");
            }
        }
        if let Some(least) = self.path_regularization
            && !(least > 0.0 && least <= 1.0)
        {
            return wrong("path_regularization", &least, "a roughness in (0, 1]");
        }
        if let Some((index, passes)) = self.pass {
            let value = format!("{index} of {passes}");
            if index >= passes {
                return wrong("pass", &value, "less than the number of passes");
            }
            if !self.samples.is_multiple_of(passes) {
                let expected = format!("a multiple of the {passes} passes");
                return wrong("samples", &self.samples, &expected);
            }
            if self.adaptive || self.visibility.is_softmax() || self.engine == Engine::Tensors {
                let expected = "none with adaptive sampling, the softmax or Engine::Tensors";
                return wrong("pass", &value, expected);
            }
        }
        Ok(())
    }
}
