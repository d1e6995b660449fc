//! A set of photographs with their cameras.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::area::limited;
use super::draft::Drafts;
use super::folder::names_below;
use super::load::load;
use super::photograph::PIXEL_BYTES;
use super::settle::settle;
use super::{
    Dialect, Photograph, PhotographOptions, Region, Split, View, colmap, llff, neus, transforms,
};
use crate::error::{Error, Result};
use crate::io::{Files, LoadLimits};

/// A set of photographs with their cameras. Its images are not in memory.
///
/// ```no_run
/// use softray::photographs::{PhotographOptions, Photographs, Split};
/// let mut set = Photographs::open("scene")?;
/// set.split_every(8)?;
/// let options = PhotographOptions::new().with_longest_side(512);
/// let loaded = set.load(&set.of_split(Split::Train), &options)?;
/// for photo in &loaded.photographs {
///     let camera = photo.camera.to_camera()?;
///     println!("{}: {} × {}", photo.name, photo.color.width, photo.color.height);
/// }
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Photographs {
    /// The photographs: in the order of their file, or (COLMAP, LLFF, NeuS) ordered by name.
    pub views: Vec<View>,
    /// Points of a reconstruction, in scene units; none if the set has none.
    pub points: Vec<[f64; 3]>,
    /// The region of interest that the set itself names (NeuS).
    pub region: Option<Region>,
    /// The form in which the set is stored.
    pub dialect: Dialect,
    /// What a user should know about the set: what was left out, decided or scaled.
    pub notes: Vec<String>,
}

/// Loaded photographs.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The photographs, in the order of the indices.
    pub photographs: Vec<Photograph>,
    /// What was found: the photographs with a plain background.
    pub notes: Vec<String>,
}

/// The dialects in the order in which they are looked for, with their files.
const DIALECTS: [(Dialect, &str); 5] = [
    (Dialect::Transforms, "transforms.json"),
    (Dialect::NerfSynthetic, "transforms_train.json"),
    (
        Dialect::Colmap,
        "cameras and images (.bin or .txt) in the folder, sparse/0, sparse or colmap/sparse/0",
    ),
    (Dialect::Neus, "cameras_sphere.npz or cameras.npz"),
    (Dialect::Llff, "poses_bounds.npy"),
];

/// Returns the file of a dialect in a folder (of COLMAP, a folder).
fn file_of(folder: &Path, dialect: Dialect) -> Option<PathBuf> {
    let names: &[&str] = match dialect {
        Dialect::Transforms => &["transforms.json"],
        Dialect::NerfSynthetic => &["transforms_train.json"],
        Dialect::Colmap => return colmap::model_in(folder).map(|model| model.folder),
        Dialect::Neus => &["cameras_sphere.npz", "cameras.npz"],
        Dialect::Llff => &["poses_bounds.npy"],
    };
    let files = names.iter().map(|name| folder.join(name));
    files.into_iter().find(|file| file.is_file())
}

impl Photographs {
    /// Opens the set in a folder. These are looked for in order, and the first one is read:
    /// 1. `transforms.json` (instant-ngp, nerfstudio),
    /// 2. `transforms_train.json` with `transforms_val.json` and `transforms_test.json` (NeRF's synthetic scenes),
    /// 3. a model of COLMAP in the folder, or in one of sparse/0, sparse and colmap/sparse/0,
    /// 4. `cameras_sphere.npz` or `cameras.npz` (NeuS, IDR),
    /// 5. `poses_bounds.npy` (LLFF).
    ///
    /// A note says which others there are; [`Photographs::open_as`] reads one of them. The header of each image is read,
    /// but no pixels. Masks are files that the set names, or files of the folder `masks` or `mask` with the name of the
    /// image. If the cameras are for images of another size with the same aspect ratio, they are scaled.
    ///
    /// # Errors
    /// If none of these is there, a file is malformed or names an image that is not there, a camera is not valid, or an
    /// image has another aspect ratio than its camera.
    pub fn open(folder: impl AsRef<Path>) -> Result<Self> {
        Self::open_within(folder, &LoadLimits::default())
    }

