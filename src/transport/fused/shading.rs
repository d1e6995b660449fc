//! Lambert plus normalised Phong at one point, and derivatives: `transport/bsdf.rs` by hand.

use std::f64::consts::{FRAC_1_PI, TAU};

use glam::DVec3;

/// A shaded point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shade {
    /// Unit normals on the side that the ray came from.
    pub geometric: DVec3,
    pub normal: DVec3,
    pub diffuse: DVec3,
    /// k_s and the exponent, where the material is glossy.
    pub specular: Option<(DVec3, f64)>,
    /// The ray's direction.
    pub incoming: DVec3,
}

/// Derivatives by what a shaded point is made of.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ShadeSums {
    pub normal: DVec3,
    pub diffuse: DVec3,
    pub specular: DVec3,
    pub exponent: f64,
    pub incoming: DVec3,
}

/// A direction drawn from the BSDF.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scatter {
    pub direction: DVec3,
    /// f·cos θ/density.
    pub weight: DVec3,
    /// In the frame of the axis: the normal, or the mirror direction of the specular lobe.
    local: DVec3,
    glossy: bool,
    numbers: [f64; 2],
}

impl Shade {
    fn mirror(&self) -> DVec3 {
        self.incoming - self.normal * (2.0 * self.normal.dot(self.incoming))
    }

    fn pull_mirror(&self, g: DVec3, sums: &mut ShadeSums) {
        let along = self.normal.dot(g);
        sums.incoming += g - self.normal * (2.0 * along);
        sums.normal -= g * (2.0 * self.normal.dot(self.incoming)) + self.incoming * (2.0 * along);
    }

    fn share_of_gloss(&self) -> f64 {
        let sum = |k: DVec3| (k.x + k.y + k.z).abs();
        let ks = self.specular.map_or(0.0, |(k, _)| sum(k));
        ks / (sum(self.diffuse) + ks).max(1e-20)
    }

    /// cos θ, 0 below the surface.
    fn cosine(&self, outgoing: DVec3) -> f64 {
        if self.geometric.dot(outgoing) > 0.0 {
            self.normal.dot(outgoing).max(0.0)
        } else {
            0.0
        }
    }

    /// f·cos θ.
    #[inline(always)]
    pub fn scattered(&self, outgoing: DVec3) -> DVec3 {
        let cosine = self.cosine(outgoing);
        if cosine == 0.0 {
            return DVec3::ZERO;
        }
        let mut f = self.diffuse * FRAC_1_PI;
        if let Some((specular, exponent)) = self.specular {
            let lobe = phong(exponent, self.mirror().dot(outgoing));
            f += specular * (lobe * (exponent + 2.0) / TAU);
        }
        f * cosine
    }

    /// Adds derivatives of g·f·cos θ; returns that by the outgoing direction.
    #[inline(always)]
    pub fn pull_scattered(&self, outgoing: DVec3, g: DVec3, sums: &mut ShadeSums) -> DVec3 {
        let cosine = self.cosine(outgoing);
        if cosine == 0.0 {
            return DVec3::ZERO;
        }
        sums.diffuse += g * (cosine * FRAC_1_PI);
        let mut by_cosine = g.dot(self.diffuse) * FRAC_1_PI;
        let mut by_outgoing = DVec3::ZERO;
        if let Some((specular, exponent)) = self.specular {
            let mirror = self.mirror();
            let c = mirror.dot(outgoing);
            let lobe = phong(exponent, c);
            let norm = (exponent + 2.0) / TAU;
            let along = g.dot(specular);
            sums.specular += g * (lobe * norm * cosine);
            by_cosine += along * lobe * norm;
            sums.exponent += along * lobe * cosine / TAU;
            let by_lobe = along * norm * cosine;
            by_outgoing += self.pull_lobe(mirror, outgoing, lobe, by_lobe, sums);
        }
        sums.normal += outgoing * by_cosine;
        by_outgoing + self.normal * by_cosine
    }

