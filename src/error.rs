//! The crate's error type: every message names the object, the field and the value at fault.

use std::path::PathBuf;

/// What can be wrong with a scene, a file or a request to render.
///
/// `{:?}` says the same as `{}`, so that a `main` that returns it prints a sentence.
#[derive(thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value is outside of its range, or is NaN.
    #[error("{object}: {field} is {value}, expected {expected}")]
    Invalid {
        /// The object, camera or options at fault.
        object: String,
        /// The field at fault.
        field: String,
        /// The value found.
        value: String,
        /// What would be right.
        expected: String,
    },
    /// The scene has no triangle.
    #[error("scene: it has no triangles ({objects} objects), expected at least one triangle")]
    NoTriangles {
        /// How many objects the scene has.
        objects: usize,
    },
    /// The tensors of one scene are on different devices.
    #[error("{object}: {field} is on {found}, expected {expected} like the rest of the scene")]
    DeviceMismatch {
        /// The object at fault.
        object: String,
        /// The tensor at fault.
        field: String,
        /// The device that it is on.
        found: String,
        /// The device of the scene's first tensor.
        expected: String,
    },
    /// The tensors of one scene have different float types.
    #[error("{object}: {field} has dtype {found}, expected {expected} like the rest of the scene")]
    DtypeMismatch {
        /// The object at fault.
        object: String,
        /// The tensor at fault.
        field: String,
        /// The dtype that it has.
        found: String,
        /// The dtype of the scene's first tensor.
        expected: String,
    },
    /// A file can't be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// A file's contents are malformed.
    #[error("{}: {message}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        message: String,
    },
    /// A scene or view of a batch is not valid.
    #[error("{part} {index} of the batch: {source}")]
    OfBatch {
        /// `scene` or `view`.
        part: &'static str,
        /// Which, from 0.
        index: usize,
        /// What is wrong with it.
        source: Box<Error>,
    },
    /// A tensor can't be read back from its device.
    #[error("reading a tensor back failed: {0}")]
    Read(String),
}

impl std::fmt::Debug for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

impl Error {
    /// An [`Error::Invalid`] from anything printable.
    pub(crate) fn invalid(
        object: impl Into<String>,
        field: impl Into<String>,
        value: impl ToString,
        expected: impl Into<String>,
    ) -> Self {
        Self::Invalid {
            object: object.into(),
            field: field.into(),
            value: value.to_string(),
            expected: expected.into(),
        }
    }

    /// An [`Error::Format`] for a file.
    pub(crate) fn format(path: impl Into<PathBuf>, message: impl Into<String>) -> Self {
        Self::Format {
            path: path.into(),
            message: message.into(),
        }
    }
}

/// The crate's result type.
pub type Result<T, E = Error> = std::result::Result<T, E>;
