//! Bilinear texture look-up.

use burn::tensor::{Int, Tensor};

use crate::error::Result;
use crate::geometry::{Context, Vec3, detached, host_values};
use crate::scene::ChannelPlanes;

/// A parameter of materials at surface points `[1, N]`: the constant of each material, or its texture at the
/// coordinates `uv`, in the graph for texels and coordinates.
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
    // Texel centres at half-integers, row 0 at the top (v = 1).
    let x = u.clone() * context.row(&width) - 0.5;
    let y = (v.clone().neg() + 1.0) * context.row(&height) - 0.5;
    let (left, top) = (detached(&x).floor(), detached(&y).floor());
    let (host_left, host_top) = (host_values(&left)?, host_values(&top)?);
    let (fx, fy) = (x - left, y - top);
    let texel = |dx: i64, dy: i64| -> Vec3 {
        let at: Vec<u32> = (0..n)
            .map(|i| {
                slots[i].map_or(0, |s| {
                    let column = s.wrap.texel(host_left[i] as i64 + dx, s.width);
                    let row = s.wrap.texel(host_top[i] as i64 + dy, s.height);
                    (s.offset + row * s.width + column) as u32
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
