//! Projections of cameras.

/// The projection of a camera.
#[derive(Clone, Copy, Debug)]
pub enum HostProjection {
    /// Perspective about the middle of the image, with square pixels.
    Perspective {
        /// Vertical field of view, in degrees in (0, 180).
        fov_y: f64,
    },
    /// Perspective by the matrix K of a calibrated camera.
    Intrinsics {
        /// Focal lengths (f_x, f_y), in pixels.
        focal: [f64; 2],
        /// Principal point (c_x, c_y), in pixels from the upper left corner.
        principal: [f64; 2],
        /// Columns and rows of the images that K was calibrated for.
        size: [f64; 2],
    },
    /// Parallel rays along the view axis.
    Orthographic {
        /// Height of the image, in scene units.
        height: f64,
    },
}

impl HostProjection {
    /// Whether its rays are parallel.
    pub fn is_parallel(&self) -> bool {
        matches!(self, Self::Orthographic { .. })
    }

    /// Returns the scale and shift of film points: s_x, s_y, t_x and t_y.
    /// Film points (x, y) are in halves of the image's height, with (0, 0) in its middle and y up. The ray of a film
    /// point has the direction (x·s_x + t_x)·right + (y·s_y + t_y)·up + forward. For parallel rays the expression
    /// without `forward` is the offset of the ray's origin from the eye, in units of `unit`.
    pub fn film(&self, unit: f64, aspect: f64) -> [f64; 4] {
        match *self {
            Self::Perspective { fov_y } => {
                let half = (0.5 * fov_y).to_radians().tan();
                [half, half, 0.0, 0.0]
            }
            Self::Intrinsics {
                focal: [fx, fy],
                principal: [cx, cy],
                size: [width, height],
            } => [
                0.5 * width / (fx * aspect),
                0.5 * height / fy,
                (0.5 * width - cx) / fx,
                (cy - 0.5 * height) / fy,
            ],
            Self::Orthographic { height } => [0.5 * height / unit, 0.5 * height / unit, 0.0, 0.0],
        }
    }

    /// Returns the derivatives of the film with respect to each value: the field of view, or two focal lengths and the
    /// principal point, or the height.
    pub fn slopes(&self, unit: f64, aspect: f64) -> Vec<[f64; 4]> {
        let [sx, sy, tx, ty] = self.film(unit, aspect);
        match *self {
            Self::Perspective { .. } => {
                let slope = (1.0 + sx * sx) * 0.5f64.to_radians();
                vec![[slope, slope, 0.0, 0.0]]
            }
            Self::Intrinsics {
                focal: [fx, fy], ..
            } => vec![
                [-sx / fx, 0.0, -tx / fx, 0.0],
                [0.0, -sy / fy, 0.0, -ty / fy],
                [0.0, 0.0, -1.0 / fx, 0.0],
                [0.0, 0.0, 0.0, 1.0 / fy],
            ],
            Self::Orthographic { .. } => vec![[0.5 / unit, 0.5 / unit, 0.0, 0.0]],
        }
    }
}
