//! The photographs of one object.

use std::path::Path;

use glam::DVec3;

use super::{Dialect, Photograph, PhotographOptions, Photographs, Region, Split};
use crate::error::{Error, Result};
use crate::meshing::{HullOptions, TriangleMesh, visual_hull};

/// The least part of the volume of a hull that tolerates one mask that the hull of all masks has, if no mask cuts off a part of
/// the object.
const WHOLE: f64 = 0.93;

/// Photographs of an object with masks, for a fit and for its measurement, in a world in which the object is in the unit ball
/// about the origin.
///
/// ```
/// use softray::meshing::HullOptions;
/// use softray::photographs::{ObjectPhotographs, PhotographOptions};
/// let options = PhotographOptions::new().with_longest_side(40);
/// let set = ObjectPhotographs::open("tests/data/photographs", 8, options)?;
/// assert_eq!((set.train.len(), set.held_out.len()), (35, 5));
/// let hull = set.visual_hull(&HullOptions::default().with_resolution(32))?;
/// assert_eq!(hull.statistics()?.genus, Some(1));
/// # Ok::<(), softray::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct ObjectPhotographs {
    /// The photographs to fit.
    pub train: Vec<Photograph>,
    /// The photographs to measure with.
    pub held_out: Vec<Photograph>,
    /// Where the object is in the world of the files.
    pub region: Region,
    /// The form in which the set is stored.
    pub dialect: Dialect,
    /// What a user should know about the set.
    pub notes: Vec<String>,
}

impl ObjectPhotographs {
    /// Opens the set in a folder ([`Photographs::open`]) and loads its photographs for training and tests, black beside the
    /// object. If the set has no split for tests, each `hold_out`-th photograph is held out.
    ///
    /// # Errors
    /// If a photograph has no mask, and those of [`Photographs::open`], [`Photographs::split_every`], [`Photographs::load`]
    /// and [`Region::of_masks`].
    pub fn open(
        folder: impl AsRef<Path>,
        hold_out: usize,
        options: PhotographOptions,
    ) -> Result<Self> {
        let mut set = Photographs::open(folder)?;
        if set.of_split(Split::Test).is_empty() {
            set.split_every(hold_out)?;
        }
        let options = options.with_black_backdrop(true);
        let train = set.load(&set.of_split(Split::Train), &options)?;
        let held_out = set.load(&set.of_split(Split::Test), &options)?;
        let notes = [set.notes, train.notes, held_out.notes].concat();
        let (mut train, mut held_out) = (train.photographs, held_out.photographs);
        for photograph in train.iter().chain(&held_out) {
            let (name, expected) = (&photograph.name, "one: see docs/PHOTOGRAPHS.md");
            Error::unless(photograph.masked, name, "mask", "none", expected)?;
        }
        let region = Region::of_masks(&train)?;
        region.make_unit(train.iter_mut().chain(&mut held_out));
        Ok(Self {
            train,
            held_out,
            region,
            dialect: set.dialect,
            notes,
        })
    }

    /// Returns the visual hull of the photographs to fit. If it has less than 93 % of the volume of a hull in which a point may
    /// be outside of one mask, a mask cuts off a part of the object, and the second hull is returned. The tolerance of the
    /// options does not count.
    ///
    /// # Errors
    /// As [`visual_hull`].
    pub fn visual_hull(&self, options: &HullOptions) -> Result<TriangleMesh> {
        let masks: Vec<_> = self.train.iter().map(Photograph::silhouette).collect();
        let carve = |outside| {
            let options = options.clone().with_tolerance(outside);
            visual_hull(&masks, Region::sphere([0.0; 3], 1.0), &options)
        };
        let (tolerant, exact) = (carve(1)?, carve(0));
        let whole = |exact: &TriangleMesh| exact.volume() > WHOLE * tolerant.volume();
        Ok(exact.ok().filter(whole).unwrap_or(tolerant))
    }

    /// Returns what the photographs show as up, a unit vector: the mean of the cameras' up vectors, or +y if
    /// this is 0.
    pub fn up(&self) -> [f64; 3] {
        let up = |p: &Photograph| DVec3::from(p.camera.to_world.map(|row| row[1]));
        let mean = self.train.iter().map(up).sum::<DVec3>();
        mean.try_normalize().unwrap_or(DVec3::Y).to_array()
    }
}
