//! The crate's error type. Every message names the object, the field and the invalid value.

use std::path::{Path, PathBuf};

use burn::tensor::TensorReadError;

/// An error of a scene, a file or a render.
///
/// `{:?}` shows the same text as `{}`, so a `main` that returns the error prints a sentence.
///
/// ```
/// use softray::prelude::*;
/// let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0]);
/// let empty = render(&Scene::new(), &camera, &RenderOptions::new(8, 8));
/// let error = empty.err().expect("an error");
/// assert!(matches!(error, softray::Error::NoTriangles { objects: 0, .. }));
/// println!("{error}");
/// ```
#[derive(thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value is NaN, outside of its range, or otherwise not valid.
    #[error("{object}: {field} is {value}, expected {expected}")]
    Invalid {
        /// The object, camera or options with the invalid value.
        object: String,
        /// The field with the invalid value.
        field: String,
        /// The invalid value.
        value: String,
        /// A description of the valid values.
        expected: String,
    },
    /// The scene has no triangle.
    #[error("{}", no_triangles(path.as_deref(), *objects))]
    NoTriangles {
        /// The file that contains the scene, if it was read from one.
        path: Option<PathBuf>,
        /// The number of objects in the scene.
        objects: usize,
    },
    /// A file can't be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file's contents are malformed.
    #[error("{}: {message}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// A description of the error.
        message: String,
    },
    /// A scene or view of a batch is not valid.
    #[error("{part} {index} of the batch: {source}")]
    InBatch {
        /// `scene` or `view`.
        part: &'static str,
        /// The index of the scene or view, from 0.
        index: usize,
        /// The error of the scene or view.
        source: Box<Error>,
    },
    /// A device is missing, or lacks a feature that a render needs.
    #[error("device {device}: {message}")]
    Device {
        /// The device's name.
        device: String,
        /// A description of the problem and of remedies.
        message: String,
    },
    /// A tensor can't be read back from its device.
    #[error("reading a tensor back from its device failed: {source}")]
    Read {
        /// burn's error.
        source: TensorReadError,
    },
}

impl std::fmt::Debug for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

impl Error {
    /// Returns an [`Error::Invalid`] with printable values.
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

    /// Returns an [`Error::Invalid`] unless `valid` is true.
    pub(crate) fn unless(
        valid: bool,
        object: &str,
        field: &str,
        value: impl ToString,
        expected: &str,
    ) -> Result<()> {
        if valid {
            return Ok(());
        }
        Err(Self::invalid(object, field, value, expected))
    }

    /// Returns an [`Error::Invalid`] unless a number is finite and above 0.
    pub(crate) fn unless_positive(object: &str, field: &str, value: f64) -> Result<()> {
        let valid = value.is_finite() && value > 0.0;
        Self::unless(valid, object, field, value, "a finite number > 0")
    }

    /// Returns a function for `map_err` that makes an [`Error::Io`] for a file.
    pub(crate) fn io(path: &Path) -> impl Fn(std::io::Error) -> Self + Copy {
        |source| Self::Io {
            path: path.into(),
            source,
        }
    }

    /// Adds the place that names the file of the error, if it is one of a file.
    pub(crate) fn named_by(mut self, place: &str) -> Self {
        match &mut self {
            Self::Io { source, .. } => {
                let kind = source.kind();
                *source = std::io::Error::new(kind, format!("{source} (named by {place})"));
            }
            Self::Format { message, .. } => *message += &format!(" (named by {place})"),
            _ => {}
        }
        self
    }

    /// Returns an [`Error::Read`] with burn's error. This is not a `From` impl, since with a second one the compiler
    /// can't infer the error type of closures that use `?`.
    pub(crate) fn read(source: impl Into<TensorReadError>) -> Self {
        let source = source.into();
        Self::Read { source }
    }

    /// Returns an [`Error::Device`].
    pub(crate) fn device(device: impl Into<String>, message: impl Into<String>) -> Self {
        Self::Device {
            device: device.into(),
            message: message.into(),
        }
    }

    /// Returns an [`Error::Format`] for a file.
    pub(crate) fn format(path: impl Into<PathBuf>, message: impl Into<String>) -> Self {
        Self::Format {
            path: path.into(),
            message: message.into(),
        }
    }
}

/// The message for a scene without triangles.
fn no_triangles(path: Option<&Path>, objects: usize) -> String {
    let Some(path) = path else {
        return match objects {
            0 => {
                "scene: it has no objects, expected at least one: Scene::with_object adds it".into()
            }
            1 => "scene: its object has no faces, expected at least one triangle".into(),
            n => {
                format!("scene: none of its {n} objects has a face, expected at least one triangle")
            }
        };
    };
    let ending = path.extension().unwrap_or_default();
    let missing = match ending.eq_ignore_ascii_case("obj") {
        true => "it has no faces (lines that begin with \"f\"), expected at least one",
        false => "no node of its scene has a mesh with triangles",
    };
    format!("{}: {missing}", path.display())
}

/// Returns a list of valid names for error messages.
pub(crate) fn one_of<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    /// The maximum number of listed names.
    const MAX_NAMES: usize = 16;
    let mut names = names.into_iter();
    let some: Vec<&str> = names.by_ref().take(MAX_NAMES).collect();
    match names.count() {
        0 if some.is_empty() => "a name, but there is none to choose from".into(),
        0 => format!("one of {some:?}"),
        more => format!("one of {some:?} or {more} more"),
    }
}

/// The crate's result type.
pub type Result<T, E = Error> = std::result::Result<T, E>;

#[cfg(test)]
mod tests {
    use std::error::Error as _;

    use super::*;

    #[test]
    fn readings_keep_what_burn_says() {
        let failed = TensorReadError::InvalidShape {
            expected: 1,
            actual: 3,
        };
        let error = Error::read(failed);
        assert!(error.source().expect("a source").is::<TensorReadError>());
        let parts = error.to_string();
        assert!(
            parts.contains("reading a tensor back") && parts.contains("got 3"),
            "{parts}"
        );
    }

    #[test]
    fn names_are_listed_as_far_as_they_fit() {
        let names: Vec<String> = (0..20).map(|i| format!("o{i}")).collect();
        let all = || names.iter().map(String::as_str);
        assert_eq!(one_of(all().take(2)), r#"one of ["o0", "o1"]"#);
        assert!(one_of(all()).ends_with(r#""o15"] or 4 more"#));
        assert!(one_of([]).contains("none"));
    }
}
