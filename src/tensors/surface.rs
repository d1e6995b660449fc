//! Points of the surfaces that paths drew: positions, normals, and BSDF parameters.

use burn::tensor::{Int, Tensor};

use super::rays::Rays;
use crate::error::Result;
use crate::geometry::{
    Context, Nearest, Triangles, Vec3, VertexData, detached, gather_row, host_values,
    nearest_on_triangle,
};
use crate::scene::{ChannelPlanes, Flattened};
use softray_kernels::host::{BsdfKind, Channel, MaterialKind};
use softray_kernels::model::texture::wrapped;

/// Drawn surface points, in rows `[1, N]`.
pub(crate) struct SurfacePoints {
    /// The triangle of each point.
    pub triangle: Vec<u32>,
    /// Position relative to the center of the bounds, at the path's shutter time.
    pub position: Vec3,
    /// Unit geometric normal on the side that the ray came from.
    pub geometric_normal: Vec3,
    /// Unit shading normal on that side.
    pub normal: Vec3,
    /// Whether the two normals may differ.
    pub smooth: bool,
    /// The BSDF parameters, each at its place ([`Channel::place`](softray_kernels::host::Channel::place)).
    pub parameters: Vec<Vec3>,
    /// The microfacet models among the BSDFs.
    pub models: Vec<Model>,
    /// 1 where a ray came from behind the front, which is the inside of a dielectric, else 0.
    pub inside: Tensor<2>,
    /// Texture coordinates, if any material has a texture.
    pub uv: Option<[Tensor<2>; 2]>,
}

/// A microfacet model that some surface points have.
pub(crate) struct Model {
    pub kind: MaterialKind,
    /// 1 for points with this model, else 0.
    pub row: Tensor<2>,
}

impl SurfacePoints {
    pub(crate) fn detached(&self) -> Self {
        self.map(self.triangle.clone(), detached)
    }

    /// Raises the roughness of glossy surfaces to a least value after `bounce` bounces, as [`Shading::roughen`] and the
    /// kernels' points do.
    ///
    /// [`Shading::roughen`]: softray_kernels::model::bsdf::Shading::roughen
    pub(super) fn regularize(&mut self, least: f64, bounce: u32) {
        let place = Channel::Roughness.place();
        let Some(parameter) = self.parameters.get_mut(place).filter(|_| bounce > 0) else {
            return;
        };
        let own = parameter.x.clone();
        let mut new = own.clone().clamp_max(2.0 / least.powi(4) - 2.0);
        for model in &self.models {
            let mut rough = own.clone().clamp_min(least);
            if bounce == 1 && model.kind.bsdf == BsdfKind::Dielectric {
                let inside = self.inside.clone().greater_elem(0.5);
                rough = rough.mask_where(inside, own.clone());
            }
            new = new.mask_where(model.row.clone().greater_elem(0.5), rough);
        }
        parameter.x = new;
    }

    /// Returns these points with BSDF parameters outside of the graph.
    pub(super) fn with_constant_parameters(&self) -> Self {
        let parameters = self.parameters.iter();
        Self {
            parameters: parameters.map(|v| v.map(|x| detached(&x))).collect(),
            ..self.map(self.triangle.clone(), Tensor::clone)
        }
    }

    /// Returns whether each point has a material that refracts. The list is empty if none has.
    pub(crate) fn clear(&self) -> Result<Vec<bool>> {
        let models = self.models.iter().filter(|m| m.kind.bsdf.refracts());
        let rows = models.map(|m| m.row.clone());
        let Some(any) = rows.reduce(|a, b| a + b) else {
            return Ok(Vec::new());
        };
        Ok(host_values(&any)?.iter().map(|&x| x > 0.5).collect())
    }

    /// Returns the listed points, in any order, each as often as it is listed.
    pub(crate) fn pick(&self, context: &Context, which: &[u32]) -> Self {
        let index = context.index_row(which);
        let triangle = which.iter().map(|&i| self.triangle[i as usize]).collect();
        self.map(triangle, |v| gather_row(v.clone(), &index))
    }

    /// Returns rays that leave the points.
    pub(crate) fn ray(&self, direction: Vec3, time: Option<Tensor<2>>) -> Rays {
        Rays {
            origin: self.position.clone(),
            direction,
            time,
            departure: Some(self.triangle.clone()),
            arrival: None,
        }
    }

