//! Bounds of edges: a sphere, a cone of normals, and what jumps.

use super::Kind;
use super::query::{EdgeList, Jumps};
use crate::model::{V3, v3};

/// Bounds of some edges.
#[derive(Clone, Copy)]
pub(super) struct Bounds {
    low: V3,
    high: V3,
    /// A cone of the normals of folds: their sum, and the greatest angle to it.
    normals: V3,
    angle: f32,
    /// Jumps times lengths; where a fold is a silhouette, times the angle of the fold.
    pub jumps: Jumps,
}

/// The direction of a sum of normals.
fn direction(sum: V3) -> V3 {
    if sum.length() > 0.0 {
        sum.normalize()
    } else {
        v3(0.0, 0.0, 1.0)
    }
}

/// The angle between unit vectors, radians.
fn angle(a: V3, b: V3) -> f32 {
    // By both, so that small angles keep their digits.
    a.cross(b).length().atan2(a.dot(b))
}

impl Bounds {
    pub fn new(source: &EdgeList, list: &[u32]) -> Self {
        let edges = || list.iter().map(|&i| &source.edges[i as usize]);
        let folds = || edges().filter(|e| e.kind == Kind::Fold);
        let (mut low, mut high) = (V3::ONE * f32::MAX, V3::ONE * f32::MIN);
        let mut jumps = Jumps {
            closed: 1.0,
            ..Jumps::default()
        };
        for e in edges() {
            let v = source.velocity(e);
            for p in [e.a, e.a + e.along, e.a + v, e.a + e.along + v] {
                low = low.min(p);
                high = high.max(p);
            }
            let (length, own) = (e.along.length(), Jumps::of(e));
            jumps.seen_always += length * own.seen_always;
            jumps.passes_always += length * own.passes_always;
            jumps.crease += length * own.crease;
        }
        let mut normals = V3::ZERO;
        for e in folds() {
            let [n, m] = source.normals(e);
            normals += n + m;
            jumps.fold += e.along.length() * (n - m).length();
            jumps.closed = jumps.closed.min(Jumps::of(e).closed);
        }
        let axis = direction(normals);
        let angles = folds().flat_map(|e| source.normals(e).map(|n| angle(n, axis)));
        Self {
            low,
            high,
            normals,
            angle: angles.fold(0.0, f32::max),
            jumps,
        }
    }

    pub fn centre(&self) -> V3 {
        (self.low + self.high) * 0.5
    }

    /// Of a sphere about the centre.
    pub fn radius(&self) -> f32 {
        (self.high - self.low).length() * 0.5 * (1.0 + 1e-5)
    }

    /// Of the cone of normals, and the cosine of its half-angle.
    pub fn axis(&self) -> V3 {
        direction(self.normals)
    }

    pub fn cos(&self) -> f32 {
        self.angle.min(std::f32::consts::PI).cos()
    }

    /// Of all, at least one.
    pub fn joined(parts: &[Self]) -> Self {
        let mut all = parts[0];
        for part in &parts[1..] {
            let (sum, own) = (&mut all.jumps, &part.jumps);
            sum.seen_always += own.seen_always;
            sum.passes_always += own.passes_always;
            sum.fold += own.fold;
            sum.crease += own.crease;
            sum.closed = sum.closed.min(own.closed);
            all.low = all.low.min(part.low);
            all.high = all.high.max(part.high);
            all.normals += part.normals;
        }
        let axis = direction(all.normals);
        let folds = parts
            .iter()
            .filter(|p| p.normals != V3::ZERO || p.angle > 0.0);
        let reach = folds.map(|p| p.angle + angle(direction(p.normals), axis));
        all.angle = reach.fold(0.0, f32::max);
        all
    }
}
