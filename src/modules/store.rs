//! Parameters of modules in safetensors files.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

use burn::module::{Module, ModuleVisitor, Param};
use burn::store::burn_pack::Tensor as Stored;
use burn::store::{
    ApplyError, FloatCastAdapter, ModuleAdapter, ModuleContext, ModuleSnapshot, SafetensorsStore,
    SafetensorsStoreError,
};
use burn::tensor::{DType, Tensor};

use crate::error::{Error, Result};
use crate::io::write_whole;

/// The key of the metadata for the version of the parameters' names.
const KEY: &str = "softray_format";
/// The version of the parameters' names that this crate writes. It rises when a name changes, with a row in
/// [`RENAMED`].
const FORMAT: u32 = 1;
/// Names of parameters in files without a version, and today's names, of which a module has some.
const RENAMED: [(&str, &[&str]); 7] = [
    ("fov", &["logit_fov"]),
    ("logits", &["logit_texels"]),
    ("logs", &["log_radiance"]),
    ("shares", &["logit_shares"]),
    ("roughness", &["logit_roughness"]),
    ("metallic", &["logit_metallic"]),
    ("log_index", &["log_eta", "log_extinction", "log_contrast"]),
];
/// The largest header of a safetensors file, bytes.
const LARGEST_HEADER: u64 = 100_000_000;

/// Writes the parameters of a module to a safetensors file.
///
/// The file is written completely or not at all: an existing file is replaced once the new one is complete. The
/// names of the parameters are the paths of the module's fields, separated by dots. The metadata `softray_format`
/// is the version of these names.
///
/// ```
/// use softray::modules::{load_safetensors, save_safetensors};
/// use softray::prelude::*;
/// let device = Device::flex().autodiff();
/// let path = std::env::temp_dir().join(format!("softray-{}.safetensors", std::process::id()));
/// let config = RigidTransformConfig::new();
/// let pose = config.clone().with_translation([0.0, 0.5, 0.0]).init(&device)?;
/// save_safetensors(&pose, &path)?;
/// let loaded = load_safetensors(config.init(&device)?, &path)?;
/// assert_eq!(loaded.translation.val().into_data(), pose.translation.val().into_data());
/// # std::fs::remove_file(&path).expect("a file");
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If a parameter cannot be read back from its device, or the file cannot be written.
pub fn save_safetensors<M: Module>(module: &M, path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    // burn's writer of files makes them readable by their owner alone.
    let mut store = SafetensorsStore::from_bytes(None).metadata(KEY, FORMAT.to_string());
    let saved = module
        .save_into(&mut store)
        .and_then(|()| store.get_bytes());
    let bytes = saved.map_err(|e| failed(path, e))?;
    write_whole(path, |file| file.write_all(&bytes).map_err(Error::io(path)))
}

/// Loads the parameters of a safetensors file into a module, on its device and in its float types. Trained
/// parameters stay trained, and frozen parameters stay frozen.
///
/// [`save_safetensors`] has an example.
///
/// # Errors
/// If the file cannot be read, or its parameters do not match the module: a parameter is missing, exists only
/// in the file, or has another shape or kind. A file of a newer version is an error, and so is a file with the names
/// of an earlier version; the error lists the changed names.
pub fn load_safetensors<M: Module>(module: M, path: impl AsRef<Path>) -> Result<M> {
    let (path, mut module) = (path.as_ref(), module);
    let versioned = check_version(path)?;
    let mut types = FloatTypes::default();
    module.visit(&mut types);
    // Mismatches are reported below, by the name of the parameter.
    let mut store = SafetensorsStore::from_file(path)
        .validate(false)
        .allow_partial(true)
        .with_from_adapter(types);
    let applied = module.load_from(&mut store).map_err(|e| failed(path, e))?;
    let wrong = |name: &str, found: String, expected: String| {
        Err(Error::invalid(
            path.display().to_string(),
            name,
            found,
            expected,
        ))
    };
    match applied.errors.first() {
        Some(ApplyError::ShapeMismatch {
            path: name,
            expected,
            found,
        }) => {
            let [found, expected] = [found, expected].map(|s| format!("shape {:?}", s.as_slice()));
            return wrong(
                name,
                format!("of {found}"),
                format!("{expected} like the module's"),
            );
        }
        Some(ApplyError::DTypeMismatch {
            path: name,
            expected,
            found,
        }) => {
            let expected = format!("{expected:?} like the module's");
            return wrong(name, format!("of type {found:?}"), expected);
        }
        Some(error) => return Err(Error::format(path, error.to_string())),
        None => {}
    }
    let misses = |name: &str| applied.missing.iter().any(|(missing, _)| missing == name);
    let earlier = applied.unused.iter().filter_map(|n| renamed(n, misses));
    let earlier: Vec<String> = earlier.collect();
    if !versioned && !earlier.is_empty() {
        let found = format!("absent, with earlier names: {}", earlier.join("; "));
        return wrong(KEY, found, format!("{FORMAT} and today's names"));
    }
    if let Some((name, _)) = applied.missing.first() {
        return wrong(
            name,
            "missing".into(),
            "all parameters of the module".into(),
        );
    }
    if let Some(name) = applied.unused.first() {
        return wrong(
            name,
            "in the file alone".into(),
            "parameters of the module".into(),
        );
    }
    Ok(module)
}

