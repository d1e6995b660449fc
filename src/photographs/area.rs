//! Images made smaller: each pixel is the mean over the area that it covers.

/// Which pixels a smaller one covers along an axis, and the part of each, with the sum 1.
struct Span {
    start: usize,
    weights: Vec<f64>,
}

fn spans(from: usize, to: usize) -> Vec<Span> {
    let length = from as f64 / to as f64;
    let span = |i: usize| {
        // Whole numbers where pixels end together.
        let edge = |i: usize| (i * from) as f64 / to as f64;
        let (low, high) = (edge(i), edge(i + 1));
        let start = (low.floor() as usize).min(from - 1);
        let end = (high.ceil() as usize).clamp(start + 1, from);
        let part = |x: usize| ((x + 1) as f64).min(high) - (x as f64).max(low);
        Span {
            start,
            weights: (start..end).map(|x| part(x).max(0.0) / length).collect(),
        }
    };
    (0..to).map(span).collect()
}

/// Makes an image smaller by area, from `from` columns and rows to `to`. `read` writes a row of the image to its second
/// argument; rows are asked for in order. Returns `to[0] · to[1]` pixels, row by row.
pub(super) fn shrink<const N: usize>(
    from: [usize; 2],
    to: [usize; 2],
    mut read: impl FnMut(usize, &mut [[f32; N]]),
) -> Vec<[f32; N]> {
    let columns = spans(from[0], to[0]);
    let mut row = vec![[0.0f32; N]; from[0]];
    // The last row that was read, with the columns of the result.
    let mut narrow = vec![[0.0f64; N]; to[0]];
    let mut last = None;
    let mut pixels = Vec::with_capacity(to[0] * to[1]);
    for rows in spans(from[1], to[1]) {
        let mut sums = vec![[0.0f64; N]; to[0]];
        for (i, weight) in rows.weights.iter().enumerate() {
            let y = rows.start + i;
            if last != Some(y) {
                read(y, &mut row);
                for (sum, span) in narrow.iter_mut().zip(&columns) {
                    *sum = [0.0; N];
                    for (pixel, weight) in row[span.start..].iter().zip(&span.weights) {
                        for (s, &v) in sum.iter_mut().zip(pixel) {
                            *s += weight * f64::from(v);
                        }
                    }
                }
                last = Some(y);
            }
            for (sum, pixel) in sums.iter_mut().zip(&narrow) {
                for (s, v) in sum.iter_mut().zip(pixel) {
                    *s += weight * v;
                }
            }
        }
        pixels.extend(sums.iter().map(|sum| sum.map(|v| v as f32)));
    }
    pixels
}

/// Returns the size of an image whose longest side is at most `longest`, with about the same aspect ratio.
pub(super) fn limited(size: [usize; 2], longest: Option<usize>) -> [usize; 2] {
    let most = size[0].max(size[1]);
    match longest {
        Some(longest) if longest < most => {
            let scale = longest as f64 / most as f64;
            size.map(|n| ((n as f64 * scale).round() as usize).max(1))
        }
        _ => size,
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn means_stay(w in 1usize..20, h in 1usize..20, tw in 1usize..20, th in 1usize..20) {
            let to = [tw.min(w), th.min(h)];
            let value = |x: usize, y: usize| ((x * 7 + y * 13) % 11) as f32;
            let small = shrink([w, h], to, |y, row| {
                row.iter_mut().enumerate().for_each(|(x, p)| *p = [value(x, y), 1.0]);
            });
            let sum: f32 = (0..h).flat_map(|y| (0..w).map(move |x| value(x, y))).sum();
            let before = sum / (w * h) as f32;
            let mean = small.iter().map(|p| p[0]).sum::<f32>() / small.len() as f32;
            prop_assert!((mean - before).abs() < 1e-4, "{mean} {before}");
            prop_assert!(small.iter().all(|p| (p[1] - 1.0).abs() < 1e-6));
        }
    }

    #[test]
    fn parts_of_pixels_count_by_area() {
        let small = shrink([3, 1], [2, 1], |_, row| {
            row.copy_from_slice(&[[0.0], [3.0], [6.0]])
        });
        assert_eq!(small, [[1.0], [5.0]]);
        assert_eq!(limited([4000, 3000], Some(1000)), [1000, 750]);
        assert_eq!(limited([40, 30], Some(1000)), [40, 30]);
    }
}
