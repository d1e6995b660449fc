//! Smoothing that keeps the volume.

use glam::DVec3;

use super::edges::{Connectivity, Rings};
use super::mesh::TriangleMesh;
use crate::error::{Error, Result};

/// How a mesh is smoothed.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct SmoothOptions {
    /// The number of steps, each one forwards and one backwards.
    pub steps: usize,
    /// The part of the way to the mean of its neighbors that a vertex goes in a step, above 0 and up to 1.
    pub strength: f64,
}

impl Default for SmoothOptions {
    fn default() -> Self {
        Self {
            steps: 10,
            strength: 0.5,
        }
    }
}

impl SmoothOptions {
    /// Sets the number of steps (10 by default).
    #[must_use]
    pub fn with_steps(mut self, steps: usize) -> Self {
        self.steps = steps;
        self
    }

    /// Sets the part of the way to the mean of its neighbors that a vertex goes in a step (0.5 by default).
    #[must_use]
    pub fn with_strength(mut self, strength: f64) -> Self {
        self.strength = strength;
        self
    }
}

/// The frequency that passes a smoothing filter unchanged.
const PASSING: f64 = 0.1;

/// Smooths a mesh (Taubin 1995, *A signal processing approach to fair surface design*): what is smaller than a few
/// edges goes, larger shapes stay, and a closed mesh gets its volume back. Vertices at borders stay where they are. Faces
/// and the order of vertices stay the same.
///
/// # Errors
/// [`Error::Invalid`] if the mesh or an option is not valid.
pub fn smooth(mesh: &TriangleMesh, options: &SmoothOptions) -> Result<TriangleMesh> {
    mesh.check()?;
    let valid = options.strength > 0.0 && options.strength <= 1.0;
    let expected = "above 0 and up to 1";
    Error::unless(valid, "smooth", "strength", options.strength, expected)?;
    let found = Connectivity::of(mesh);
    let mut smoothed = mesh.clone();
    let rings = Rings::new(mesh);
    let forwards = options.strength;
    let backwards = -forwards / (1.0 - PASSING * forwards);
    let moves = |v: u32| !found.irregular[v as usize];
    for _ in 0..options.steps {
        towards_neighbors(&mut smoothed, &rings, forwards, moves);
        towards_neighbors(&mut smoothed, &rings, backwards, moves);
    }
    if found.is_solid() {
        restore_volume(&mut smoothed, mesh.volume());
    }
    Ok(smoothed)
}

/// Moves each vertex that `moves` a part of the way to the mean of its neighbors.
pub(super) fn towards_neighbors(
    mesh: &mut TriangleMesh,
    rings: &Rings,
    part: f64,
    moves: impl Fn(u32) -> bool,
) {
    let moved = |v: u32| {
        let (ring, own) = (rings.of(v), mesh.at(v));
        if ring.is_empty() || !moves(v) {
            return own.to_array();
        }
        let mean = ring.iter().map(|&u| mesh.at(u)).sum::<DVec3>() / ring.len() as f64;
        own.lerp(mean, part).to_array()
    };
    mesh.positions = (0..mesh.positions.len() as u32).map(moved).collect();
}

/// Moves the surface of a closed mesh along its normals until it encloses a volume.
fn restore_volume(mesh: &mut TriangleMesh, volume: f64) {
    for _ in 0..3 {
        let area = mesh.area();
        let offset = (volume - mesh.volume()) / area;
        if !offset.is_finite() || offset.abs() > 0.1 * area.sqrt() {
            return;
        }
        let normals = mesh.vertex_normals();
        for (p, n) in mesh.positions.iter_mut().zip(normals) {
            *p = (DVec3::from(*p) + n * offset).to_array();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::samples::{ball, body, roughened, torus_field};
    use super::*;

    #[test]
    fn noise_goes_and_the_volume_stays() {
        let of_ball = |p: DVec3| 1.0 - p.length();
        let of_torus = |p: DVec3| torus_field(p, 0.35);
        let fields: [&(dyn Fn(DVec3) -> f64 + Sync); 2] = [&of_ball, &of_torus];
        for field in fields {
            let rough = roughened(&body(24, field), 0.03);
            let options = SmoothOptions::default().with_steps(20);
            let smoothed = smooth(&rough, &options).expect("a mesh");
            let away = |m: &TriangleMesh| {
                let squares = m.positions.iter().map(|&p| field(p.into()).powi(2));
                (squares.sum::<f64>() / m.positions.len() as f64).sqrt()
            };
            assert!(smoothed.area() < rough.area(), "{}", smoothed.area());
            let (was, is) = (away(&rough), away(&smoothed));
            assert!(is < 0.7 * was, "{is} {was}");
            assert!((smoothed.volume() / rough.volume() - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn strengths_out_of_range_are_errors() {
        for strength in [0.0, 1.5, f64::NAN] {
            let options = SmoothOptions::default().with_strength(strength);
            let error = smooth(&ball(6), &options).expect_err("an error");
            assert!(error.to_string().contains("strength"), "{error}");
        }
    }
}