    fn map(&self, triangle: Vec<u32>, f: impl Fn(&Tensor<2>) -> Tensor<2>) -> Self {
        let vector = |v: &Vec3| v.map(|x| f(&x));
        Self {
            triangle,
            position: vector(&self.position),
            geometric_normal: vector(&self.geometric_normal),
            normal: vector(&self.normal),
            smooth: self.smooth,
            parameters: self.parameters.iter().map(vector).collect(),
            models: (self.models.iter())
                .map(|m| Model {
                    kind: m.kind,
                    row: f(&m.row),
                })
                .collect(),
            inside: f(&self.inside),
            uv: self.uv.as_ref().map(|uv| uv.each_ref().map(&f)),
        }
    }

    /// Intersects each ray with its drawn triangle. The points are tracked with rays and scene.
    pub(crate) fn new(scene: &Flattened, rays: &Rays, triangle: Vec<u32>) -> Result<Self> {
        let context = &scene.context;
        let triangles = &scene.triangles;
        let index = context.index_row(&triangle);
        let normal = triangles.normal.gather(&index);
        let velocity = triangles.velocity.as_ref().map(|v| v.gather(&index));
        let shifted = rays.origin_for(velocity.as_ref());
        let gather = |p: &Tensor<2>| gather_row(p.clone(), &index);
        let cosine = normal.dot(&rays.direction);
        let t = (gather(&triangles.plane) - normal.dot(&shifted)) / cosine.clone();
        let position = rays.origin.add(&rays.direction.scale(&t));

        let front = detached(&cosine)
            .lower_elem(0.0)
            .float()
            .cast(context.dtype);
        let side = front * 2.0 - 1.0;
        let geometric_normal = normal.scale(&side);

        let interpolates = scene.uvs.is_some() || scene.normals.is_some() || scene.colors.is_some();
        let point = || shifted.add(&rays.direction.scale(&t));
        let barycentrics = interpolates.then(|| barycentrics(triangles, &index, &point()));
        let normal = match (&scene.normals, &barycentrics) {
            (Some((corners, smooth)), Some((b, c, nearest))) => {
                let smooth = triangle.iter().map(|&k| smooth[k as usize]);
                let near = &at_nearest(b, c, nearest);
                shading_normals(context, corners, &index, smooth, near, &geometric_normal)
            }
            _ => geometric_normal.clone(),
        };
        let uv = match (&scene.uvs, &barycentrics) {
            (Some(corners), Some((b, c, _))) => {
                // Outside the triangle, the coordinates are extrapolated.
                let a = (b.clone() + c.clone()).neg() + 1.0;
                let interpolate = |f: fn(&Vec3) -> &Tensor<2>| {
                    gather(f(&corners.a)) * a.clone()
                        + gather(f(&corners.b)) * b.clone()
                        + gather(f(&corners.c)) * c.clone()
                };
                Some([interpolate(|v| &v.x), interpolate(|v| &v.y)])
            }
            _ => None,
        };
        let materials: Vec<u32> = triangle
            .iter()
            .map(|&k| scene.topology.material[k as usize])
            .collect();
        let material = context.index_row(&materials);
        let kind = scene.materials.kind();
        let parameters = (0..kind.shading()).map(|place| {
            let channel = scene.materials.channel(place);
            look_up(context, channel, &materials, &material, &uv)
        });
        let mut parameters = parameters.collect::<Result<Vec<Vec3>>>()?;
        let near = barycentrics.map(|(b, c, nearest)| at_nearest(&b, &c, &nearest));
        if let (Some(corners), Some(near)) = (&scene.colors, &near) {
            let color = interpolated(corners, &index, near);
            tint(scene, &materials, &color, &mut parameters);
        }
        let normal = match (&scene.tilts, &near) {
            (Some(tilts), Some(near)) => {
                let texel = look_up(context, &tilts.maps, &materials, &material, &uv)?;
                let tangent = interpolated(&tilts.tangents, &index, near);
                let sides = triangle.iter().map(|&k| tilts.sides[k as usize]);
                let front = normal.scale(&side);
                tilted(context, &front, &tangent, sides, &texel).scale(&side)
            }
            _ => normal,
        };
        Ok(Self {
            triangle,
            position,
            geometric_normal,
            normal,
            smooth: scene.normals.is_some() || scene.tilts.is_some(),
            parameters,
            models: models(scene, &materials),
            inside: (side.neg() + 1.0) * 0.5,
            uv,
        })
    }
}