    /// Derivatives of cosⁿα; returns that by the outgoing direction.
    fn pull_lobe(
        &self,
        mirror: DVec3,
        outgoing: DVec3,
        lobe: f64,
        g: f64,
        sums: &mut ShadeSums,
    ) -> DVec3 {
        let Some((_, exponent)) = self.specular else {
            return DVec3::ZERO;
        };
        let c = mirror.dot(outgoing);
        if c <= 1e-12 || c > 1.0 {
            return DVec3::ZERO;
        }
        sums.exponent += g * lobe * c.ln();
        let by_c = g * lobe * exponent / c;
        self.pull_mirror(outgoing * by_c, sums);
        mirror * by_c
    }

    /// The density per solid angle with which `sample` draws a direction.
    pub fn density(&self, outgoing: DVec3) -> f64 {
        let cosine = self.normal.dot(outgoing).max(0.0) * FRAC_1_PI;
        let Some((_, exponent)) = self.specular else {
            return cosine;
        };
        let gloss = self.share_of_gloss();
        let lobe = phong(exponent, self.mirror().dot(outgoing));
        cosine * (1.0 - gloss) + lobe * (exponent + 1.0) / TAU * gloss
    }

    /// Draws a lobe in proportion to its albedo and a direction from it.
    #[inline(always)]
    pub fn sample(&self, [u, v, lobe]: [f64; 3], epsilon: f64) -> Scatter {
        let (sin, cos) = sin_cos_of_turns(v);
        let gloss = self.share_of_gloss();
        let glossy = self.specular.is_some() && lobe < gloss;
        let (axis, local) = match self.specular {
            Some((_, exponent)) if glossy => {
                let log = u.clamp(1e-7, 1.0 - 1e-7).ln() / (exponent + 1.0);
                let sine = (1.0 - (2.0 * log).exp()).max(epsilon).sqrt();
                (self.mirror(), DVec3::new(sine * cos, sine * sin, log.exp()))
            }
            _ => {
                let r = u.sqrt();
                let local = DVec3::new(r * cos, r * sin, (1.0 - u).sqrt());
                (self.normal, local)
            }
        };
        let direction = from_frame(axis, local);
        let weight = if self.specular.is_some() {
            let density = self.density(direction);
            if density < 1e-20 {
                DVec3::ZERO
            } else {
                self.scattered(direction) / density
            }
        } else if self.geometric.dot(direction) > 0.0 {
            // f·cos/density is k_d, whatever the direction.
            self.diffuse
        } else {
            DVec3::ZERO
        };
        Scatter {
            direction,
            weight,
            local,
            glossy,
            numbers: [u, v],
        }
    }

    /// Adds derivatives of g·weight + by_direction·direction.
    #[inline(always)]
    pub fn pull_sample(
        &self,
        s: &Scatter,
        g: DVec3,
        mut by_direction: DVec3,
        epsilon: f64,
        sums: &mut ShadeSums,
    ) {
        let direction = s.direction;
        match self.specular {
            None => {
                if self.geometric.dot(direction) > 0.0 {
                    sums.diffuse += g;
                }
            }
            Some((_, exponent)) => {
                let density = self.density(direction);
                if density >= 1e-20 {
                    by_direction += self.pull_scattered(direction, g / density, sums);
                    let by_density = -g.dot(s.weight) / density;
                    let gloss = self.share_of_gloss();
                    if self.normal.dot(direction) > 0.0 {
                        let by_cosine = by_density * (1.0 - gloss) * FRAC_1_PI;
                        sums.normal += direction * by_cosine;
                        by_direction += self.normal * by_cosine;
                    }
                    let mirror = self.mirror();
                    let lobe = phong(exponent, mirror.dot(direction));
                    sums.exponent += by_density * lobe * gloss / TAU;
                    let by_lobe = by_density * (exponent + 1.0) / TAU * gloss;
                    by_direction += self.pull_lobe(mirror, direction, lobe, by_lobe, sums);
                }
            }
        }
        match self.specular {
            Some((_, exponent)) if s.glossy => {
                let (by_axis, by_local) = pull_frame(self.mirror(), s.local, by_direction);
                self.pull_mirror(by_axis, sums);
                let [u, v] = s.numbers;
                let (sin, cos) = sin_cos_of_turns(v);
                let log = u.clamp(1e-7, 1.0 - 1e-7).ln() / (exponent + 1.0);
                let square = (2.0 * log).exp();
                let mut by_log = by_local.z * log.exp();
                if 1.0 - square > epsilon {
                    let by_sine = by_local.x * cos + by_local.y * sin;
                    by_log -= by_sine * square / (1.0 - square).sqrt();
                }
                sums.exponent -= by_log * log / (exponent + 1.0);
            }
            _ => sums.normal += pull_frame(self.normal, s.local, by_direction).0,
        }
    }
}

