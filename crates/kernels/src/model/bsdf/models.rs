//! The BSDF models: the set of models that a shading may use, and dispatch to the model that it uses.

/// Defines [`Models`] and the dispatch between models from a list of files in this folder, each with the BSDFs it
/// computes.
///
/// Each file defines these functions of a shading: `albedo`, `gloss`, `evaluate`, `evaluate_backward`, `densities`, `draw`,
/// `weight_backward`, `as_drawn`, `direction_backward` and `lobe`. The methods of [`Shading`] here describe them.
/// Calls begin with `self`, since the code that `cube` adds has the hygiene of a call's first token.
macro_rules! models {
    ($($model:ident: $($bsdf:ident)|+;)+) => {
        /// The models that a shading may use. They are compile-time constants of GPU kernels, so kernels omit models
        /// that a scene does not use.
        #[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
        #[macro_rules_attribute::macro_rules_derive(crate::lanes)]
        pub struct Models {
            $(pub $model: bool),+
        }

        impl Default for Models {
            fn default() -> Self {
                Self::MATT
            }
        }

        impl Models {
            #[cfg(test)]
            pub const ALL: Self = Self {
                $($model: true),+
            };

            pub const MATT: Self = Self::of(BsdfKind::Phong);

            #[inline(always)]
            pub const fn of(bsdf: BsdfKind) -> Self {
                Self {
                    $($model: matches!(bsdf, $(BsdfKind::$bsdf)|+)),+
                }
            }

            /// Returns whether any model other than Phong is in the set.
            #[inline(always)]
            pub fn has_others(self) -> bool {
                false $(|| self.$model && !Self::MATT.$model)+
            }

            pub fn or(self, other: Self) -> Self {
                Self {
                    $($model: self.$model || other.$model),+
                }
            }
        }

        known_to_kernels!(Models);

        /// Tests whether a shading uses a model.
        mod is {
            use super::Shading;
            use crate::cube::*;
            use crate::host::BsdfKind;

            $(
                #[cfg_attr(feature = "gpu", cube)]
                #[inline(always)]
                pub(super) fn $model(shading: &Shading) -> bool {
                    let mut own = true;
                    // All shadings are Phong if no other model is in the set.
                    if comptime!(shading.models.has_others()) {
                        own = false;
                        $(let one = shading.model == const { BsdfKind::$bsdf as u32 };
                        own = own || one;)+
                    }
                    own
                }
            )+
        }

        #[cfg_attr(feature = "gpu", cube)]
        impl Shading {
            /// Returns the approximate color of the surface, whatever the light and the view.
            #[inline(always)]
            pub fn albedo(&self) -> V3 {
                let mut found = splat(0.0);
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        found = self::$model::albedo(self);
                    }
                })+
                found
            }

            /// Returns the probability of the specular lobe, which is roughly its fraction of the scattered light.
            #[inline(always)]
            pub fn gloss(&self) -> f32 {
                let mut found = 0.0f32;
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        found = self::$model::gloss(self);
                    }
                })+
                found
            }

            /// Returns f·cos θ.
            #[inline(always)]
            pub fn evaluate(&self, outgoing: V3) -> V3 {
                let mut found = splat(0.0);
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        found = self::$model::evaluate(self, outgoing);
                    }
                })+
                found
            }

            /// Adds the derivatives of g·f·cos θ, and returns the one with respect to the outgoing direction.
            #[inline(always)]
            pub fn evaluate_backward(
                &self,
                outgoing: V3,
                g: V3,
                gradient: &mut ShadingGradient,
            ) -> V3 {
                let mut found = splat(0.0);
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        found = self::$model::evaluate_backward(self, outgoing, g, gradient);
                    }
                })+
                found
            }

            /// Returns the densities of a direction, about a normal, in the specular lobe and in the other lobe, each
            /// times the lobe's probability.
            #[inline(always)]
            fn densities(&self, normal: V3, outgoing: V3) -> V3 {
                let mut found = splat(0.0);
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        found = self::$model::densities(self, normal, outgoing);
                    }
                })+
                found
            }

            /// Samples a direction about a normal. `drawn` holds the random numbers and a diffuse direction in the
            /// local frame; `lobe` is the random number for the lobe. Sets the weight to 1, except where light is
            /// lost.
            #[inline(always)]
            fn draw(&self, drawn: &mut Scatter, normal: V3, lobe: f32) {
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        self::$model::draw(self, drawn, normal, lobe);
                    }
                })+
            }

            /// Adds the derivatives of g·weight of a sampled direction, and returns the one with respect to the
            /// direction.
            #[inline(always)]
            fn weight_backward(&self, drawn: &Scatter, g: V3, gradient: &mut ShadingGradient) -> V3 {
                let mut found = splat(0.0);
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        found = self::$model::weight_backward(self, drawn, g, gradient);
                    }
                })+
                found
            }

            /// Sets the local direction and the random numbers that would have sampled a direction. Before the call,
            /// they are those of a diffuse surface.
            #[inline(always)]
            fn set_numbers(&self, drawn: &mut Scatter) {
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        self::$model::as_drawn(self, drawn);
                    }
                })+
            }

            /// Adds the derivatives of g·direction of a sampled direction, at fixed random numbers.
            #[inline(always)]
            pub fn direction_backward(
                &self,
                drawn: &Scatter,
                g: V3,
                gradient: &mut ShadingGradient,
            ) {
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        self::$model::direction_backward(self, drawn, g, gradient);
                    }
                })+
            }

            /// Narrows a lobe from the whole hemisphere to the specular lobe or the other lobe, widened by the cone
            /// of rays.
            #[inline(always)]
            fn narrow_lobe(&self, lobe: &mut Lobe, of_gloss: bool, tangent: f32) {
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        self::$model::lobe(self, lobe, of_gloss, tangent);
                    }
                })+
            }

            /// Returns the geometric normal on the side on which a ray leaves. It is flipped if the ray is refracted.
            #[inline(always)]
            pub fn outer(&self, direction: V3) -> V3 {
                let mut normal = self.geometric;
                $(if comptime!(self.models.$model && (false $(|| BsdfKind::$bsdf.refracts())+)) {
                    let refracted = is::$model(self) && self.geometric.dot(direction) < 0.0;
                    if refracted {
                        normal = -normal;
                    }
                })+
                normal
            }
        }
    };
}
pub(super) use models;
