//! Derivatives along rays that follow the material which they reach.
//!
//! Let F be the integrand over the film, or over the directions of a bounce. For any field V of velocities of its points,
//! the derivative of ∫ F is ∫ [∂F/∂t + ∇·(F V)], plus at each edge the flux of F · (velocity of the edge − V) on both
//! sides (Reynolds transport). Fixed film points and sampled directions have V = V₀. With the velocity v of the material
//! point that a ray reaches, nothing jumps at a fold whose two faces are visible, and nothing grows as 1/cos θ where a
//! surface is seen at a grazing angle; but ∇·(F V) has noise in proportion to F. So V = V₀ + (1 − u)(v − V₀), where u is
//! the part that is left of V₀ ([`Scene::left_at`]).
//!
//! For the directions of a bounce, V₀ is that of fixed random numbers: ∇·(F V₀) is the attached derivative A minus the
//! detached one D. So the derivative is u A + (1 − u) (D + ∇·(F v)) + F ∇u·(V₀ − v). The terms in v are those of
//! [`follow_backward`], and the others those of [`Shading::sample_backward`]. On the film, ∇·(F V) times the pixel filters is
//! − F V·∇ of the loss between pixels ([`FilmSlopes`]).
//!
//! ∇·(F v) contains the derivative of the solid angle, or of the area on the film, in which the material is seen. F is taken
//! without a constant for each material ([`Scene::expected`]). The rest, an integral of a constant over what is seen, changes
//! only at edges, which take the same constant off.

use crate::cube::*;

use super::corners::facing;
use super::parts::{AREAS, TRIANGLES};
use super::pixel::Seen;
#[cfg(feature = "gpu")]
use super::scene::SceneExpand;
use super::scene::{FILTER, FOLLOWED, FOLLOWING, Scene};
use super::sums::{Sums, add_to_camera};
use super::surface::{Point, RayGradient};
use crate::host::BsdfKind;
use crate::model::bsdf::{Shading, ShadingGradient, Turning};
use crate::model::camera::{Camera, CameraGradient, CameraRay};
use crate::model::edge_weight::left_of_crease;
use crate::model::filter::filter_at;
use crate::model::lists::vector;
use crate::model::{V2, V3, splat, v2, v3};

/// The cosine to smooth normals below which rays follow the surface: wholly at 0. The lower one is for flat faces on the film,
/// and for rays from glossy points, whose lobes are narrow.
const GRAZING: f32 = 0.8;
const LOW_GRAZING: f32 = 0.2;

/// The roughness below which directions to an environment map turn with the lobe.
pub const POLISHED: f32 = 0.12;

/// Where a ray comes from that may follow the material.
#[apply(record!)]
pub struct Origin {
    /// Whether it is the camera, or a point whose BSDF is matt.
    pub on_film: bool,
    pub evenly: bool,
}

/// The part of a ray's motion that is left where it follows the material, and its derivatives with respect to the ray.
#[apply(record!)]
pub struct Left {
    pub part: f32,
    by_ray: RayGradient,
}

#[cfg_attr(feature = "gpu", cube)]
impl<'a> Scene<'a> {
    /// Returns whether directions of bounces may follow the material, which cones blur.
    #[inline(always)]
    pub fn follows(&self) -> bool {
        let mut follows = false;
        if comptime!(self.features.glossy && !self.features.cones) {
            follows = self.settings[FOLLOWING] >= 0.0;
        }
        follows
    }

    /// Returns how much a direction turns that is sampled at a point.
    #[inline(always)]
    pub fn turning(&self, shading: &Shading, direction: V3, of_gloss: bool) -> Turning {
        let mut turning = Turning::freely();
        if comptime!(!self.features.cones) && self.settings[FOLLOWING] >= 0.0 {
            turning = shading.turning(direction, of_gloss);
        }
        turning
    }

