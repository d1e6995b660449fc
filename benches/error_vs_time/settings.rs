//! What is varied: a base and, for each axis, the base with one thing changed.

use std::fmt;
use std::str::FromStr;

use burn::tensor::{DType, Device};
use clap::ValueEnum;
use softray::prelude::*;

/// One way to render.
#[derive(Clone, Debug, PartialEq)]
pub struct Setting {
    pub sigma: f64,
    pub form: Form,
    pub sampling: Sampler,
    pub cutoff: f64,
    pub dtype: Float,
    pub device: String,
    pub backward: Backward,
}

/// What can be varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Axis {
    Sigma,
    Form,
    Sampling,
    Cutoff,
    Dtype,
    Device,
    Backward,
}

/// A form of visibility with its γ: `layered`, `layered-soft:1e-2`, `softmax:1e-3`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    Layered,
    LayeredSoft(f64),
    Softmax(f64),
}

/// A way to sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Sampler {
    /// `Sampling::default()`.
    Default,
    /// `Sampling::plain()`, the paper's.
    Plain,
    /// The default with the sequence of the paper: independent numbers.
    PlainSequence,
    /// The default with emitters chosen as in the paper: all alike.
    PlainEmitters,
    /// The default with surfaces chosen as in the paper: one drawn.
    PlainSurfaces,
    /// The default without multiple importance sampling.
    WithoutMis,
}

/// A float type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Float {
    F32,
    F64,
}

/// How gradients are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Backward {
    /// The backward pass traces the paths again (`RenderOptions::replay`).
    Replay,
    /// The paths are on a tape, whose memory grows with the samples.
    Tape,
}

/// A value as it is written on the command line and in tables.
pub fn name(value: &impl ValueEnum) -> String {
    value
        .to_possible_value()
        .map_or_else(String::new, |v| v.get_name().to_owned())
}

impl Setting {
    /// On the device and in the float type of the scene.
    pub fn options(&self, width: usize, height: usize) -> RenderOptions {
        let options = RenderOptions::new(width, height)
            .sigma(self.sigma)
            .visibility(self.form.visibility())
            .sampling(self.sampling.sampling())
            .cutoff(self.cutoff);
        match self.backward {
            Backward::Replay => options.replay(),
            Backward::Tape => options,
        }
    }

    pub fn device(&self) -> softray::Result<Device> {
        softray::device::named(Some(&self.device))
    }

    /// How far from a triangle a ray still meets it, scene units.
    pub fn reach(&self) -> f64 {
        let depth = match self.form {
            Form::Softmax(gamma) => gamma.recip(),
            Form::Layered | Form::LayeredSoft(_) => 0.0,
        };
        (self.sigma * (self.cutoff.recip().ln() + depth)).sqrt()
    }

    /// What of it is not like another one, by axis.
    fn differences(&self, other: &Self) -> Vec<(Axis, String)> {
        let mut all = Vec::new();
        let mut add = |same: bool, axis, text: String| {
            if !same {
                all.push((axis, text));
            }
        };
        let sampling = format!("{} sampling", name(&self.sampling));
        let sigma = format!("σ {:e}", self.sigma);
        add(self.sigma == other.sigma, Axis::Sigma, sigma);
        add(self.form == other.form, Axis::Form, self.form.label());
        add(self.sampling == other.sampling, Axis::Sampling, sampling);
        let cutoff = format!("cutoff {:e}", self.cutoff);
        add(self.cutoff == other.cutoff, Axis::Cutoff, cutoff);
        add(self.dtype == other.dtype, Axis::Dtype, name(&self.dtype));
        let device = self.device.clone();
        add(self.device == other.device, Axis::Device, device);
        let backward = name(&self.backward);
        add(self.backward == other.backward, Axis::Backward, backward);
        all
    }

    /// In words, beside a base.
    pub fn label(&self, base: &Self) -> String {
        let words: Vec<String> = self.differences(base).into_iter().map(|d| d.1).collect();
        if words.is_empty() {
            format!(
                "base: σ {:e}, {}, {} sampling",
                base.sigma,
                base.form.label(),
                name(&base.sampling)
            )
        } else {
            words.join(", ")
        }
    }

    /// Whether it converges to the same image and gradient, up to cutoff and rounding.
    pub fn same_limit(&self, other: &Self) -> bool {
        self.sigma == other.sigma && self.form == other.form
    }

    /// The axis along which it differs from a base, if it is one.
    pub fn axis(&self, base: &Self) -> Option<Axis> {
        match self.differences(base).as_slice() {
            [(axis, _)] => Some(*axis),
            _ => None,
        }
    }
}

impl Form {
    pub fn visibility(self) -> Visibility {
        match self {
            Self::Layered => Visibility::Layered,
            Self::LayeredSoft(gamma) => Visibility::LayeredSoft { gamma },
            Self::Softmax(gamma) => Visibility::softmax(gamma),
        }
    }

    pub fn label(self) -> String {
        match self {
            Self::Layered => "layered".to_owned(),
            Self::LayeredSoft(gamma) => format!("layered-soft γ {gamma:e}"),
            Self::Softmax(gamma) => format!("softmax γ {gamma:e}"),
        }
    }
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Layered => f.write_str("layered"),
            Self::LayeredSoft(gamma) => write!(f, "layered-soft:{gamma:e}"),
            Self::Softmax(gamma) => write!(f, "softmax:{gamma:e}"),
        }
    }
}

impl FromStr for Form {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (form, gamma) = text.split_once(':').unwrap_or((text, ""));
        let gamma = || {
            let wanted = || format!("`{form}` needs a γ, like in `{form}:1e-3`");
            gamma.parse::<f64>().map_err(|_| wanted())
        };
        match form {
            "layered" => Ok(Self::Layered),
            "layered-soft" => Ok(Self::LayeredSoft(gamma()?)),
            "softmax" => Ok(Self::Softmax(gamma()?)),
            _ => Err("layered, layered-soft:γ or softmax:γ was expected".to_owned()),
        }
    }
}

impl Sampler {
    pub fn sampling(self) -> Sampling {
        let plain = Sampling::plain();
        let mut sampling = Sampling::default();
        match self {
            Self::Default => (),
            Self::Plain => return plain,
            Self::PlainSequence => sampling.sequence = plain.sequence,
            Self::PlainEmitters => sampling.emitters = plain.emitters,
            Self::PlainSurfaces => sampling.surfaces = plain.surfaces,
            Self::WithoutMis => sampling.multiple_importance = plain.multiple_importance,
        }
        sampling
    }
}

impl Float {
    pub fn dtype(self) -> DType {
        match self {
            Self::F32 => DType::F32,
            Self::F64 => DType::F64,
        }
    }
}
