//! The measured points as a table: one row a point, kept as CSV.

use std::fs;
use std::path::Path;
use std::str::FromStr;

use clap::ValueEnum;

use crate::Outcome;
use crate::settings::{Setting, name};

/// What is measured.
#[derive(Clone, Copy, Debug)]
pub enum Column {
    Forward,
    ForwardBackward,
    UnblurredRmse,
    UnblurredBias,
    UnblurredGradient,
    UnblurredCosine,
    UnblurredTranslation,
    UnblurredTranslationCosine,
    BlurredRmse,
    BlurredBias,
    BlurredGradient,
    BlurredCosine,
    BlurredTranslation,
    BlurredTranslationCosine,
    ImageNoise,
    GradientNoise,
    DifferenceNoise,
    LimitRmse,
    LimitGradient,
    LimitTranslation,
    Peak,
}

/// How the columns are headed, in order.
const HEADS: [&str; 21] = [
    "forward [s]",
    "forward + backward [s]",
    "RMSE to unblurred [clipped radiance]",
    "bias to unblurred [radiance]",
    "gradient error to unblurred differences [relative]",
    "gradient cosine to unblurred differences",
    "translation gradient error to unblurred differences [relative]",
    "translation gradient cosine to unblurred differences",
    "RMSE to converged [clipped radiance]",
    "bias to converged [radiance]",
    "gradient error to converged [relative]",
    "gradient cosine to converged",
    "translation gradient error to converged [relative]",
    "translation gradient cosine to converged",
    "standard error of converged image [radiance]",
    "standard error of converged gradient [relative]",
    "standard error of unblurred differences [relative]",
    "RMSE of converged to unblurred [clipped radiance]",
    "gradient error of converged to unblurred differences [relative]",
    "translation gradient error of converged to unblurred differences [relative]",
    "peak memory [MiB]",
];

/// How the columns of settings are headed.
const SETTINGS: [&str; 15] = [
    "scene",
    "bounces",
    "width [pixels]",
    "height [pixels]",
    "faces",
    "sigma [scene units^2]",
    "form:gamma [scene depths]",
    "sampling",
    "cutoff",
    "dtype",
    "device",
    "backward",
    "samples [1/pixel]",
    "seeds",
    "threads",
];

impl Column {
    /// Errors against the image without blur and its differences.
    pub const UNBLURRED: [Self; 6] = [
        Self::UnblurredRmse,
        Self::UnblurredBias,
        Self::UnblurredGradient,
        Self::UnblurredCosine,
        Self::UnblurredTranslation,
        Self::UnblurredTranslationCosine,
    ];
    /// Errors against what the setting converges to.
    pub const BLURRED: [Self; 6] = [
        Self::BlurredRmse,
        Self::BlurredBias,
        Self::BlurredGradient,
        Self::BlurredCosine,
        Self::BlurredTranslation,
        Self::BlurredTranslationCosine,
    ];
}

/// A value for each column, or none.
#[derive(Clone, Debug)]
pub struct Values([f64; HEADS.len()]);

impl Default for Values {
    fn default() -> Self {
        Self([f64::NAN; HEADS.len()])
    }
}

impl Values {
    pub fn set(&mut self, column: Column, value: f64) {
        self.0[column as usize] = value;
    }

    pub fn get(&self, column: Column) -> f64 {
        self.0[column as usize]
    }
}

/// What a scene is, for the reader of a table.
#[derive(Clone, Debug)]
pub struct SceneSize {
    pub scene: String,
    pub bounces: u32,
    pub width: usize,
    pub height: usize,
    pub faces: usize,
}

/// A point.
#[derive(Clone, Debug)]
pub struct Row {
    pub size: SceneSize,
    pub setting: Setting,
    pub samples: u32,
    pub seeds: u32,
    pub threads: usize,
    pub values: Values,
}

impl Row {
    pub fn is(&self, scene: &str, setting: &Setting, samples: u32) -> bool {
        self.size.scene == scene && self.setting == *setting && self.samples == samples
    }

    fn line(&self) -> String {
        let (size, s) = (&self.size, &self.setting);
        let mut cells = vec![
            size.scene.clone(),
            size.bounces.to_string(),
            size.width.to_string(),
            size.height.to_string(),
            size.faces.to_string(),
            format!("{:e}", s.sigma),
            s.form.to_string(),
            name(&s.sampling),
            format!("{:e}", s.cutoff),
            name(&s.dtype),
            s.device.clone(),
            name(&s.backward),
            self.samples.to_string(),
            self.seeds.to_string(),
            self.threads.to_string(),
        ];
        cells.extend(self.values.0.iter().map(|v| {
            if v.is_nan() {
                String::new()
            } else {
                format!("{v:.6e}")
            }
        }));
        cells.join(",")
    }

    fn parse(line: &str) -> Outcome<Self> {
        let mut cells = line.split(',');
        let mut next = || cells.next().ok_or_else(|| format!("too short: {line}"));
        let mut row = Self {
            size: SceneSize {
                scene: next()?.to_owned(),
                bounces: value(next()?)?,
                width: value(next()?)?,
                height: value(next()?)?,
                faces: value(next()?)?,
            },
            setting: Setting {
                sigma: value(next()?)?,
                form: value(next()?)?,
                sampling: named(next()?)?,
                cutoff: value(next()?)?,
                dtype: named(next()?)?,
                device: next()?.to_owned(),
                backward: named(next()?)?,
            },
            samples: value(next()?)?,
            seeds: value(next()?)?,
            threads: value(next()?)?,
            values: Values::default(),
        };
        for v in &mut row.values.0 {
            let cell = next()?;
            if !cell.is_empty() {
                *v = value(cell)?;
            }
        }
        Ok(row)
    }
}

fn value<T: FromStr>(cell: &str) -> Outcome<T> {
    cell.parse().map_err(|_| format!("{cell:?}").into())
}

fn named<T: ValueEnum>(cell: &str) -> Outcome<T> {
    Ok(T::from_str(cell, false)?)
}

fn head() -> String {
    let all: Vec<&str> = SETTINGS.iter().chain(&HEADS).copied().collect();
    all.join(",")
}

/// Writes all rows; the file appears under its name when it is complete.
pub fn write(path: &Path, rows: &[Row]) -> Outcome<()> {
    let mut text = head() + "\n";
    for row in rows {
        text += &row.line();
        text.push('\n');
    }
    write_whole(path, text.as_bytes())
}

/// Reads the rows that [`write`] wrote.
pub fn read(path: &Path) -> Outcome<Vec<Row>> {
    let text = fs::read_to_string(path)?;
    let mut lines = text.lines();
    if lines.next() != Some(&head()) {
        return Err(format!("{}: other columns; measure anew", path.display()).into());
    }
    lines.map(Row::parse).collect()
}

/// Under another name first, so that nobody sees half a file.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Outcome<()> {
    let part = path.with_extension(format!("{}.part", std::process::id()));
    fs::write(&part, bytes)?;
    fs::rename(&part, path)?;
    Ok(())
}