/// Returns the weights of corners b and c at points of triangles, and the nearest points of the triangles' borders.
fn barycentrics(
    triangles: &Triangles,
    index: &Tensor<2, Int>,
    point: &Vec3,
) -> (Tensor<2>, Tensor<2>, Nearest) {
    let from_a = point.sub(&triangles.corners.a.gather(index));
    let x = triangles.u.gather(index).dot(&from_a);
    let y = triangles.v.gather(index).dot(&from_a);
    let gather = |p: &Tensor<2>| gather_row(p.clone(), index);
    let (base, apex_u, apex_v) = (
        gather(&triangles.base),
        gather(&triangles.apex_u),
        gather(&triangles.apex_v),
    );
    let c = y.clone() / apex_v.clone();
    let b = (x.clone() - c.clone() * apex_u.clone()) / base.clone();
    let nearest = nearest_on_triangle(&detached(&x), &detached(&y), &base, &apex_u, &apex_v);
    (b, c, nearest)
}

/// Multiplies the base colors of tinted materials by the colors of meshes.
fn tint(scene: &Flattened, materials: &[u32], color: &Vec3, parameters: &mut [Vec3]) {
    let plain = |m: &u32| !scene.materials.kinds[*m as usize].bsdf.is_tinted();
    let plain: Vec<f64> = materials
        .iter()
        .map(|m| u8::from(plain(m)).into())
        .collect();
    let plain = scene.context.row(&plain).greater_elem(0.5);
    let base = &mut parameters[Channel::Diffuse.place()];
    *base = base.mul(&color.map(|x| x.mask_fill(plain.clone(), 1.0)));
}

/// Returns the weights of corners b and c of the hit, or of the triangle's nearest point if the hit is outside.
fn at_nearest(b: &Tensor<2>, c: &Tensor<2>, nearest: &Nearest) -> [Tensor<2>; 2] {
    let outside = nearest.inside.clone().bool_not();
    let b = b.clone();
    let b = b.mask_where(outside.clone(), nearest.weight_b.clone());
    [b, c.clone().mask_where(outside, nearest.weight_c.clone())]
}

/// Interpolates values at corners by the weights of b and c.
fn interpolated(corners: &VertexData, index: &Tensor<2, Int>, [b, c]: &[Tensor<2>; 2]) -> Vec3 {
    let a = (b.clone() + c.clone()).neg() + 1.0;
    let at = |v: &Vec3| v.gather(index);
    at(&corners.a)
        .scale(&a)
        .add(&at(&corners.b).scale(b))
        .add(&at(&corners.c).scale(c))
}

/// Returns unit normals on the front side, tilted by texels of normal maps (`softray_kernels::model::normal_map`). Normals of
/// triangles without tangents, whose side is 0, are unchanged.
fn tilted(
    context: &Context,
    normal: &Vec3,
    tangent: &Vec3,
    sides: impl Iterator<Item = f64>,
    texel: &Vec3,
) -> Vec3 {
    let side = context.row(&sides.collect::<Vec<_>>());
    let across = tangent.sub(&normal.scale(&normal.dot(tangent)));
    let square = across.dot(&across);
    let none = detached(&square).lower_elem(1e-30);
    let without = none.bool_or(side.clone().equal_elem(0.0));
    let length = square.mask_fill(without.clone(), 1.0).sqrt();
    let tangent = across.map(|x| x / length.clone());
    let bitangent = normal.cross(&tangent).scale(&side);
    let sum = tangent
        .scale(&texel.x)
        .add(&bitangent.scale(&texel.y))
        .add(&normal.scale(&texel.z));
    let square = sum.dot(&sum);
    let without = without.bool_or(detached(&square).lower_elem(1e-30));
    let length = square.mask_fill(without.clone(), 1.0).sqrt();
    sum.zip(normal, |s, n| {
        (s / length.clone()).mask_where(without.clone(), n)
    })
}

