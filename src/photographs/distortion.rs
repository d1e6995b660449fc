//! The distortion of lenses, in the models of OpenCV and COLMAP, and its inverse.
//!
//! Points are in the plane at distance 1 in front of the camera, with x to the right and y down: (x, y) is the direction
//! (x, y, 1) in the axes of OpenCV. A pixel is at f·(x, y) + c.

/// The number of Newton steps of an inverse. Lenses of photographs take about five.
const STEPS: usize = 64;
/// An inverse has converged when its distortion is this near to the given point. A pixel is about 1e-3.
const TOLERANCE: f64 = 1e-12;
/// The largest radius for which a lens is examined: 89.4° from the axis.
const FARTHEST: f64 = 100.0;

/// The distortion of a lens.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Distortion {
    /// A pinhole.
    #[default]
    None,
    /// The model of Brown and Conrady (OpenCV's and COLMAP's `OPENCV` and `FULL_OPENCV`). With r² = x² + y², a point is
    /// scaled by (1 + n₁r² + n₂r⁴ + n₃r⁶ + n₄r⁸)/(1 + d₁r² + d₂r⁴ + d₃r⁶) and moved by
    /// (2p₁xy + p₂(r² + 2x²), p₁(r² + 2y²) + 2p₂xy).
    Radial {
        /// n₁ to n₄: k₁, k₂, k₃, and the k₄ of nerfstudio.
        numerator: [f64; 4],
        /// d₁ to d₃: k₄, k₅, k₆ of OpenCV.
        denominator: [f64; 3],
        /// p₁ and p₂.
        tangential: [f64; 2],
    },
    /// The equidistant model of Kannala and Brandt (`OPENCV_FISHEYE`). A direction at the angle θ to the axis is seen at
    /// the radius θ(1 + k₁θ² + k₂θ⁴ + k₃θ⁶ + k₄θ⁸).
    Fisheye {
        /// k₁ to k₄.
        k: [f64; 4],
    },
}

/// Returns the polynomial c₀x + c₁x² + … without its constant term, and its derivative.
fn polynomial(coefficients: &[f64], x: f64) -> [f64; 2] {
    let terms = coefficients.iter().enumerate().rev();
    let [value, slope] = terms.fold([0.0, 0.0], |[value, slope], (i, c)| {
        [value * x + c, slope * x + c * (i + 1) as f64]
    });
    [value * x, slope]
}

impl Distortion {
    /// Returns whether points stay where they are.
    pub fn is_none(&self) -> bool {
        match self {
            Self::None => true,
            Self::Radial {
                numerator,
                denominator,
                tangential,
            } => {
                let mut all = numerator.iter().chain(denominator).chain(tangential);
                all.all(|&k| k == 0.0)
            }
            Self::Fisheye { .. } => false,
        }
    }

    /// Returns whether all coefficients are finite.
    pub fn is_finite(&self) -> bool {
        match self {
            Self::None => true,
            Self::Radial {
                numerator,
                denominator,
                tangential,
            } => {
                let mut all = numerator.iter().chain(denominator).chain(tangential);
                all.all(|k| k.is_finite())
            }
            Self::Fisheye { k } => k.iter().all(|k| k.is_finite()),
        }
    }

    /// Returns where the lens shows a direction.
    pub fn distort(&self, point: [f64; 2]) -> [f64; 2] {
        self.with_slopes(point).0
    }

