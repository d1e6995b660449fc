//! The form of visibility, on the host where it is computed there.

use std::sync::Arc;

use crate::accel::Hierarchy;
use crate::device::is_cpu;
use crate::error::Result;
use crate::model::filter::PixelFilter;
use crate::render::options::RenderOptions;
use crate::render::tiles::sampler;
use crate::scene::{Camera, Flattened};
use crate::transport::{Cones, Sight};
use crate::visibility::{Softmax, Sparse, Visibility, hierarchy_of};

/// The visibility of a render, with the boxes that it needs.
pub(super) enum HostSight {
    Cones(Cones, PixelFilter),
    Softmax(Softmax, Option<Box<Sparse>>),
}

impl HostSight {
    pub fn new(
        scene: &Flattened,
        camera: &Camera,
        options: &RenderOptions,
        hierarchy: Option<Arc<Hierarchy>>,
    ) -> Result<Self> {
        let hierarchy = || match hierarchy {
            Some(hierarchy) => Ok(hierarchy),
            None => hierarchy_of(&scene.triangles, options.cache.as_ref()),
        };
        Ok(match options.visibility {
            Visibility::Cone { angle, pixels } => {
                let half_height = camera.half_height()?;
                let least = options.blur.map_or(0.0, f64::tan);
                let wide = least * 0.5 * options.height as f64 / half_height;
                let cones = Cones::new(hierarchy()?, angle, &sampler(options));
                Self::Cones(cones, PixelFilter::new(pixels.max(wide)))
            }
            Visibility::Softmax {
                sigma,
                gamma,
                epsilon,
            } => {
                let form = Softmax {
                    sigma: sigma / (scene.unit * scene.unit),
                    gamma,
                    epsilon,
                };
                // Diagnostics are there in tensors only, and GPUs do without the host.
                let dense =
                    options.brute_force || options.diagnostics || !is_cpu(&scene.context.device);
                let sparse = if dense {
                    None
                } else {
                    let sparse = Sparse::new(&scene.triangles, hierarchy()?, options.cutoff);
                    Some(Box::new(sparse))
                };
                Self::Softmax(form, sparse)
            }
        })
    }

    /// The boxes, if there are any.
    pub fn hierarchy(&self) -> Option<Arc<Hierarchy>> {
        match self {
            Self::Cones(cones, _) => Some(cones.hierarchy()),
            Self::Softmax(_, sparse) => sparse.as_ref().map(|s| s.hierarchy()),
        }
    }

    /// The same, borrowed.
    pub fn get(&self) -> Sight<'_> {
        match self {
            Self::Cones(cones, _) => Sight::Cones(cones),
            Self::Softmax(form, sparse) => Sight::Softmax(*form, sparse.as_deref()),
        }
    }
}
