//! `Debug` of modules shows their parameters by shape, or by value where there are few numbers. A learner that is
//! printed shows its modules so.

use std::fmt::{Debug, Formatter, Result};

use super::{
    Aim, CameraParams, EnvironmentParams, LensParams, MaterialParams, RigidTransform, TextureParams,
};
use crate::debug::parameter;

impl Debug for RigidTransform {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut all = f.debug_struct("RigidTransform");
        all.field("rotation", &parameter(&self.rotation))
            .field("translation", &parameter(&self.translation));
        if let Some(scale) = &self.log_scale {
            all.field("log_scale", &parameter(scale));
        }
        all.finish()
    }
}

impl Debug for TextureParams {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        f.debug_struct("TextureParams")
            .field("logits", &parameter(&self.logits))
            .finish()
    }
}

impl Debug for EnvironmentParams {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        f.debug_struct("EnvironmentParams")
            .field("logs", &parameter(&self.logs))
            .finish()
    }
}

impl Debug for MaterialParams {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut all = f.debug_struct("MaterialParams");
        all.field("shares", &parameter(&self.shares));
        if let Some(shininess) = &self.log_shininess {
            all.field("log_shininess", &parameter(shininess));
        }
        if let Some(emission) = &self.log_emission {
            all.field("log_emission", &parameter(emission));
        }
        all.finish()
    }
}

impl Debug for Aim {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        match self {
            Self::Target(p) => f.debug_tuple("Target").field(&parameter(p)).finish(),
            Self::Direction(p) => f.debug_tuple("Direction").field(&parameter(p)).finish(),
        }
    }
}

impl Debug for LensParams {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        f.debug_struct("LensParams")
            .field("log_aperture", &parameter(&self.log_aperture))
            .field("log_focus", &parameter(&self.log_focus))
            .finish()
    }
}

impl Debug for CameraParams {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let mut all = f.debug_struct("CameraParams");
        all.field("eye", &parameter(&self.eye))
            .field("aim", &self.aim)
            .field("up", &parameter(&self.up))
            .field("fov", &parameter(&self.fov));
        if let Some(lens) = &self.lens {
            all.field("lens", lens);
        }
        all.finish()
    }
}
