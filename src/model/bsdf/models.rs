//! The models of BSDFs: which of them a shading may be of, and the choice of the one that it is of.

/// Makes [`Models`] and the choice between models from a list of them: a file of this folder each, with the BSDFs that
/// it computes.
///
/// A file has these functions of a shading: `gloss`, `evaluate`, `evaluate_backward`, `densities`, `draw`,
/// `weight_backward`, `as_drawn`, `direction_backward` and `lobe`, which the methods of [`Shading`] here describe. Calls
/// begin with `self`, since what `cube` adds to them has the hygiene of their first word.
macro_rules! models {
    ($($model:ident: $($bsdf:ident)|+;)+) => {
        /// The models that a shading may be of. Kernels on GPUs know them when they are compiled, so that they need not
        /// hold what a scene does not have.
        #[derive(Clone, Copy, Debug, Hash, PartialEq, Eq)]
        #[macro_rules_attribute::macro_rules_derive(crate::lanes::lanes)]
        pub(crate) struct Models {
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

            pub const MATT: Self = Self::of(Bsdf::Phong);

            #[inline(always)]
            pub const fn of(bsdf: Bsdf) -> Self {
                Self {
                    $($model: matches!(bsdf, $(Bsdf::$bsdf)|+)),+
                }
            }

            /// Whether any is not Phong's.
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

        /// Whether a shading is of a model.
        mod is {
            use super::Shading;
            use crate::cube::*;
            use crate::scene::Bsdf;

            $(
                #[cfg_attr(feature = "wgpu", cube)]
                #[inline(always)]
                pub(super) fn $model(shading: &Shading) -> bool {
                    let mut own = true;
                    // All are Phong's where no other model is known.
                    if comptime!(shading.models.has_others()) {
                        own = false;
                        $(let one = shading.model == const { Bsdf::$bsdf as u32 };
                        own = own || one;)+
                    }
                    own
                }
            )+
        }

        #[cfg_attr(feature = "wgpu", cube)]
        impl Shading {
            /// The probability of the specular lobe, about its share of what is scattered.
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

            /// f·cos θ.
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

            /// Adds the derivatives of g·f·cos θ; returns that by the outgoing direction.
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

            /// The densities about a normal of a direction as one of the specular lobe, and as one of the other: each
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

            /// Draws a direction about a normal by the numbers of `drawn`, which has a direction of a matt surface in
            /// its frame, and a number for the lobe. The weight becomes 1, but where light is lost.
            #[inline(always)]
            fn draw(&self, drawn: &mut Scatter, normal: V3, lobe: f32) {
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        self::$model::draw(self, drawn, normal, lobe);
                    }
                })+
            }

            /// Adds the derivatives of g·weight of a direction that was drawn; returns that by the direction.
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

            /// Sets the frame's direction and the numbers that a direction would have been drawn by; those are of a matt
            /// surface before.
            #[inline(always)]
            fn set_numbers(&self, drawn: &mut Scatter) {
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        self::$model::as_drawn(self, drawn);
                    }
                })+
            }

            /// Adds the derivatives of g·direction of a direction that was drawn, at fixed random numbers.
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

            /// Makes the whole hemisphere the glossy lobe or the rest, widened by the cone of rays.
            #[inline(always)]
            fn narrow_lobe(&self, lobe: &mut Lobe, of_gloss: bool, tangent: f32) {
                $(if comptime!(self.models.$model) {
                    if is::$model(self) {
                        self::$model::lobe(self, lobe, of_gloss, tangent);
                    }
                })+
            }

            /// The geometric normal on the side on which a ray leaves: the other one, if it is refracted.
            #[inline(always)]
            pub fn outer(&self, direction: V3) -> V3 {
                let mut normal = self.geometric;
                $(if comptime!(self.models.$model && (false $(|| Bsdf::$bsdf.refracts())+)) {
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