/// Returns unit normals interpolated between corners, on the side of the geometric normals. A triangle that is not
/// smooth has its geometric normal.
fn shading_normals(
    context: &Context,
    corners: &VertexData,
    index: &Tensor<2, Int>,
    smooth: impl Iterator<Item = bool>,
    weights: &[Tensor<2>; 2],
    geometric_normal: &Vec3,
) -> Vec3 {
    let shading = interpolated(corners, index, weights);
    let flat: Vec<f64> = smooth.map(|s| if s { 0.0 } else { 1.0 }).collect();
    let flat = context.row(&flat).greater_elem(0.5);
    // Objects without normals have zeros here, which are replaced before the square root.
    let shading = shading.zip(geometric_normal, |s, g| s.mask_where(flat.clone(), g));
    let facing = detached(&shading.dot(geometric_normal));
    let flip = facing.greater_equal_elem(0.0).float().cast(context.dtype) * 2.0 - 1.0;
    shading.normalized().scale(&flip)
}

/// Returns the microfacet models of points with the given materials.
fn models(scene: &Flattened, materials: &[u32]) -> Vec<Model> {
    let of = |&m: &u32| {
        let kind = scene.materials.kinds[m as usize];
        (kind.bsdf, kind.compensated)
    };
    let mut found: Vec<(MaterialKind, _)> = Vec::new();
    for m in materials {
        let new = found.iter().all(|f| f.1 != of(m));
        if new && of(m).0 != BsdfKind::Phong {
            found.push((scene.materials.kinds[*m as usize], of(m)));
        }
    }
    let of_one = |(kind, which)| {
        let has = |m: &u32| f64::from(u8::from(of(m) == which));
        let row = materials.iter().map(has).collect::<Vec<_>>();
        Model {
            kind,
            row: scene.context.row(&row),
        }
    };
    found.into_iter().map(of_one).collect()
}

/// Returns a parameter of materials at surface points `[1, N]`: the constant of each material, or its texture at the
/// coordinates `uv`. It is tracked with the parameter and the coordinates.
pub(crate) fn look_up(
    context: &Context,
    channel: &ChannelPlanes,
    materials: &[u32],
    index: &Tensor<2, Int>,
    uv: &Option<[Tensor<2>; 2]>,
) -> Result<Vec3> {
    let constant = channel.constant.gather(index);
    let (Some(atlas), Some([u, v])) = (&channel.atlas, uv) else {
        return Ok(constant);
    };
    let slots: Vec<_> = materials
        .iter()
        .map(|&m| channel.texture[m as usize])
        .collect();
    if slots.iter().all(Option::is_none) {
        return Ok(constant);
    }
    let n = slots.len();
    let size = |f: &dyn Fn(usize) -> usize| -> Vec<f64> { (0..n).map(|i| f(i) as f64).collect() };
    let width = size(&|i| slots[i].map_or(1, |s| s.width));
    let height = size(&|i| slots[i].map_or(1, |s| s.height));
    // Texel centers are at half-integers, and row 0 is at the top (v = 1).
    let x = u.clone() * context.row(&width) - 0.5;
    let y = (v.clone().neg() + 1.0) * context.row(&height) - 0.5;
    let (left, top) = (detached(&x).floor(), detached(&y).floor());
    let (host_left, host_top) = (host_values(&left)?, host_values(&top)?);
    let (fx, fy) = (x - left, y - top);
    let texel = |dx: i32, dy: i32| -> Vec3 {
        let at: Vec<u32> = (0..n)
            .map(|i| {
                slots[i].map_or(0, |s| {
                    let wrap = s.wrap as u32;
                    let column = wrapped(
                        host_left[i].clamp(-1e9, 1e9) as i32 + dx,
                        s.width as u32,
                        wrap,
                    );
                    let row = wrapped(
                        host_top[i].clamp(-1e9, 1e9) as i32 + dy,
                        s.height as u32,
                        wrap,
                    );
                    s.offset as u32 + row * s.width as u32 + column
                })
            })
            .collect();
        atlas.gather(&context.index_row(&at))
    };
    let mix = |a: Vec3, b: Vec3, f: &Tensor<2>| a.add(&b.sub(&a).scale(f));
    let upper = mix(texel(0, 0), texel(1, 0), &fx);
    let lower = mix(texel(0, 1), texel(1, 1), &fx);
    let textured: Vec<f64> = slots
        .iter()
        .map(|s| if s.is_some() { 1.0 } else { 0.0 })
        .collect();
    let textured = context.row(&textured).greater_elem(0.5);
    Ok(constant.zip(&mix(upper, lower, &fy), |c, t| {
        c.mask_where(textured.clone(), t)
    }))
}