    /// Opens a set like [`Photographs::open`], with the given limits.
    ///
    /// # Errors
    /// As [`Photographs::open`].
    pub fn open_within(folder: impl AsRef<Path>, limits: &LoadLimits) -> Result<Self> {
        let folder = folder.as_ref();
        let there = DIALECTS
            .iter()
            .filter_map(|(d, _)| Some((*d, file_of(folder, *d)?)));
        let there: Vec<(Dialect, PathBuf)> = there.collect();
        let Some((first, others)) = there.split_first() else {
            let names = DIALECTS.map(|(_, name)| name).join("; ");
            let message = format!("no cameras of photographs are there, expected one of: {names}");
            return Err(Error::format(folder, message));
        };
        let mut set = Self::open_as(folder, first.0, limits)?;
        for (dialect, file) in others {
            let note = format!(
                "{} is not read, since {} is there ({dialect:?}; Photographs::open_as reads it)",
                file.display(),
                first.1.display()
            );
            set.notes.push(note);
        }
        Ok(set)
    }

    /// Opens a set that is stored in a given form.
    ///
    /// # Errors
    /// As [`Photographs::open`].
    pub fn open_as(
        folder: impl AsRef<Path>,
        dialect: Dialect,
        limits: &LoadLimits,
    ) -> Result<Self> {
        let (folder, files) = (folder.as_ref(), Files::of_system(limits));
        let Some(file) = file_of(folder, dialect) else {
            let names = DIALECTS.iter().filter(|(d, _)| *d == dialect);
            let names: Vec<&str> = names.map(|(_, name)| *name).collect();
            let message = format!("expected {}", names.join(""));
            return Err(Error::format(folder, message));
        };
        let drafts = match dialect {
            Dialect::Transforms => transforms::read(&file, files)?,
            Dialect::NerfSynthetic => transforms::read_parts(folder, files)?,
            Dialect::Colmap => match colmap::model_in(folder) {
                Some(model) => colmap::read(folder, &model, files)?,
                None => return Err(Error::format(folder, "its model of COLMAP has vanished")),
            },
            Dialect::Neus => neus::read(folder, &file, files)?,
            Dialect::Llff => llff::read(folder, &file, files)?,
        };
        Self::of_drafts(drafts, folder, files)
    }

    fn of_drafts(mut drafts: Drafts, folder: &Path, files: Files) -> Result<Self> {
        if drafts.views.is_empty() {
            return Err(Error::format(
                drafts.file,
                "it has no image, expected at least one",
            ));
        }
        let (views, found) = settle(&drafts, folder, files)?;
        drafts.notes.extend(found);
        if let Some(images) = &drafts.images {
            let known = |name: &String| {
                let path = images.join(name);
                views
                    .iter()
                    .any(|v| v.path == path || v.mask_path.as_ref() == Some(&path))
            };
            let names = names_below(images)?.into_iter().filter(|name| !known(name));
            let names: Vec<String> = names.collect();
            if !names.is_empty() {
                let note = format!(
                    "{} images in {} have no camera and are left out: {}",
                    names.len(),
                    images.display(),
                    names.join(", ")
                );
                drafts.notes.push(note);
            }
        }
        Ok(Self {
            views,
            points: drafts.points,
            region: drafts.region,
            dialect: drafts.dialect,
            notes: drafts.notes,
        })
    }

    /// Keeps each n-th view, from the first on, for tests, and makes all others training views. Splits that the set has
    /// are replaced.
    ///
    /// # Errors
    /// If `n` is less than 2.
    pub fn split_every(&mut self, n: usize) -> Result<()> {
        Error::unless(n >= 2, "photographs", "split", n, "at least 2")?;
        for (i, view) in self.views.iter_mut().enumerate() {
            let test = i % n == 0;
            view.split = Some(if test { Split::Test } else { Split::Train });
        }
        Ok(())
    }

    /// Returns the indices of the views of a split. Views without one are training views.
    pub fn of_split(&self, split: Split) -> Vec<usize> {
        let of = |i: &usize| self.views[*i].split.unwrap_or(Split::Train) == split;
        (0..self.views.len()).filter(of).collect()
    }

