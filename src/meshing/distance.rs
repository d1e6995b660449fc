//! The signed distance to the outline in a mask.

/// The value of a mask at its outline.
pub(super) const LEVEL: f32 = 0.5;

/// Signed distances to an outline in pixels, positive inside, at the pixels of an image and one more on each side.
pub(super) struct Distances {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Distances {
    /// Computes the distances from a mask of `width` × `height` values in rows, which are 1 inside. The outline is
    /// where the mask, interpolated between the pixels' middles, is 0.5, so it is known to a fraction of a pixel. The
    /// mask is continued by `beyond`. Returns `None` without an outline.
    pub fn new(mask: &[f32], width: usize, height: usize, beyond: f32) -> Option<Self> {
        let (w, h) = (width + 2, height + 2);
        let mut padded = vec![beyond; w * h];
        for (y, row) in mask.chunks_exact(width).enumerate() {
            padded[(y + 1) * w + 1..][..width].copy_from_slice(row);
        }
        let mut nearest = seeds(&padded, w, h);
        // Each pass carries nearest points across the image; what the first two leave inexact, the others mend.
        for _ in 0..2 {
            sweep(&mut nearest, w, h, false);
            sweep(&mut nearest, w, h, true);
        }
        let mut values = Vec::with_capacity(w * h);
        for (i, (near, &inside)) in nearest.iter().zip(&padded).enumerate() {
            let distance = squared(*near, i % w, i / w).sqrt();
            values.push(if inside >= LEVEL { distance } else { -distance });
        }
        let values = values.iter().all(|d| d.is_finite()).then_some(values)?;
        Some(Self {
            width: w,
            height: h,
            values,
        })
    }

    /// The width and height in pixels, with those that were added.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The distance at a point in pixels from the upper-left corner of the image, interpolated between pixels. Far
    /// outside it has the right sign, and is not larger than the true distance.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        // Middles of pixels are at integers, and the added row and column come first.
        let (x, y) = (x + 0.5, y + 0.5);
        let inside = |v: f64, count: usize| v.clamp(0.0, (count - 1) as f64);
        let (u, v) = (inside(x, self.width), inside(y, self.height));
        let i = (u as usize).min(self.width - 2);
        let j = (v as usize).min(self.height - 2);
        let (s, t) = (u - i as f64, v - j as f64);
        let row = |j: usize| {
            let at = j * self.width + i;
            f64::from(self.values[at]) * (1.0 - s) + f64::from(self.values[at + 1]) * s
        };
        let value = row(j) * (1.0 - t) + row(j + 1) * t;
        let beyond = (x - u).hypot(y - v);
        if beyond > value.abs() {
            return beyond.copysign(value);
        }
        value
    }
}

fn squared([x, y]: [f32; 2], i: usize, j: usize) -> f32 {
    let (x, y) = (x - i as f32, y - j as f32);
    x * x + y * y
}

/// For the pixels beside the outline, the nearest point of the outline in the neighboring squares of four pixels' middles;
/// infinity for all others.
fn seeds(mask: &[f32], w: usize, h: usize) -> Vec<[f32; 2]> {
    let mut nearest = vec![[f32::INFINITY; 2]; w * h];
    let value = |i: usize, j: usize| mask[j * w + i] - LEVEL;
    for j in 0..h - 1 {
        for i in 0..w - 1 {
            // Around the square, the points where its sides pass the level.
            let around = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[x, y]| [i + x, j + y]);
            let mut ends = [[0.0; 2]; 4];
            let mut count = 0;
            for side in 0..4 {
                let ([a, b], [c, d]) = (around[side], around[(side + 1) % 4]);
                let (from, to) = (value(a, b), value(c, d));
                if (from >= 0.0) != (to >= 0.0) {
                    let part = from / (from - to);
                    let between = |p: usize, q: usize| p as f32 + (q as f32 - p as f32) * part;
                    ends[count] = [between(a, c), between(b, d)];
                    count += 1;
                }
            }
            // Of four points, those that follow each other are joined in one of two ways; for distances either does.
            for pair in ends[..count].chunks_exact(2) {
                for [x, y] in around {
                    let on = nearest_on_segment(pair[0], pair[1], [x as f32, y as f32]);
                    let at = &mut nearest[y * w + x];
                    if squared(on, x, y) < squared(*at, x, y) {
                        *at = on;
                    }
                }
            }
        }
    }
    nearest
}

