use std::fs::{self, File};
use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use plotters::prelude::*;

use super::History;
use crate::error::{Error, Result};
use crate::io::write_whole;

const MODULE: &str = "module.bpk";
const OPTIMIZER: &str = "optimizer.bpk";
const HISTORY: &str = "history.csv";
const SETTINGS: &str = "settings.txt";
/// What a folder's name begins with until it is whole.
const PART: &str = ".part-";
/// Checkpoints that are kept.
const KEPT: usize = 2;

/// Checkpoints of a fit, in folders by the number of steps taken. A folder gets its name when all that
/// is in it has reached the disk, so that what has a name is whole.
pub(super) struct Checkpoints {
    folder: PathBuf,
    inside: PathBuf,
}

/// A checkpoint that was found.
pub(super) struct Checkpoint {
    folder: PathBuf,
    pub history: History,
}

impl Checkpoints {
    /// In a folder, which is made if need be; what a killed run left unfinished is removed, and on a
    /// restart all checkpoints are.
    pub fn open(folder: &Path, restart: bool) -> Result<Self> {
        let inside = folder.join("checkpoints");
        fs::create_dir_all(&inside).map_err(|e| io(&inside, e))?;
        for (name, path) in entries(&inside)? {
            let whole = name.parse::<usize>().is_ok();
            if name.starts_with(PART) || (restart && whole) {
                fs::remove_dir_all(&path).map_err(|e| io(&path, e))?;
            }
        }
        Ok(Self {
            folder: folder.into(),
            inside,
        })
    }

    /// In their order, by the number of steps taken.
    fn all(&self) -> Result<Vec<(usize, PathBuf)>> {
        let mut all: Vec<(usize, PathBuf)> = entries(&self.inside)?
            .into_iter()
            .filter_map(|(name, path)| Some((name.parse().ok()?, path)))
            .collect();
        all.sort();
        Ok(all)
    }

    /// The newest, if there is one.
    pub fn newest(&self, settings: &str) -> Result<Option<Checkpoint>> {
        let Some((steps, folder)) = self.all()?.pop() else {
            return Ok(None);
        };
        let read = |name: &str| {
            let path = folder.join(name);
            fs::read_to_string(&path).map_err(|e| io(&path, e))
        };
        let found = read(SETTINGS)?;
        if found != settings {
            return Err(Error::invalid(
                "fit",
                format!("settings of the checkpoint {}", folder.display()),
                format!("{found:?}"),
                format!("{settings:?}; take the same, another folder, or remove it"),
            ));
        }
        let wrong = |message| Error::format(folder.join(HISTORY), message);
        let history = History::from_csv(&read(HISTORY)?).map_err(wrong)?;
        if history.rows.len() != steps {
            return Err(wrong(format!(
                "it has {} steps, expected {steps}",
                history.rows.len()
            )));
        }
        Ok(Some(Checkpoint { folder, history }))
    }

    /// Adds one, and drops old ones.
    pub fn write<M: Module>(
        &self,
        module: &M,
        optimizer: &ModuleOptimizer,
        history: &History,
        settings: &str,
    ) -> Result<()> {
        let name = format!("{:08}", history.rows.len());
        let part = self.inside.join(format!("{PART}{name}"));
        if part.exists() {
            fs::remove_dir_all(&part).map_err(|e| io(&part, e))?;
        }
        fs::create_dir(&part).map_err(|e| io(&part, e))?;
        let at = |file: &str| part.join(file);
        let store = |file: &str, error: burn::store::RecordError| {
            Error::format(at(file), error.to_string())
        };
        let saved = module.clone().save_file(at(MODULE));
        saved.map_err(|e| store(MODULE, e))?;
        let saved = optimizer.save(at(OPTIMIZER));
        saved.map_err(|e| store(OPTIMIZER, e))?;
        fs::write(at(HISTORY), history.to_csv()).map_err(|e| io(&at(HISTORY), e))?;
        fs::write(at(SETTINGS), settings).map_err(|e| io(&at(SETTINGS), e))?;
        for file in [MODULE, OPTIMIZER, HISTORY, SETTINGS] {
            sync(&at(file))?;
        }
        let whole = self.inside.join(name);
        fs::rename(&part, &whole).map_err(|e| io(&whole, e))?;
        sync(&self.inside)?;
        let all = self.all()?;
        for (_, old) in &all[..all.len().saturating_sub(KEPT)] {
            // Renamed first, so that a kill in between leaves nothing that looks whole.
            let gone = self.inside.join(format!("{PART}old"));
            let removed = fs::rename(old, &gone).and_then(|()| fs::remove_dir_all(&gone));
            removed.map_err(|e| io(old, e))?;
        }
        self.report(history)
    }