/// Returns an earlier name of a parameter with today's names, if the module misses one of these beside it. Otherwise the
/// name may be one of another program.
fn renamed(path: &str, misses: impl Fn(&str) -> bool) -> Option<String> {
    let (module, name) = path.split_at(path.rfind('.').map_or(0, |dot| dot + 1));
    let (_, now) = RENAMED.iter().find(|(then, _)| *then == name)?;
    let missed = now.iter().filter(|now| misses(&format!("{module}{now}")));
    let missed: Vec<&str> = missed.copied().collect();
    (!missed.is_empty()).then(|| format!("{path}, now {}", missed.join(" and ")))
}

/// Checks that a file's version is not newer than this crate's. Returns whether the file has one.
fn check_version(path: &Path) -> Result<bool> {
    let Some(found) = metadata(path)?.remove(KEY) else {
        return Ok(false);
    };
    let expected = format!("a version up to {FORMAT}, which this softray reads");
    let known = found.parse::<u32>().is_ok_and(|v| v <= FORMAT);
    let object = path.display().to_string();
    Error::unless(known, &object, KEY, found, &expected)?;
    Ok(true)
}

/// Reads the metadata of a safetensors file: the entry `__metadata__` of its header, which is JSON after its length.
/// It is empty if the header is malformed, which burn reports.
fn metadata(path: &Path) -> Result<HashMap<String, String>> {
    #[derive(Default, serde::Deserialize)]
    struct Header {
        #[serde(default)]
        __metadata__: HashMap<String, String>,
    }
    let mut file = File::open(path).map_err(Error::io(path))?;
    let mut length = [0; 8];
    let mut text = Vec::new();
    if file.read_exact(&mut length).is_ok() && u64::from_le_bytes(length) <= LARGEST_HEADER {
        let mut header = file.take(u64::from_le_bytes(length));
        header.read_to_end(&mut text).map_err(Error::io(path))?;
    }
    let header: Header = serde_json::from_slice(&text).unwrap_or_default();
    Ok(header.__metadata__)
}

fn failed(path: &Path, error: SafetensorsStoreError) -> Error {
    match error {
        SafetensorsStoreError::Io(source) => Error::Io {
            path: path.into(),
            source,
        },
        error => Error::format(path, error.to_string()),
    }
}

/// The float types of a module's parameters by name. The file's parameters are cast to them, because a device
/// may not support the file's types.
#[derive(Clone, Default)]
struct FloatTypes {
    path: Vec<String>,
    of: BTreeMap<String, DType>,
}

impl ModuleVisitor for FloatTypes {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let dtype = param.base().dtype();
        // Quantized parameters are not floats, so they are not cast.
        if dtype.is_float() {
            self.of.insert(self.path.join("."), dtype);
        }
    }
}

impl ModuleAdapter for FloatTypes {
    fn adapt(&self, tensor: Stored, context: ModuleContext<'_>) -> Stored {
        match self.of.get(&tensor.name) {
            Some(&dtype) => FloatCastAdapter::to(dtype).adapt(tensor, context),
            None => tensor,
        }
    }

    fn clone_box(&self) -> Box<dyn ModuleAdapter> {
        Box::new(self.clone())
    }
}