    /// Returns the region of interest: the one that the set names, or that of its points, or that at which its cameras
    /// look. [`Region::of_masks`] finds a smaller one from loaded photographs.
    ///
    /// # Errors
    /// If the set has neither, and all cameras look in nearly the same direction.
    pub fn region(&self) -> Result<Region> {
        if let Some(region) = self.region {
            return Ok(region);
        }
        if !self.points.is_empty() {
            return Region::of_points(&self.points);
        }
        let cameras: Vec<_> = self.views.iter().map(|view| view.camera).collect();
        Region::of_cameras(&cameras)
    }

    /// Loads the photographs with these indices: without the distortion of their lenses, and shrunk. At most two files
    /// are decoded at a time, and each is shrunk at once.
    ///
    /// # Errors
    /// If an index is out of range, the photographs would take more memory than the options allow (checked before any
    /// is read), a file can't be read, or a mask has another size than its photograph, or a pixel is not
    /// finite.
    pub fn load(&self, indices: &[usize], options: &PhotographOptions) -> Result<Loaded> {
        /// Files that are decoded at a time.
        const AT_ONCE: usize = 2;
        self.check_memory(indices, options)?;
        let (next, failed) = (AtomicUsize::new(0), AtomicUsize::new(usize::MAX));
        let results = Mutex::new(Vec::with_capacity(indices.len()));
        let work = || {
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(&index) = indices.get(i) else {
                    break;
                };
                // Photographs after one that failed are not needed.
                if i > failed.load(Ordering::Relaxed) {
                    break;
                }
                let result = load(&self.views[index], options);
                if result.is_err() {
                    failed.fetch_min(i, Ordering::Relaxed);
                }
                let mut results = results.lock().unwrap_or_else(|e| e.into_inner());
                results.push((i, result));
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..AT_ONCE.min(indices.len()) {
                scope.spawn(work);
            }
            work();
        });
        let mut results = results.into_inner().unwrap_or_else(|e| e.into_inner());
        results.sort_by_key(|(i, _)| *i);
        let mut photographs = Vec::with_capacity(results.len());
        let mut plain: Vec<(&str, Vec<String>)> =
            vec![("white", Vec::new()), ("black", Vec::new())];
        for (_, result) in results {
            let (photograph, background) = result?;
            for (name, found) in &mut plain {
                if background == Some(*name) {
                    found.push(photograph.name.clone());
                }
            }
            photographs.push(photograph);
        }
        plain.retain(|(_, names)| !names.is_empty());
        let note = |(name, names): (&str, Vec<String>)| {
            format!(
                "the mask is all but the {name} background: {}",
                names.join(", ")
            )
        };
        let notes = plain.into_iter().map(note).collect();
        Ok(Loaded { photographs, notes })
    }

    /// Checks that photographs are there, and that they fit in memory.
    fn check_memory(&self, indices: &[usize], options: &PhotographOptions) -> Result<()> {
        let count = self.views.len();
        if let Some(&index) = indices.iter().find(|&&i| i >= count) {
            let expected = format!("an index below {count}");
            return Err(Error::invalid("photographs", "view", index, expected));
        }
        let bytes = |longest: Option<usize>| {
            let size = |&i: &usize| limited(self.views[i].camera.size, longest);
            let pixels = indices.iter().map(size).map(|[w, h]| w as u64 * h as u64);
            pixels.sum::<u64>() * PIXEL_BYTES
        };
        let (needed, most) = (bytes(options.longest), options.memory);
        if needed <= most {
            return Ok(());
        }
        let sides = indices.iter().map(|&i| self.views[i].camera.size);
        let longest = sides.map(|[w, h]| w.max(h)).max().unwrap_or(1);
        let (mut fits, mut fails) = (0, options.longest.map_or(longest, |l| l.min(longest)));
        while fails - fits > 1 {
            let middle = fits + (fails - fits) / 2;
            match bytes(Some(middle)) <= most {
                true => fits = middle,
                false => fails = middle,
            }
        }
        let expected = format!(
            "at most {most}: a longest side of {fits} pixels fits (PhotographOptions::with_longest_side), or \
             PhotographOptions::with_memory raises the limit"
        );
        let found = format!("{needed} bytes for {} photographs", indices.len());
        Err(Error::invalid("photographs", "memory", found, expected))
    }
}