    /// Returns whether the directions turn in which light of an environment map arrives, as those do that are sampled from
    /// the BSDF. Otherwise they are fixed: a narrow lobe that moves over fixed directions has much noise.
    #[inline(always)]
    pub fn turns_to_map(&self, shading: &Shading) -> bool {
        let mut turns = false;
        if comptime!(self.features.turns_to_map) {
            turns = shading.is_smoother_than(POLISHED);
        }
        turns
    }

    /// Returns whether camera rays may follow the material. A filter without a slope cannot move, and the widths of cones
    /// may depend on the camera.
    #[inline(always)]
    pub fn follows_on_film(&self) -> bool {
        let mut follows = false;
        if comptime!(self.features.follows_on_film()) {
            follows = self.settings[FOLLOWING] >= 0.0 && self.settings[FILTER] > 0.0;
        }
        follows
    }

    /// Returns whether bounces follow all faces of a material: at creases of glossy faces, light has much noise.
    #[inline(always)]
    pub fn is_followed(&self, material: u32) -> bool {
        self.bits_of(material) & FOLLOWED != 0
    }

    /// Returns the radiance of a constant environment, otherwise 0.
    #[inline(always)]
    pub fn everywhere(&self) -> V3 {
        let mut radiance = splat(0.0);
        if comptime!(self.features.sky_constant) {
            radiance = vector(self.sky, 0u32);
        }
        radiance
    }

    /// Returns whether all camera rays to a triangle follow it: a flat face of glass. What is seen through it would pass by
    /// at 1/cos θ times its speed, with all edges behind it.
    #[inline(always)]
    pub fn is_carried(&self, triangle: u32) -> bool {
        let mut carried = false;
        if comptime!(self.features.models.dielectric) {
            let model = self.model_of(self.material_of(triangle));
            let refracts = model == const { BsdfKind::Dielectric as u32 };
            carried = refracts && !self.normal_rows(triangle).exist();
        }
        carried
    }

    /// Returns a constant that is about the light of a material: the radiance of a constant environment times its color.
    #[inline(always)]
    pub fn expected(&self, material: u32) -> V3 {
        let mut color = splat(1.0);
        if comptime!(self.features.sky_constant) {
            let model = self.model_of(material);
            if model != const { BsdfKind::Conductor as u32 } {
                color = self.constant_of(material, 0u32);
            }
            if model == const { BsdfKind::Phong as u32 } {
                color += self.constant_of(material, 1u32);
            }
        }
        self.everywhere().times(color)
    }

    /// Returns how much is left of the motion of a ray that reaches a point of a triangle, seen from its side
    /// `geometric`. It falls with the distance from glossy faces if the ray comes from a matt point, and with the cosine to
    /// smooth normals or, for camera rays, to any.
    #[inline(always)]
    pub fn left_at(
        &self,
        triangle: u32,
        weights: V3,
        geometric: V3,
        distance: f32,
        direction: V3,
        from: Origin,
    ) -> Left {
        let per_facing = 1.0 / geometric.dot(direction);
        let mut part = 1.0f32;
        let mut by_ray = RayGradient::default();
        let followed = self.is_followed(self.material_of(triangle));
        if followed && from.on_film {
            part = select(self.is_carried(triangle), 0.0, 1.0);
        } else if followed && from.evenly {
            part = left_of_crease(distance, self.settings[FOLLOWING]);
            // The derivative with respect to log r is −4 u (1 − u).
            let slope = 4.0 * part * (1.0 - part);
            by_ray.direction = geometric * (slope * per_facing);
            by_ray.origin = by_ray.direction * (1.0 / distance);
        }
        let mut normal = geometric;
        // The derivative of n·ω with respect to the point of the triangle that is hit.
        let mut by_point = splat(0.0);
        let mut band = select(from.on_film, LOW_GRAZING, 0.0f32);
        if comptime!(self.features.smooth) {
            let rows = self.normal_rows(triangle);
            if rows.exist() {
                band = select(from.on_film || from.evenly, GRAZING, LOW_GRAZING);
                let corners = rows.of(self.normals, 3u32);
                let at = facing(corners.at(weights), geometric);
                normal = at.normal;
                let by_sum = direction.reject_from_normalized(normal) * at.factor;
                let slopes = self.triangle(triangle).slopes();
                by_point = slopes.first * by_sum.dot(corners.b - corners.a)
                    + slopes.second * by_sum.dot(corners.c - corners.a);
            }
        }
        let cosine = max(-normal.dot(direction), 0.0);
        if followed && cosine < band {
            let square = cosine * cosine / (band * band);
            let left = square * (2.0 - square);
            let by_cosine = (1.0 - square) * cosine * (-4.0f32 / (band * band)) * part;
            let along = by_point.dot(direction) * per_facing;
            let by_origin = (by_point - geometric * along) * by_cosine;
            by_ray.origin = by_ray.origin * left + by_origin;
            by_ray.direction = by_ray.direction * left + normal * by_cosine + by_origin * distance;
            part *= left;
        }
        Left { part, by_ray }
    }

