//! Points on triangles on the host: barycentric coordinates, textures and shading normals, and their
//! derivatives.

use glam::{DVec2, DVec3};

use super::sums::Sums;
use super::tables::Host;
use crate::accel::HostTriangle;
use crate::scene::TextureSlot;
use crate::visibility::Surface;

/// Texels, in the order of the corners of a cell, and where in the cell a point lies.
#[derive(Clone, Copy, Debug)]
struct Cell {
    texels: [usize; 4],
    at: DVec2,
}

impl Cell {
    /// Texel centres at half-integers, row 0 at the top (v = 1).
    fn new(slot: &TextureSlot, uv: DVec2) -> Self {
        let x = uv.x * slot.width as f64 - 0.5;
        let y = (1.0 - uv.y) * slot.height as f64 - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let texel = |dx: i64, dy: i64| {
            let column = slot.wrap.texel(left as i64 + dx, slot.width);
            let row = slot.wrap.texel(top as i64 + dy, slot.height);
            slot.offset + row * slot.width + column
        };
        Self {
            texels: [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)],
            at: DVec2::new(x - left, y - top),
        }
    }

    fn weights(&self) -> [f64; 4] {
        let (x, y) = (self.at.x, self.at.y);
        [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y]
    }

    fn value(&self, atlas: &[DVec3]) -> DVec3 {
        let corners = self.texels.iter().zip(self.weights());
        corners.map(|(&t, w)| atlas[t] * w).sum()
    }
}

/// An albedo of a material, constant or a texture.
#[derive(Clone, Debug, Default)]
pub(super) struct HostAlbedos {
    pub constant: Vec<DVec3>,
    pub texture: Vec<Option<TextureSlot>>,
    pub atlas: Vec<DVec3>,
}

impl HostAlbedos {
    #[inline(always)]
    pub fn at(&self, material: usize, uv: DVec2) -> DVec3 {
        match &self.texture[material] {
            Some(slot) => self.texel(slot, uv),
            None => self.constant[material],
        }
    }

    #[inline(never)]
    fn texel(&self, slot: &TextureSlot, uv: DVec2) -> DVec3 {
        Cell::new(slot, uv).value(&self.atlas)
    }

    /// Adds derivatives by constants or texels; returns that by the coordinates.
    #[inline(always)]
    pub fn pull(
        &self,
        material: usize,
        uv: DVec2,
        g: DVec3,
        (constants, texels): (&mut [DVec3], &mut [DVec3]),
    ) -> DVec2 {
        match &self.texture[material] {
            Some(slot) => self.pull_texels(slot, uv, g, texels),
            None => {
                constants[material] += g;
                DVec2::ZERO
            }
        }
    }

    #[inline(never)]
    fn pull_texels(&self, slot: &TextureSlot, uv: DVec2, g: DVec3, texels: &mut [DVec3]) -> DVec2 {
        let cell = Cell::new(slot, uv);
        for (&t, w) in cell.texels.iter().zip(cell.weights()) {
            texels[t] += g * w;
        }
        let [a, b, c, d] = cell.texels.map(|t| self.atlas[t].dot(g));
        let (x, y) = (cell.at.x, cell.at.y);
        let by_x = (1.0 - y) * (b - a) + y * (d - c);
        let by_y = (1.0 - x) * (c - a) + x * (d - b);
        DVec2::new(by_x * slot.width as f64, -by_y * slot.height as f64)
    }
}

/// ∂/∂x of the barycentric coordinates b and c of a point of a triangle's plane.
fn slopes(triangle: &HostTriangle) -> [DVec3; 2] {
    let [a, b, c] = triangle.corners;
    let (ab, ac) = (b - a, c - a);
    let n = ab.cross(ac);
    let square = n.length_squared();
    [ac.cross(n) / square, n.cross(ab) / square]
}

/// What corner attributes make of a point: coordinates of textures and the shading normal.
pub(super) struct Attributes {
    pub uv: DVec2,
    /// None where the surface is flat.
    pub normal: Option<DVec3>,
}

/// Where on a triangle a point lies.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub triangle: u32,
    /// Barycentric coordinates of the point, outside of the triangle too.
    pub weights: [f64; 3],
    /// Those of the nearest point of its border, and whether it lies inside.
    pub border: [f64; 3],
    pub inside: bool,
    /// The geometric normal on the side that the ray came from.
    pub geometric: DVec3,
}

impl Place {
    /// Of what a ray met, with its normal on the side that the ray came from.
    #[inline(always)]
    pub fn of(s: &Surface, geometric: DVec3) -> Self {
        Self {
            triangle: s.triangle,
            weights: s.hit,
            border: s.border,
            inside: s.sign > 0.0,
            geometric,
        }
    }

    fn smooth_weights(&self) -> [f64; 3] {
        if self.inside {
            self.weights
        } else {
            self.border
        }
    }

    #[inline(always)]
    pub fn attributes(&self, host: &Host) -> Attributes {
        let k = self.triangle as usize;
        let uv = host.uvs.as_ref().map_or(DVec2::ZERO, |uvs| {
            let corners = uvs[k].iter().zip(self.weights);
            corners.map(|(&v, w)| v * w).sum()
        });
        let normal = self.sum_of_normals(host).map(|sum| {
            let facing = if sum.dot(self.geometric) >= 0.0 {
                1.0
            } else {
                -1.0
            };
            sum / sum.length() * facing
        });
        Attributes { uv, normal }
    }

    #[inline(always)]
    fn sum_of_normals(&self, host: &Host) -> Option<DVec3> {
        let k = self.triangle as usize;
        let (normals, smooth) = host.normals.as_ref()?;
        smooth[k].then(|| {
            let corners = normals[k].iter().zip(self.smooth_weights());
            corners.map(|(&n, w)| n * w).sum()
        })
    }

    /// Adds derivatives by the attributes; returns that by the point, less at each corner by its
    /// weight. `by_normal` counts where the surface is smooth.
    #[inline(never)]
    pub fn pull(
        &self,
        host: &Host,
        triangle: &HostTriangle,
        by_uv: DVec2,
        by_normal: DVec3,
        sums: &mut Sums,
    ) -> DVec3 {
        let k = self.triangle as usize;
        let (mut by_b, mut by_c) = (0.0, 0.0);
        if let Some(uvs) = &host.uvs
            && by_uv != DVec2::ZERO
        {
            let [a, b, c] = uvs[k];
            by_b += by_uv.dot(b - a);
            by_c += by_uv.dot(c - a);
            for (sum, w) in sums.uvs[k].iter_mut().zip(self.weights) {
                *sum += by_uv * w;
            }
        }
        if let (Some(sum), Some((normals, _))) = (self.sum_of_normals(host), &host.normals) {
            let length = sum.length();
            let facing = if sum.dot(self.geometric) >= 0.0 {
                1.0
            } else {
                -1.0
            };
            let unit = sum / length;
            let g = by_normal * facing;
            let by_sum = (g - unit * unit.dot(g)) / length;
            for (sum, w) in sums.normals[k].iter_mut().zip(self.smooth_weights()) {
                *sum += by_sum * w;
            }
            if self.inside {
                let [a, b, c] = normals[k];
                by_b += by_sum.dot(b - a);
                by_c += by_sum.dot(c - a);
            }
        }
        if by_b == 0.0 && by_c == 0.0 {
            return DVec3::ZERO;
        }
        let [slope_b, slope_c] = slopes(triangle);
        slope_b * by_b + slope_c * by_c
    }
}