/// Sine and cosine of turns in [0, 1], to rounding.
#[inline(always)]
pub(super) fn sin_cos_of_turns(v: f64) -> (f64, f64) {
    // Of the nearest quarter turn, and Taylor series for the at most 45° that are left: the first term
    // left out is 5e-17.
    let quarter = (4.0 * v + 0.5).floor();
    let x = (v - 0.25 * quarter) * TAU;
    let y = x * x;
    let mut sin = 0.0;
    let mut cos = 0.0;
    for n in (1..=7).rev() {
        let n = f64::from(2 * n);
        sin = (1.0 + sin) * -y * (n * (n + 1.0)).recip();
        cos = (1.0 + cos) * -y * ((n + 1.0) * (n + 2.0)).recip();
    }
    let sin = x * (1.0 + sin);
    let cos = 1.0 - 0.5 * y * (1.0 + cos);
    // By bits: jumps would be guessed wrong as often as not.
    let quarter = quarter as i32;
    let odd = u64::from(quarter as u32 & 1).wrapping_neg();
    let changed = (sin.to_bits() ^ cos.to_bits()) & odd;
    let first = f64::from_bits(sin.to_bits() ^ changed);
    let second = f64::from_bits(cos.to_bits() ^ changed);
    let below = f64::from(1 - (quarter & 2));
    let behind = f64::from(1 - ((quarter + 1) & 2));
    (first * below, second * behind)
}

/// cosⁿα, 0 for α over 90°.
fn phong(exponent: f64, cosine: f64) -> f64 {
    if cosine <= 1e-12 {
        0.0
    } else {
        (cosine.min(1.0).ln() * exponent).exp()
    }
}

/// A local direction turned so that z lies along a unit axis (Duff et al. 2017).
#[inline(always)]
fn from_frame(axis: DVec3, local: DVec3) -> DVec3 {
    let [tangent, bitangent] = frame(axis);
    tangent * local.x + bitangent * local.y + axis * local.z
}

fn sign_of(z: f64) -> f64 {
    if z >= 0.0 { 1.0 } else { -1.0 }
}

#[inline(always)]
fn frame(axis: DVec3) -> [DVec3; 2] {
    let sign = sign_of(axis.z);
    let a = -1.0 / (axis.z + sign);
    let b = axis.x * axis.y * a;
    [
        DVec3::new(1.0 + sign * axis.x * axis.x * a, sign * b, -sign * axis.x),
        DVec3::new(b, sign + axis.y * axis.y * a, -axis.y),
    ]
}

/// Derivatives of g·`from_frame` by axis and local direction.
#[inline(always)]
fn pull_frame(axis: DVec3, local: DVec3, g: DVec3) -> (DVec3, DVec3) {
    let [tangent, bitangent] = frame(axis);
    let by_local = DVec3::new(g.dot(tangent), g.dot(bitangent), g.dot(axis));
    let sign = sign_of(axis.z);
    let a = -1.0 / (axis.z + sign);
    let (t, b) = (g * local.x, g * local.y);
    let by_b = t.y * sign + b.x;
    let by_a = t.x * sign * axis.x * axis.x + b.y * axis.y * axis.y + by_b * axis.x * axis.y;
    let by_axis = DVec3::new(
        t.x * 2.0 * sign * axis.x * a - sign * t.z + by_b * axis.y * a,
        b.y * 2.0 * axis.y * a - b.z + by_b * axis.x * a,
        by_a * a * a,
    );
    (by_axis + g * local.z, by_local)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_to_rounding() {
        for i in 0..=4096 {
            let v = f64::from(i) / 4096.0;
            let (sin, cos) = sin_cos_of_turns(v);
            let wanted = (TAU * v).sin_cos();
            let error = (sin - wanted.0).abs().max((cos - wanted.1).abs());
            assert!(error < 1e-15, "{v}: {error:e}");
        }
    }
}
