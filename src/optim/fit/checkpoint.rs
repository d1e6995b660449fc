use std::fs::{self, File, TryLockError};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::store::RecordError;

use super::settings::check_settings;
use super::{History, Warning};
use crate::error::{Error, Result};
use crate::io::write_whole;

const MODULE: &str = "module.bpk";
/// The module with averaged parameters, where a fit has one.
pub(super) const AVERAGE: &str = "average.bpk";
const OPTIMIZER: &str = "optimizer.bpk";
const HISTORY: &str = "history.csv";
const SETTINGS: &str = "settings.txt";
/// The file with the checksum and length of every other file.
const CHECKSUMS: &str = "checksums.txt";
/// The file that a fitting process locks.
const LOCK: &str = "lock";
/// The prefix of a folder's name until the folder is complete.
const PART: &str = ".part-";
/// The number of checkpoints that are kept.
const KEPT: usize = 2;

/// Writes a module to a file.
type Save<'a> = &'a dyn Fn(PathBuf) -> std::result::Result<(), RecordError>;

/// Checkpoints of a fit, in folders named by the number of steps taken. A folder gets its name after all of its
/// files have reached the disk, so a folder with such a name is complete.
pub(super) struct Checkpoints {
    folder: PathBuf,
    inside: PathBuf,
    /// The lock, held until this is dropped.
    _lock: File,
}

/// A checkpoint read from disk.
pub(super) struct Checkpoint {
    folder: PathBuf,
    settings: String,
    pub history: History,
}

impl Checkpoints {
    /// Opens a folder of checkpoints and creates it if it does not exist. Removes checkpoints that a killed run
    /// left incomplete, and all checkpoints on a restart.
    pub fn open(folder: &Path, restart: bool, warn: &mut dyn FnMut(Warning)) -> Result<Self> {
        let inside = folder.join("checkpoints");
        fs::create_dir_all(&inside).map_err(Error::io(&inside))?;
        let lock = lock(&folder.join(LOCK), folder, warn)?;
        for (name, path) in entries(&inside)? {
            let whole = name.parse::<usize>().is_ok();
            if name.starts_with(PART) || (restart && whole) {
                fs::remove_dir_all(&path).map_err(Error::io(&path))?;
            }
        }
        Ok(Self {
            folder: folder.into(),
            inside,
            _lock: lock,
        })
    }

    /// Returns all checkpoints, ordered by the number of steps taken.
    fn list(&self) -> Result<Vec<(usize, PathBuf)>> {
        let all = entries(&self.inside)?.into_iter();
        let all = all.filter_map(|(name, path)| Some((name.parse().ok()?, path)));
        let mut all: Vec<(usize, PathBuf)> = all.collect();
        all.sort();
        Ok(all)
    }

    /// Reads the newest undamaged checkpoint, if there is one, and warns about damaged ones. An error if all
    /// are damaged.
    pub fn newest(
        &self,
        settings: &str,
        warn: &mut dyn FnMut(Warning),
    ) -> Result<Option<Checkpoint>> {
        let mut damaged = None;
        for (steps, folder) in self.list()?.into_iter().rev() {
            match Checkpoint::read(steps, &folder) {
                Ok(checkpoint) => {
                    let folder = checkpoint.folder.display().to_string();
                    check_settings(&folder, &checkpoint.settings, settings)?;
                    return Ok(Some(checkpoint));
                }
                Err(error) => {
                    warn(Warning::DamagedCheckpoint(error.to_string()));
                    damaged.get_or_insert(error);
                }
            }
        }
        // Starting anew would discard checkpoints that a user may want to repair.
        damaged.map_or(Ok(None), Err)
    }

