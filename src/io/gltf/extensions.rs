//! The extensions of a file: which are read, which may be ignored, and which are errors.

use super::Document;
use crate::error::Result;

/// Extensions whose fields are read, or that have no effect here.
const READ: [&str; 11] = [
    "EXT_texture_webp",
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_xmp",
    "KHR_xmp_json_ld",
];

/// Subjects of extensions that do not change shapes and may be ignored. The subject is the second word of a name such
/// as `KHR_materials_clearcoat` or `EXT_lights_image_based`.
const REFINES: [&str; 13] = [
    "animation",
    "audio",
    "collider",
    "interactivity",
    "lights",
    "lod",
    "materials",
    "node",
    "physics",
    "rigid",
    "technique",
    "techniques",
    "texture",
];

/// Extensions that compress meshes, under all their names.
const COMPRESSIONS: [(&str, &str); 4] = [
    ("KHR_draco_mesh_compression", "Draco"),
    ("EXT_meshopt_compression", "meshopt"),
    ("KHR_meshopt_compression", "meshopt"),
    ("MESHOPT_compression", "meshopt"),
];

impl Document<'_> {
    /// Adds the extensions that are not read to the warnings.
    ///
    /// # Errors
    /// If the file requires an extension that is not read and may change shapes.
    pub(super) fn check_extensions(&self) -> Result<()> {
        for (i, name) in self.root.extensions_required.iter().enumerate() {
            let place = format!("extensionsRequired[{i}]");
            if let Some((_, method)) = COMPRESSIONS.iter().find(|c| c.0 == name) {
                let message = format!(
                    "is {name:?}: meshes that are compressed by {method} are not read, expected a file \
                     without compression"
                );
                return Err(self.fail(place, message));
            }
            if !is_read(name) && !refines(name) {
                let known = READ.join(", ");
                let message = format!("is {name:?}, expected one of those known here: {known}");
                return Err(self.fail(place, message));
            }
        }
        let all = (self.root.extensions_used.iter()).chain(&self.root.extensions_required);
        for name in all.filter(|name| !is_read(name)) {
            self.skip(name.as_str());
        }
        Ok(())
    }
}

fn is_read(name: &str) -> bool {
    READ.contains(&name)
}

/// Returns whether an extension may be ignored without changing shapes.
fn refines(name: &str) -> bool {
    let second = name.split('_').nth(1);
    second.is_some_and(|second| REFINES.contains(&second))
}
