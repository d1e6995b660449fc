//! Converts lights to glTF (`KHR_lights_punctual`).

use std::path::Path;

use glam::{DQuat, DVec3};
use serde_json::{Value, json};

use crate::error::Result;
use crate::scene::Light;
use softray_kernels::host::LightKind;
use softray_kernels::warning;

/// Returns the JSON of a light and of the node that places it. The caller adds the light's index to the node.
pub(super) fn light(light: &Light, name: &str, path: &Path) -> Result<[Value; 2]> {
    let host = light.host(name)?;
    let mut node = json!({"name": name});
    if host.kind != LightKind::Directional {
        node["translation"] = json!(host.position);
    }
    let mut json = match host.kind {
        LightKind::Directional => json!({"type": "directional"}),
        LightKind::Spot => {
            let [inner, outer] = host.angles;
            let spot = json!({"innerConeAngle": inner, "outerConeAngle": outer});
            json!({"type": "spot", "spot": spot})
        }
        kind => {
            if kind != LightKind::Point {
                let file = path.display();
                warning!("{file}: {name} is written as a point, since glTF has no {kind:?}");
            }
            json!({"type": "point"})
        }
    };
    if host.kind != LightKind::Point {
        // Lights of glTF shine along −z.
        let direction = DVec3::from(host.direction).normalize();
        let turn = DQuat::from_rotation_arc(DVec3::NEG_Z, direction);
        node["rotation"] = json!(turn.to_array());
    }
    let strength = host.strength;
    if strength.iter().any(|&v| v < 0.0) {
        let file = path.display();
        warning!("{file}: {name} has {strength:?}, of which no less than 0 is written");
    }
    let most = scale_above(strength.into_iter());
    json["name"] = json!(name);
    json["intensity"] = json!(most);
    json["color"] = json!(strength.map(|v| v.max(0.0) / most));
    Ok([json, node])
}

/// Returns the least power of two that is at least 1 and at least all `values`. Division by it is exact.
pub(super) fn scale_above(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(1.0, f64::max).log2().ceil().exp2()
}