    /// Writes a checkpoint and removes old ones.
    pub fn write<M: Module>(
        &self,
        (module, average): (&M, Option<&M>),
        optimizer: &ModuleOptimizer,
        history: &History,
        settings: &str,
    ) -> Result<()> {
        let module = |path: PathBuf| module.clone().save_file(path);
        let average = average.map(|average| |path: PathBuf| average.clone().save_file(path));
        let mut modules: Vec<(&str, Save<'_>)> = vec![(MODULE, &module)];
        modules.extend(average.iter().map(|save| (AVERAGE, save as Save<'_>)));
        self.write_all(&modules, optimizer, history, settings)
    }

    fn write_all(
        &self,
        modules: &[(&str, Save<'_>)],
        optimizer: &ModuleOptimizer,
        history: &History,
        settings: &str,
    ) -> Result<()> {
        let name = format!("{:08}", history.rows.len());
        let part = self.inside.join(format!("{PART}{name}"));
        if part.exists() {
            fs::remove_dir_all(&part).map_err(Error::io(&part))?;
        }
        fs::create_dir(&part).map_err(Error::io(&part))?;
        let at = |file: &str| part.join(file);
        let failed = |e: RecordError| Error::format(&part, e.to_string());
        for (file, save) in modules {
            save(at(file)).map_err(failed)?;
        }
        optimizer.save(at(OPTIMIZER)).map_err(failed)?;
        fs::write(at(HISTORY), history.to_csv()).map_err(Error::io(&at(HISTORY)))?;
        fs::write(at(SETTINGS), settings).map_err(Error::io(&at(SETTINGS)))?;
        let mut files: Vec<&str> = modules.iter().map(|(file, _)| *file).collect();
        files.extend(FILES);
        let sums = files.iter().map(|file| checksum(&part, file));
        let sums = sums.collect::<Result<String>>()?;
        fs::write(at(CHECKSUMS), sums).map_err(Error::io(&at(CHECKSUMS)))?;
        for file in files.into_iter().chain([CHECKSUMS]) {
            sync(&at(file))?;
        }
        let whole = self.inside.join(name);
        fs::rename(&part, &whole).map_err(Error::io(&whole))?;
        sync(&self.inside)?;
        let all = self.list()?;
        for (_, old) in &all[..all.len().saturating_sub(KEPT)] {
            // The folder is renamed first, so that a kill in between leaves no folder that looks complete.
            let gone = self.inside.join(format!("{PART}old"));
            let removed = fs::rename(old, &gone).and_then(|()| fs::remove_dir_all(&gone));
            removed.map_err(Error::io(old))?;
        }
        self.report(history)
    }

    fn report(&self, history: &History) -> Result<()> {
        let path = self.folder.join(HISTORY);
        let csv = history.to_csv();
        write_whole(&path, |file| {
            file.write_all(csv.as_bytes()).map_err(Error::io(&path))
        })
    }

    /// Writes the history and its plots.
    pub fn finish(&self, history: &History) -> Result<()> {
        self.report(history)?;
        history.figure().write(self.folder.join("history.png"))
    }
}

impl Checkpoint {
    /// Reads the checkpoint after `steps` steps. An error if one of its files does not match its checksum.
    fn read(steps: usize, folder: &Path) -> Result<Self> {
        let read = |name: &str| {
            let path = folder.join(name);
            fs::read_to_string(&path).map_err(Error::io(&path))
        };
        let sums = read(CHECKSUMS)?;
        let average = sums.contains(AVERAGE).then_some(AVERAGE);
        for file in [MODULE].into_iter().chain(average).chain(FILES) {
            let sum = checksum(folder, file)?;
            if !sums.split_inclusive('\n').any(|line| line == sum) {
                let message = "it is not what was written";
                return Err(Error::format(folder.join(file), message));
            }
        }
        let wrong = |message| Error::format(folder.join(HISTORY), message);
        let history = History::from_csv(&read(HISTORY)?).map_err(wrong)?;
        let found = history.rows.len();
        if found != steps {
            return Err(wrong(format!("it has {found} steps, expected {steps}")));
        }
        Ok(Self {
            folder: folder.into(),
            settings: read(SETTINGS)?,
            history,
        })
    }

    /// Loads the parameters into a module and the state into an optimizer.
    pub fn load<M: Module>(
        &self,
        module: M,
        optimizer: ModuleOptimizer,
    ) -> Result<(M, ModuleOptimizer)> {
        let module = self.load_module(MODULE, module)?;
        let at_optimizer = self.folder.join(OPTIMIZER);
        let optimizer = optimizer.load(&at_optimizer);
        let optimizer = optimizer.map_err(|e| Error::format(at_optimizer, e.to_string()))?;
        Ok((module, optimizer))
    }

    /// Loads the parameters of a file into a module.
    pub fn load_module<M: Module>(&self, file: &str, module: M) -> Result<M> {
        let path = self.folder.join(file);
        let module = module.try_load_file(&path);
        module.map_err(|e| Error::format(path, e.to_string()))
    }
}

/// The files of a checkpoint, except for those of modules and the file of checksums.
const FILES: [&str; 3] = [OPTIMIZER, HISTORY, SETTINGS];

/// Returns a line with the CRC-32 of a file, its length, and its name.
fn checksum(folder: &Path, file: &str) -> Result<String> {
    let path = folder.join(file);
    let bytes = fs::read(&path).map_err(Error::io(&path))?;
    let (sum, length) = (crc32fast::hash(&bytes), bytes.len());
    Ok(format!("{sum:08x} {length} {file}\n"))
}

/// Locks a file for as long as it stays open; the system unlocks it if the process is killed.
fn lock(path: &Path, folder: &Path, warn: &mut dyn FnMut(Warning)) -> Result<File> {
    let file = File::create(path).map_err(Error::io(path))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(Error::format(
            folder,
            "another process is fitting in this folder; take another one, or wait for its end",
        )),
        Err(TryLockError::Error(source)) if source.kind() == ErrorKind::Unsupported => {
            warn(Warning::NoLock(path.into()));
            Ok(file)
        }
        Err(TryLockError::Error(source)) => Err(Error::io(path)(source)),
    }
}

fn entries(folder: &Path) -> Result<Vec<(String, PathBuf)>> {
    let all = fs::read_dir(folder).map_err(Error::io(folder))?;
    let all = all.map(|entry| {
        let entry = entry.map_err(Error::io(folder))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        Ok((name, entry.path()))
    });
    all.collect()
}

/// Waits until a file or folder has reached the disk.
fn sync(path: &Path) -> Result<()> {
    let file = File::open(path).map_err(Error::io(path))?;
    match file.sync_all() {
        // Some systems cannot open folders for this.
        Err(e) if path.is_file() => Err(Error::io(path)(e)),
        _ => Ok(()),
    }
}