    /// Adds the derivatives with respect to the material at a point: those of its position, and of the logarithm of its
    /// area seen along a direction, times `counts`.
    #[inline(always)]
    fn add_to_material(
        &self,
        sums: &Sums,
        p: &Point,
        by_position: V3,
        counts: f32,
        direction: V3,
        time: f32,
    ) {
        if comptime!(sums.of.objects) && self.is_wanted(p.object) {
            self.add_to_corners(sums, p.triangle, p.weights, by_position, time);
            let per_facing = counts * p.side / p.shading.geometric.dot(direction);
            sums.add_vector(3 * p.triangle, direction * per_facing, TRIANGLES);
            let area = self.triangle(p.triangle).area;
            sums.add(p.triangle, counts / area, AREAS);
        }
    }
}

/// Returns the derivatives with respect to a bounce ray from the point `x` to the point `y` whose direction follows the
/// material of `y`, from those of a ray with the sampled direction, and adds the derivatives with respect to this material.
/// `g` is the derivative of the light at the path's beginning, and `by_throughput` that of the throughput at `y`.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn follow_backward(
    scene: &Scene,
    sums: &Sums,
    x: &Point,
    y: &Point,
    throughput: V3,
    by_throughput: V3,
    g: V3,
    time: f32,
    by_ray: RayGradient,
) -> RayGradient {
    let mut by = by_ray;
    let follows = scene.follows();
    if comptime!(sums.of.rays && scene.features.glossy) && follows {
        let (r, direction, normal) = (y.distance, y.shading.incoming, y.shading.geometric);
        let from = Origin {
            on_film: false.runtime(),
            evenly: x.shading.scatters_evenly(),
        };
        let left: Left = scene.left_at(y.triangle, y.weights, normal, r, direction, from);
        let share = 1.0 - left.part;
        if share > 0.0 {
            let of_y = scene.material_of(y.triangle);
            let light = throughput.times(by_throughput - g.times(scene.expected(of_y)));
            let sum = light.element_sum();
            let counts = share * sum;
            let reflected = x.shading.evaluate(direction).max(splat(f32::MIN_POSITIVE));
            let by_reflected = v3(
                light.x / reflected.x,
                light.y / reflected.y,
                light.z / reflected.z,
            ) * share;
            let mut unused = ShadingGradient::default();
            let by_lobe = x
                .shading
                .evaluate_backward(direction, by_reflected, &mut unused);
            let by_way = by.direction * share + by_lobe - left.by_ray.direction * sum;
            by.share = share;
            by.by_share = -left.by_ray.direction;
            // The solid angle of a part of the material is its area · |n·d| / r³, with d from x to y.
            let by_angle = normal * (counts / normal.dot(direction)) - direction * (3.0 * counts);
            let across = by_way.reject_from_normalized(direction);
            let by_point = (across + by_angle) * (1.0 / r);
            by.origin -= by_point;
            scene.add_to_material(sums, y, by_point, counts, direction, time);
        }
    }
    by
}

