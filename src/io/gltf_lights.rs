//! Lights of glTF files to come (`KHR_lights_punctual`).

use std::path::Path;

use glam::{DQuat, DVec3};
use serde_json::{Value, json};

use crate::error::Result;
use crate::scene::{Light, Parameter};

/// A light, and the node that places it, but for the light's number.
pub(super) fn light(light: &Light, name: &str, path: &Path) -> Result<[Value; 2]> {
    let mut node = json!({"name": name});
    let mut put = |position: Option<&Parameter<3>>, direction: Option<&Parameter<3>>| {
        if let Some(position) = position {
            node["translation"] = json!(position.values()?);
        }
        if let Some(direction) = direction {
            let direction = DVec3::from(direction.values()?).normalize();
            // Lights shine along −z.
            let turn = DQuat::from_rotation_arc(DVec3::NEG_Z, direction);
            node["rotation"] = json!(turn.to_array());
        }
        Result::Ok(())
    };
    let (mut json, strength) = match light {
        Light::Point {
            position,
            intensity,
        } => {
            put(Some(position), None)?;
            (json!({"type": "point"}), intensity)
        }
        Light::Spot {
            position,
            direction,
            intensity,
            inner,
            outer,
        } => {
            put(Some(position), Some(direction))?;
            let ([inner], [outer]) = (inner.values()?, outer.values()?);
            let spot = json!({"innerConeAngle": inner, "outerConeAngle": outer});
            (json!({"type": "spot", "spot": spot}), intensity)
        }
        Light::Directional {
            direction,
            irradiance,
        } => {
            put(None, Some(direction))?;
            (json!({"type": "directional"}), irradiance)
        }
    };
    let strength = strength.values()?;
    if strength.iter().any(|&v| v < 0.0) {
        let file = path.display();
        log::warn!("{file}: {name} has {strength:?}, of which no less than 0 is written");
    }
    let most = scale_above(strength.into_iter());
    json["name"] = json!(name);
    json["intensity"] = json!(most);
    json["color"] = json!(strength.map(|v| v.max(0.0) / most));
    Ok([json, node])
}

/// A power of two, which leaves all digits as they are, of at least 1 and the largest of some numbers.
pub(super) fn scale_above(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(1.0, f64::max).log2().ceil().exp2()
}
