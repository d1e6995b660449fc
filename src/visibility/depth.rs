//! The range of depths that scores are relative to.

use burn::tensor::Tensor;

use super::rays::Rays;

/// near and far of each ray (Eq. 3): the distances from its origin between which it may meet the bounds of
/// the scene.
#[derive(Clone, Debug)]
pub struct DepthRange {
    pub(super) near: Tensor<2>,
    pub(super) far: Tensor<2>,
    /// A row that is 0 and has the derivative of `far`.
    pub(super) change: Option<Tensor<2>>,
}

impl DepthRange {
    /// For bounds of a radius about the point that origins are relative to. The gradient flows to
    /// the origins, not to the bounds.
    pub fn new(rays: &Rays, radius: f64) -> Self {
        let origin = rays.origin.detached();
        let distance = origin.dot(&origin).sqrt();
        let change = rays.origin.is_tracked().then(|| {
            let away = origin.map(|x| x / distance.clone().clamp_min(1e-6 * radius));
            rays.origin.sub(&origin).dot(&away)
        });
        Self {
            near: (distance.clone() - radius).clamp_min(0.0),
            far: distance + radius,
            change,
        }
    }

    /// The same without gradient.
    #[cfg(test)]
    pub fn detached(self) -> Self {
        Self {
            change: None,
            ..self
        }
    }
}