    /// Returns [`Self::distort`] and the derivatives by x and by y.
    fn with_slopes(&self, [x, y]: [f64; 2]) -> ([f64; 2], [[f64; 2]; 2]) {
        let s = x * x + y * y;
        match self {
            Self::None => ([x, y], [[1.0, 0.0], [0.0, 1.0]]),
            Self::Radial {
                numerator,
                denominator,
                tangential: [p1, p2],
            } => {
                let [top, by_top] = polynomial(numerator, s);
                let [bottom, by_bottom] = polynomial(denominator, s);
                let (top, bottom) = (1.0 + top, 1.0 + bottom);
                let scale = top / bottom;
                let slope = 2.0 * (by_top - scale * by_bottom) / bottom;
                let moved = [
                    x * scale + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x),
                    y * scale + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y,
                ];
                let mixed = x * y * slope + 2.0 * (p1 * x + p2 * y);
                let by_x = scale + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x;
                let by_y = scale + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x;
                (moved, [[by_x, mixed], [mixed, by_y]])
            }
            Self::Fisheye { k } => {
                let r = s.sqrt();
                if r < 1e-9 {
                    return ([x, y], [[1.0, 0.0], [0.0, 1.0]]);
                }
                let [radius, by_angle] = angle_to_radius(k, r.atan());
                let scale = radius / r;
                // The derivative of radius/r by r, divided by r.
                let slope = (by_angle / (1.0 + s) - scale) / s;
                let mixed = x * y * slope;
                (
                    [x * scale, y * scale],
                    [
                        [scale + x * x * slope, mixed],
                        [mixed, scale + y * y * slope],
                    ],
                )
            }
        }
    }

    /// Returns the direction that the lens shows at a point: the inverse of [`Self::distort`] within [`Self::reach`], by
    /// Newton steps that are halved until they lead nearer. `None` if no direction is shown there.
    pub fn undistort(&self, shown: [f64; 2]) -> Option<[f64; 2]> {
        match self {
            Self::None => Some(shown),
            Self::Fisheye { k } => self.undistort_fisheye(k, shown),
            Self::Radial { .. } => {
                let residual = |p: [f64; 2]| {
                    let ([x, y], slopes) = self.with_slopes(p);
                    ([x - shown[0], y - shown[1]], slopes)
                };
                let length = |r: [f64; 2]| r[0].hypot(r[1]);
                let reach = self.reach();
                let mut at = shown;
                let far = length(at);
                if far > reach {
                    at = at.map(|v| v * 0.9 * reach / far);
                }
                for _ in 0..STEPS {
                    let (r, [[a, b], [c, d]]) = residual(at);
                    if length(r) < TOLERANCE {
                        break;
                    }
                    let determinant = a * d - b * c;
                    let step = [
                        (d * r[0] - b * r[1]) / determinant,
                        (a * r[1] - c * r[0]) / determinant,
                    ];
                    let halved = (0..30).map(|i| 0.5f64.powi(i));
                    let next = halved
                        .map(|t| [at[0] - t * step[0], at[1] - t * step[1]])
                        .find(|&p| length(p) <= reach && length(residual(p).0) < length(r));
                    let Some(next) = next else {
                        break;
                    };
                    at = next;
                }
                (length(residual(at).0) < 1e-9).then_some(at)
            }
        }
    }

    fn undistort_fisheye(&self, k: &[f64; 4], shown: [f64; 2]) -> Option<[f64; 2]> {
        let radius = shown[0].hypot(shown[1]);
        if radius < 1e-9 {
            return Some(shown);
        }
        // The radius grows with the angle up to the reach: bisection, which Newton steps make short.
        let (mut low, mut high) = (0.0, self.reach().atan());
        if angle_to_radius(k, high)[0] < radius {
            return None;
        }
        let mut angle = radius.min(0.5 * high);
        for _ in 0..STEPS {
            let [found, slope] = angle_to_radius(k, angle);
            if (found - radius).abs() < TOLERANCE {
                break;
            }
            match found < radius {
                true => low = angle,
                false => high = angle,
            }
            let newton = angle - (found - radius) / slope;
            let inside = newton > low && newton < high;
            angle = if inside { newton } else { 0.5 * (low + high) };
        }
        let scale = angle.tan() / radius;
        Some(shown.map(|v| v * scale))
    }

    /// Returns the largest radius √(x² + y²) of directions that the model describes: up to it, the shown radius grows
    /// (tangential terms left out). Directions beyond would be shown a second time, inside of the image.
    pub fn reach(&self) -> f64 {
        /// Steps of the search, equally spaced in the angle to the axis.
        const ANGLES: u32 = 256;
        if self.is_none() {
            return FARTHEST;
        }
        let last = FARTHEST.atan();
        let step = last / f64::from(ANGLES);
        let angles = (1..=ANGLES).map(|i| f64::from(i) * step);
        let Some(mut high) = angles.into_iter().find(|&angle| self.falls(angle)) else {
            return FARTHEST;
        };
        let mut low = high - step;
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            match self.falls(middle) {
                true => high = middle,
                false => low = middle,
            }
        }
        low.tan()
    }

    /// Returns whether the shown radius falls at an angle to the axis (tangential terms left out), or is on the other
    /// side of a pole of the denominator.
    fn falls(&self, angle: f64) -> bool {
        match self {
            Self::None => false,
            Self::Fisheye { k } => angle_to_radius(k, angle)[1] <= 0.0,
            Self::Radial {
                numerator,
                denominator,
                ..
            } => {
                let radial = Self::Radial {
                    numerator: *numerator,
                    denominator: *denominator,
                    tangential: [0.0; 2],
                };
                let (shown, slopes) = radial.with_slopes([angle.tan(), 0.0]);
                slopes[0][0] <= 0.0 || shown[0] < 0.0
            }
        }
    }
}