    fn report(&self, history: &History) -> Result<()> {
        write_whole(&self.folder.join(HISTORY), history.to_csv().as_bytes())
    }

    /// The history, and its loss as a plot.
    pub fn finish(&self, history: &History) -> Result<()> {
        self.report(history)?;
        let path = self.folder.join("loss.svg");
        let svg = plot(history).map_err(|e| Error::format(&path, e))?;
        write_whole(&path, svg.as_bytes())
    }
}

impl Checkpoint {
    /// A module with its parameters.
    pub fn module<M: Module>(&self, module: M) -> Result<M> {
        let path = self.folder.join(MODULE);
        let found = module.try_load_file(&path);
        found.map_err(|e| Error::format(path, e.to_string()))
    }

    /// An optimiser with its state.
    pub fn optimizer(&self, optimizer: ModuleOptimizer) -> Result<ModuleOptimizer> {
        let path = self.folder.join(OPTIMIZER);
        let found = optimizer.load(&path);
        found.map_err(|e| Error::format(path, e.to_string()))
    }
}

fn io(path: &Path, source: std::io::Error) -> Error {
    Error::Io {
        path: path.into(),
        source,
    }
}

fn entries(folder: &Path) -> Result<Vec<(String, PathBuf)>> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).map_err(|e| io(folder, e))? {
        let entry = entry.map_err(|e| io(folder, e))?;
        all.push((
            entry.file_name().to_string_lossy().into_owned(),
            entry.path(),
        ));
    }
    Ok(all)
}

/// Waits until a file or folder has reached the disk.
fn sync(path: &Path) -> Result<()> {
    let file = File::open(path).map_err(|e| io(path, e))?;
    match file.sync_all() {
        // Folders can't be opened for this everywhere.
        Err(e) if path.is_file() => Err(io(path, e)),
        _ => Ok(()),
    }
}

/// |loss| over the steps, logarithmic, as an SVG.
fn plot(history: &History) -> std::result::Result<String, String> {
    let mut svg = String::new();
    let points: Vec<(f64, f64)> = history
        .curve("loss")
        .into_iter()
        .map(|(x, y)| (x, y.abs()))
        .filter(|p| p.1 > 0.0)
        .collect();
    let low = points.iter().map(|p| p.1).fold(f64::INFINITY, f64::min);
    let high = points.iter().map(|p| p.1).fold(0.0, f64::max);
    let (low, high) = if low < high {
        (low, high)
    } else {
        (0.5 * high.max(1e-30), 2.0 * high.max(1e-30))
    };
    let steps = history.rows.len().max(1) as f64;
    let mut draw = || -> std::result::Result<(), Box<dyn std::error::Error>> {
        let area = SVGBackend::with_string(&mut svg, (640, 360)).into_drawing_area();
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&area)
            .margin(12)
            .x_label_area_size(36)
            .y_label_area_size(64)
            .build_cartesian_2d(0.0..steps, (low..high).log_scale())?;
        chart
            .configure_mesh()
            .x_desc("step")
            .y_desc("|loss|")
            .y_label_formatter(&|y| format!("{y:.0e}"))
            .draw()?;
        chart.draw_series(LineSeries::new(points.clone(), &BLUE))?;
        area.present()?;
        Ok(())
    };
    let drawn = draw().map_err(|e| e.to_string());
    drawn.map(|()| svg)
}
