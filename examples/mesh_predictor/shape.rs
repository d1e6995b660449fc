//! The shapes of the data set: superquadrics and lathe shapes.

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};

use super::numbers::Numbers;

/// The number of rings between the poles, and of vertices per ring.
const RINGS: usize = 31;
const AROUND: usize = 48;
/// The number of radii that a lathe's profile interpolates.
const KNOTS: usize = 5;

/// A closed surface about the origin, y up: the spherical product of a meridian and a section (Barr
/// 1981, *Superquadrics and Angle-Preserving Transformations*).
#[derive(Clone, Debug)]
pub enum Shape {
    /// |y/b|^(2/m) + (|x/a|^(2/s) + |z/c|^(2/s))^(s/m) = 1.
    Superquadric {
        /// a, b, c.
        axes: DVec3,
        /// m.
        meridian: f64,
        /// s.
        section: f64,
    },
    /// A profile rotated about the y axis.
    Lathe {
        /// (radius, y) from the bottom to the top, both ends on the axis.
        profile: Vec<DVec2>,
    },
}

impl Shape {
    /// Returns a random shape of either kind.
    pub fn random(numbers: &mut Numbers) -> Self {
        if numbers.uniform(0.0, 1.0) < 0.5 {
            Self::Superquadric {
                axes: DVec3::from(numbers.vector(0.28, 0.68)),
                meridian: numbers.uniform(0.2, 2.0),
                section: numbers.uniform(0.2, 2.0),
            }
        } else {
            let height = numbers.uniform(0.4, 0.85);
            Self::Lathe {
                profile: turned(height, numbers.vector(0.12, 0.62)),
            }
        }
    }

    /// Returns vertices, and faces that are counter-clockwise from outside.
    pub fn mesh(&self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let (meridian, section) = self.curves();
        let inner = &meridian[1..meridian.len() - 1];
        let mut vertices = vec![DVec3::new(0.0, meridian[0].y, 0.0)];
        for p in inner {
            vertices.extend(
                section
                    .iter()
                    .map(|s| DVec3::new(p.x * s.x, p.y, p.x * s.y)),
            );
        }
        vertices.push(DVec3::new(0.0, meridian[meridian.len() - 1].y, 0.0));
        let top = vertices.len() as u32 - 1;
        let at = |ring: usize, j: usize| (1 + ring * AROUND + j % AROUND) as u32;
        let mut faces = Vec::new();
        for j in 0..AROUND {
            faces.push([0, at(0, j), at(0, j + 1)]);
            for i in 0..inner.len() - 1 {
                let (a, b) = (at(i, j), at(i, j + 1));
                let (c, d) = (at(i + 1, j + 1), at(i + 1, j));
                faces.extend([[a, d, c], [a, c, b]]);
            }
            faces.push([at(inner.len() - 1, j), top, at(inner.len() - 1, j + 1)]);
        }
        (vertices, faces)
    }

    /// Returns the meridian (radius, y) from pole to pole, and the section (x, z) at radius 1.
    fn curves(&self) -> (Vec<DVec2>, Vec<DVec2>) {
        let angle = |j: usize| TAU * j as f64 / AROUND as f64;
        match self {
            Self::Superquadric {
                axes,
                meridian,
                section,
            } => {
                let ring = |i: usize| {
                    let angle = PI * (i as f64 / (RINGS + 1) as f64 - 0.5);
                    DVec2::new(
                        power(angle.cos(), *meridian),
                        axes.y * power(angle.sin(), *meridian),
                    )
                };
                let around = |j: usize| {
                    let (sin, cos) = angle(j).sin_cos();
                    DVec2::new(axes.x * power(cos, *section), axes.z * power(sin, *section))
                };
                (
                    (0..RINGS + 2).map(ring).collect(),
                    (0..AROUND).map(around).collect(),
                )
            }
            Self::Lathe { profile } => {
                let around = |j: usize| DVec2::from(angle(j).sin_cos());
                // These run from z to x, so they are reversed for the same direction as above.
                let section = (0..AROUND).rev().map(around).collect();
                (profile.clone(), section)
            }
        }
    }