/// Returns the radius at which a fisheye lens shows an angle to the axis, and its derivative.
fn angle_to_radius(k: &[f64; 4], angle: f64) -> [f64; 2] {
    let square = angle * angle;
    let [value, slope] = polynomial(k, square);
    [angle * (1.0 + value), 1.0 + value + 2.0 * square * slope]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn lenses() -> impl Strategy<Value = Distortion> {
        let k = || -0.2..0.2f64;
        let radial = (
            [k(), k(), k(), k()],
            [k(), k(), k()],
            [-0.01..0.01f64, -0.01..0.01],
        );
        let radial = radial.prop_map(|(numerator, denominator, tangential)| Distortion::Radial {
            numerator,
            denominator: denominator.map(|d| 0.2 * d),
            tangential,
        });
        let fisheye = [-0.1..0.1f64, -0.05..0.05, -0.02..0.02, -0.01..0.01];
        let fisheye = fisheye.prop_map(|k| Distortion::Fisheye { k });
        prop_oneof![radial, fisheye]
    }

    proptest! {
        #[test]
        fn undistorting_is_the_inverse(
            lens in lenses(),
            angle in 0.0..std::f64::consts::TAU,
            part in 0.0..0.8f64,
        ) {
            let r = part * lens.reach().min(2.0);
            let point = [r * angle.cos(), r * angle.sin()];
            // Tangential terms move points past the reach of the radial ones only near to it.
            let ([_, _], [[a, b], [c, d]]) = lens.with_slopes(point);
            prop_assume!(a * d - b * c > 0.05);
            let found = lens.undistort(lens.distort(point)).expect("a direction");
            prop_assert!(
                (found[0] - point[0]).hypot(found[1] - point[1]) < 1e-7,
                "{point:?} {found:?}"
            );
        }

        #[test]
        fn slopes_are_derivatives(lens in lenses(), x in -0.8..0.8f64, y in -0.8..0.8f64) {
            let (_, slopes) = lens.with_slopes([x, y]);
            let h = 1e-6;
            for (j, [dx, dy]) in [[h, 0.0], [0.0, h]].into_iter().enumerate() {
                let [up, down] = [1.0, -1.0].map(|s| lens.distort([x + s * dx, y + s * dy]));
                for i in 0..2 {
                    let slope = (up[i] - down[i]) / (2.0 * h);
                    prop_assert!((slope - slopes[i][j]).abs() < 1e-6 * (1.0 + slope.abs()));
                }
            }
        }
    }

    #[test]
    fn opencv_shows_these_points() {
        // cv2.projectPoints with K = 1 and distCoeffs (0.1, −0.05, 0.001, −0.002, 0.02), by hand for (0.3, −0.4):
        // r² = 0.25, scale 1 + 0.025 − 0.003125 + 0.0003125.
        let lens = Distortion::Radial {
            numerator: [0.1, -0.05, 0.02, 0.0],
            denominator: [0.0; 3],
            tangential: [0.001, -0.002],
        };
        let scale = 1.0221875;
        let expected = [
            0.3 * scale + 2.0 * 0.001 * -0.12 - 0.002 * (0.25 + 0.18),
            -0.4 * scale + 0.001 * (0.25 + 0.32) + 2.0 * -0.002 * -0.12,
        ];
        let shown = lens.distort([0.3, -0.4]);
        assert!((0..2).all(|i| (shown[i] - expected[i]).abs() < 1e-15));
        let fisheye = Distortion::Fisheye { k: [0.0; 4] };
        assert!((fisheye.distort([1.0, 0.0])[0] - std::f64::consts::FRAC_PI_4).abs() < 1e-15);
    }

    #[test]
    fn folded_directions_are_out_of_reach() {
        let lens = Distortion::Radial {
            numerator: [-0.3, 0.0, 0.0, 0.0],
            denominator: [0.0; 3],
            tangential: [0.0; 2],
        };
        // 1 − 0.9·r² = 0.
        assert!((lens.reach() - (1.0f64 / 0.9).sqrt()).abs() < 1e-9);
        assert!(lens.undistort([0.8, 0.0]).is_none());
    }
}
