//! The coordinates in which a scene is traced.

use glam::DVec3;

use super::HostScene;

/// The coordinates in which a scene is traced: relative to a centre, in a unit that is a power of two, so that
/// nothing rounds. Both are medians over the vertices: what lies far away from the rest does not count.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SceneFrame {
    pub centre: DVec3,
    pub unit: f64,
}

impl SceneFrame {
    pub fn new(scene: &HostScene) -> Self {
        let count: usize = scene.objects.iter().map(|o| o.positions.len()).sum();
        let all = || scene.objects.iter().flat_map(|o| &o.positions);
        // Some of many serve as well.
        let stride = (count / 4096).max(1);
        let some: Vec<DVec3> = all().step_by(stride).map(|&p| p.into()).collect();
        let median = |mut values: Vec<f64>| -> f64 {
            let middle = values.len() / 2;
            if values.is_empty() {
                return 0.0;
            }
            *values.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        let along = |axis: usize| median(some.iter().map(|p| p[axis]).collect());
        let centre = DVec3::new(along(0), along(1), along(2));
        let spread = |from: DVec3| median(some.iter().map(|p| p.distance(from)).collect());
        // Coordinates that are not far from their origin stay as they are, which rounds nothing.
        let near = spread(centre);
        let (centre, size) = if centre.length() > 16.0 * near {
            (centre, near)
        } else {
            (DVec3::ZERO, spread(DVec3::ZERO))
        };
        let size = if size > 0.0 && size.is_finite() {
            size
        } else {
            1.0
        };
        Self {
            centre,
            unit: size.log2().round().exp2(),
        }
    }

    /// A point in scene units, in the coordinates of the frame.
    pub fn inner(&self, p: DVec3) -> DVec3 {
        (p - self.centre) / self.unit
    }
}
