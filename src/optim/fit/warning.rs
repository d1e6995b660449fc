use std::fmt;
use std::path::PathBuf;

/// Something about a fit that is likely not meant, though the fit goes on.
///
/// Its text says what was found and what may help.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Warning {
    /// The loss doesn't depend on these parameters, named by their paths in the module; they stay as
    /// they are.
    Unused(Vec<String>),
    /// The loss has not fallen for a while though the blur was constant.
    Plateau {
        /// The last step of the plateau.
        step: usize,
        /// The steps over which the loss was compared with as many before.
        window: usize,
    },
    /// A checkpoint could not be read, and the one before it was taken.
    DamagedCheckpoint(String),
    /// The file system has no locks, so that another process could fit in the same folder.
    NoLock(PathBuf),
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unused(parameters) => write!(
                f,
                "the loss does not depend on {}, which stay as they are: is what they are made from \
                 on a device with autodiff?",
                parameters.join(", ")
            ),
            Self::Plateau { step, window } => write!(
                f,
                "at step {step} the loss has not fallen for {window} steps; it may have converged, or \
                 be in a local minimum that a wider blur would leave"
            ),
            Self::DamagedCheckpoint(error) => {
                write!(
                    f,
                    "a checkpoint is damaged, taking the one before it: {error}"
                )
            }
            Self::NoLock(path) => write!(f, "{} can't be locked here", path.display()),
        }
    }
}