fn nearest_on_segment(a: [f32; 2], b: [f32; 2], p: [f32; 2]) -> [f32; 2] {
    let along = [b[0] - a[0], b[1] - a[1]];
    let length = along[0] * along[0] + along[1] * along[1];
    let dot = (p[0] - a[0]) * along[0] + (p[1] - a[1]) * along[1];
    let part = if length > 0.0 {
        (dot / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    [a[0] + along[0] * part, a[1] + along[1] * part]
}

/// Passes nearest points on to pixels in rows from the top, or from the bottom (Danielsson 1980, with eight neighbors).
fn sweep(nearest: &mut [[f32; 2]], w: usize, h: usize, up: bool) {
    let take = |nearest: &mut [[f32; 2]], i: usize, j: usize, x: isize, y: isize| {
        let (p, q) = (i as isize + x, j as isize + y);
        if p < 0 || q < 0 || p >= w as isize || q >= h as isize {
            return;
        }
        let other = nearest[q as usize * w + p as usize];
        let own = &mut nearest[j * w + i];
        if squared(other, i, j) < squared(*own, i, j) {
            *own = other;
        }
    };
    for row in 0..h {
        let (j, back) = if up { (h - 1 - row, 1) } else { (row, -1) };
        for i in 0..w {
            for x in -1..=1 {
                take(nearest, i, j, x, back);
            }
            take(nearest, i, j, -1, 0);
        }
        for i in (0..w).rev() {
            take(nearest, i, j, 1, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mask of a disk whose edge is one pixel wide.
    fn disk(width: usize, height: usize, [x, y]: [f64; 2], radius: f64) -> Vec<f32> {
        let value = |i: usize| {
            let (u, v) = ((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
            (radius - (u - x).hypot(v - y) + 0.5).clamp(0.0, 1.0) as f32
        };
        (0..width * height).map(value).collect()
    }

    #[test]
    fn distances_to_a_disk_are_exact_to_a_fraction_of_a_pixel() {
        let mask = disk(64, 48, [30.3, 22.6], 15.2);
        let found = Distances::new(&mask, 64, 48, 0.0).expect("an outline");
        for (x, y) in [
            (36.0, 22.0),
            (30.3, 7.4),
            (46.0, 22.0),
            (3.0, 3.0),
            (60.0, 40.5),
        ] {
            let distance = 15.2 - f64::hypot(x - 30.3, y - 22.6);
            let at = found.at(x, y);
            assert!((at - distance).abs() < 0.12, "{x} {y}: {at} for {distance}");
        }
        // Outside of the image it is no overestimate, and grows.
        assert!(found.at(-20.0, 22.0) < -19.0 && found.at(-20.0, 22.0) > -36.0);
        assert!(found.at(500.0, 500.0) < -600.0);
    }

    #[test]
    fn what_a_mask_does_not_show_may_be_inside() {
        let mask = disk(40, 40, [20.0, 38.0], 10.0);
        let found = Distances::new(&mask, 40, 40, 1.0).expect("an outline");
        assert!(found.at(20.0, 45.0) > 0.0 && found.at(5.0, 20.0) < 0.0);
        assert!(found.at(-30.0, 20.0) > 0.0);
        assert!(Distances::new(&[1.0; 16], 4, 4, 1.0).is_none());
        assert!(Distances::new(&[0.0; 16], 4, 4, 0.0).is_none());
    }
}