    /// Returns the largest distance of the surface from the origin in a direction of length 1.
    pub fn radius(&self, direction: DVec3) -> f64 {
        match self {
            Self::Superquadric {
                axes,
                meridian,
                section,
            } => {
                let q = (direction / *axes).abs();
                let across = q.x.powf(2.0 / section) + q.z.powf(2.0 / section);
                let sum = across.powf(section / meridian) + q.y.powf(2.0 / meridian);
                sum.powf(-0.5 * meridian)
            }
            Self::Lathe { profile } => {
                let ray = DVec2::new(direction.x.hypot(direction.z), direction.y);
                let meets = |ends: &[DVec2]| {
                    let (p, q) = (ends[0].perp_dot(ray), ends[1].perp_dot(ray));
                    if p * q > 0.0 {
                        return 0.0;
                    }
                    let share = if p == q { 0.0 } else { p / (p - q) };
                    ends[0].lerp(ends[1], share).dot(ray)
                };
                profile.windows(2).map(meets).fold(0.0, f64::max)
            }
        }
    }
}

/// Returns |x|^exponent with the sign of x. Values of x that differ from 0 by rounding give 0.
fn power(x: f64, exponent: f64) -> f64 {
    if x.abs() < 1e-12 {
        0.0
    } else {
        x.signum() * x.abs().powf(exponent)
    }
}

/// Returns a smooth profile through radii at even heights, rounded at both ends. `height` is half its height.
fn turned(height: f64, knots: [f64; KNOTS]) -> Vec<DVec2> {
    let point = |i: usize| {
        // Points are denser at the ends, where the profile bends most.
        let t = -(PI * i as f64 / (RINGS + 1) as f64).cos();
        let place = 0.5 * (t + 1.0) * (KNOTS - 1) as f64;
        let k = (place as usize).min(KNOTS - 2);
        let share = 0.5 - 0.5 * (PI * (place - k as f64)).cos();
        let radius = knots[k] + share * (knots[k + 1] - knots[k]);
        DVec2::new(radius * (1.0 - t.powi(8)).max(0.0).sqrt(), height * t)
    };
    (0..RINGS + 2).map(point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shapes() -> Vec<Shape> {
        let random = |i| Shape::random(&mut Numbers::new(5, i));
        let mut shapes: Vec<Shape> = (0..40).map(random).collect();
        shapes.push(Shape::Superquadric {
            axes: DVec3::new(0.5, 0.7, 0.3),
            meridian: 1.0,
            section: 1.0,
        });
        shapes
    }

    /// Meshes are closed, and their volume matches the volume inside the radii, which are computed independently.
    #[test]
    fn meshes_are_closed_and_as_large_as_their_radii_say() {
        for shape in shapes() {
            let (v, faces) = shape.mesh();
            let mut edges = std::collections::HashSet::new();
            for f in &faces {
                for i in 0..3 {
                    assert!(edges.insert((f[i], f[(i + 1) % 3])), "{shape:?}");
                }
            }
            assert!(edges.iter().all(|&(p, q)| edges.contains(&(q, p))));
            let six = |f: &[u32; 3]| {
                let [a, b, c] = f.map(|i| v[i as usize]);
                a.dot(b.cross(c))
            };
            let volume: f64 = faces.iter().map(six).sum::<f64>() / 6.0;
            // ∫ r³/3 over directions. For shapes with a neck, the outer radii enclose more.
            const STEPS: usize = 200;
            let mut sum = 0.0;
            for i in 0..STEPS {
                let y = (2 * i + 1) as f64 / STEPS as f64 - 1.0;
                for j in 0..STEPS {
                    let (s, c) = (TAU * j as f64 / STEPS as f64).sin_cos();
                    let r = (1.0 - y * y).sqrt();
                    sum += shape.radius(DVec3::new(r * c, y, r * s)).powi(3) / 3.0;
                }
            }
            let inside = sum * 2.0 * TAU / (STEPS * STEPS) as f64;
            let ratio = volume / inside;
            let least = match shape {
                Shape::Superquadric { .. } => 0.96,
                Shape::Lathe { .. } => 0.8,
            };
            assert!(ratio > least && ratio < 1.01, "{ratio} of {shape:?}");
        }
    }

    #[test]
    fn an_ellipsoid_is_one() {
        let shape = shapes().pop().expect("the last one");
        for u in [DVec3::X, DVec3::Y, DVec3::Z] {
            let expected = u.dot(DVec3::new(0.5, 0.7, 0.3));
            assert!((shape.radius(u) - expected).abs() < 1e-12);
        }
        let u = DVec3::new(1.0, 2.0, -2.0) / 3.0;
        let expected = (u / DVec3::new(0.5, 0.7, 0.3)).length().recip();
        assert!((shape.radius(u) - expected).abs() < 1e-12);
    }
}