/// The slope along the film, at a film point, of the derivative of the loss with respect to what is seen there: the sum over
/// pixels of their derivatives times the slopes of their filters. Each sample counts for all pixels that see its point, so
/// that it is divided by the sum of their filters.
#[apply(zeroed!)]
pub struct FilmSlopes {
    x: Seen,
    y: Seen,
    density: f32,
}

#[cfg_attr(feature = "gpu", cube)]
impl FilmSlopes {
    /// Adds a pixel with the derivatives `g`, from whose center the point is at an offset.
    #[inline(always)]
    pub fn add(&mut self, scene: &Scene, g: &Seen, offset: V2) {
        let radius = scene.settings[FILTER];
        let x = filter_at(offset.x, radius);
        let y = filter_at(offset.y, radius);
        self.x.add(g, x.y * y.x);
        self.y.add(g, x.x * y.y);
        self.density += x.x * y.x;
    }
}

impl FilmSlopes {
    /// Returns it for derivatives times a factor.
    pub fn times(mut self, factor: f32) -> Self {
        (self.x, self.y) = (self.x.times(factor), self.y.times(factor));
        self
    }
}

/// Returns the first of the rows or columns of pixels that see a film point, and the one after the last, of `count`.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn pixels_around(scene: &Scene, at: f32, count: u32) -> PixelRange {
    let radius = scene.settings[FILTER];
    let most = count as f32;
    PixelRange {
        first: (at - 1.0 - radius).ceil().clamp(0.0, most) as u32,
        past: ((at + radius).floor() + 1.0).clamp(0.0, most) as u32,
    }
}

/// A range of rows or columns.
#[apply(record!)]
pub struct PixelRange {
    pub first: u32,
    pub past: u32,
}

/// Adds the derivatives due to a camera ray that follows the material at its point `y`. They are those that a fixed film
/// point, with the derivatives `by_ray`, leaves out. `upstream` is the derivative of what the camera sees, `slopes` its slope
/// on the film, and `radiance` the light of the path.
#[cfg_attr(feature = "gpu", cube)]
#[inline(always)]
pub fn follow_on_film(
    scene: &Scene,
    sums: &Sums,
    c: &Camera,
    ray: &CameraRay,
    y: &Point,
    upstream: &Seen,
    slopes: &FilmSlopes,
    radiance: V3,
    time: f32,
    by_ray: &RayGradient,
) {
    let follows = scene.follows_on_film();
    if comptime!(sums.of.objects || sums.of.camera) && follows {
        let (direction, normal) = (ray.direction, y.shading.geometric);
        let from = Origin {
            on_film: true.runtime(),
            evenly: false.runtime(),
        };
        let left: Left = scene.left_at(y.triangle, y.weights, normal, y.distance, direction, from);
        let share = 1.0 - left.part;
        if share > 0.0 {
            let seen = Seen {
                radiance: radiance - scene.expected(scene.material_of(y.triangle)),
                opacity: 1.0f32.runtime(),
                depth: y.distance,
                normal,
            };
            let light = upstream.jump(&seen);
            let counts = share * light;
            let mut by_camera = CameraGradient::default();
            let per_density = share / max(slopes.density, 1e-12);
            let of_light = c.film_backward(ray, by_ray.origin, by_ray.direction);
            let of_left = c.film_backward(ray, left.by_ray.origin, left.by_ray.direction);
            let by_film = v2(
                of_light.x * share + slopes.x.jump(&seen) * per_density - of_left.x * light,
                of_light.y * share + slopes.y.jump(&seen) * per_density - of_left.y * light,
            );
            let at = y.position;
            let mut by_point =
                c.project_backward(at, ray.lens_x, ray.lens_y, by_film, &mut by_camera);
            by_point += c.area_backward(ray, at, normal, counts, &mut by_camera);
            scene.add_to_material(sums, y, by_point, counts, direction, time);
            if comptime!(sums.of.camera) {
                add_to_camera(sums, &by_camera);
            }
        }
    }
}
