//! Plain backgrounds: white or black areas that begin at the border of a photograph.

use crate::io::Raster;

/// The part of the border that must be plain.
const PLAIN: f64 = 0.95;
/// Linear values that count as white and as black: about 4 % from sRGB's ends, for noise of JPEG.
const WHITE: std::ops::Range<f32> = 0.9..1.1;
const BLACK: f32 = 0.003;

/// Whether a pixel, linear RGB and alpha, is of a kind.
type Kind = fn(&[f32; 4]) -> bool;

/// A plain background: its name, and whether each pixel belongs to it.
pub(super) struct Background {
    pub name: &'static str,
    pub is_background: Vec<bool>,
}

/// Finds the plain background of an image: the pixels that are white (or black) and lead to the border through such
/// pixels. Areas of the background that the object surrounds stay in the object. `None` if less than 95 % of the border
/// are white, and less than 95 % black.
pub(super) fn plain_background(raster: &Raster) -> Option<Background> {
    let [width, height] = raster.size();
    let mut row = vec![[0.0; 4]; width];
    let is_white: Kind = |p| p[..3].iter().all(|v| WHITE.contains(v));
    let is_black: Kind = |p| p[..3].iter().all(|v| *v <= BLACK);
    let kinds: [(&str, Kind); 2] = [("white", is_white), ("black", is_black)];
    let mut found = [0usize; 2];
    let mut border = 0;
    for y in 0..height {
        raster.row(y, &mut row);
        let whole = y == 0 || y + 1 == height;
        for (x, pixel) in row.iter().enumerate() {
            if whole || x == 0 || x + 1 == width {
                border += 1;
                for (count, (_, is_it)) in found.iter_mut().zip(&kinds) {
                    *count += usize::from(is_it(pixel));
                }
            }
        }
    }
    let plain = |count: usize| count as f64 >= PLAIN * border as f64;
    let (name, is_it) = kinds[found.iter().position(|&count| plain(count))?];
    let mut plain = Vec::with_capacity(width * height);
    for y in 0..height {
        raster.row(y, &mut row);
        plain.extend(row.iter().map(is_it));
    }
    Some(Background {
        name,
        is_background: reached_from_border(&plain, [width, height]),
    })
}

/// Returns which of the plain pixels lead to the border through plain pixels beside them.
fn reached_from_border(plain: &[bool], [width, height]: [usize; 2]) -> Vec<bool> {
    let mut reached = vec![false; plain.len()];
    let mut waiting = Vec::new();
    let columns = (0..width).flat_map(|x| [x, (height - 1) * width + x]);
    let rows = (0..height).flat_map(|y| [y * width, y * width + width - 1]);
    for i in columns.chain(rows) {
        if plain[i] && !std::mem::replace(&mut reached[i], true) {
            waiting.push(i);
        }
    }
    while let Some(i) = waiting.pop() {
        let (x, y) = (i % width, i / width);
        let beside = [
            (x > 0).then(|| i - 1),
            (x + 1 < width).then(|| i + 1),
            (y > 0).then(|| i - width),
            (y + 1 < height).then(|| i + width),
        ];
        for i in beside.into_iter().flatten() {
            if plain[i] && !std::mem::replace(&mut reached[i], true) {
                waiting.push(i);
            }
        }
    }
    reached
}
