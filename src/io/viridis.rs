//! The colour map of pictures of depth.

/// Coefficients of t⁰ to t⁶ for red, green and blue: the fit of sixth degree to matplotlib's
/// viridis by Matt Zucker (<https://www.shadertoy.com/view/WlfXRN>, CC0), within 0.02 of its table.
const COEFFICIENTS: [[f32; 3]; 7] = [
    [0.277_727_33, 0.005_407_344_5, 0.334_099_8],
    [0.105_093_04, 1.404_613_5, 1.384_590_2],
    [-0.330_861_84, 0.214_847_56, 0.095_095_165],
    [-4.634_230_4, -5.799_101, -19.332_441],
    [6.228_27, 14.179_933, 56.690_55],
    [4.776_385, -13.745_145, -65.353_035],
    [-5.435_456, 4.645_853, 26.312_435],
];

/// Bytes in sRGB for a number in [0, 1]: dark violet to yellow, of even steps to the eye.
pub(super) fn viridis(t: f32) -> [u8; 3] {
    let t = t.clamp(0.0, 1.0);
    std::array::from_fn(|c| {
        let value = COEFFICIENTS.iter().rev().fold(0.0, |sum, k| sum * t + k[c]);
        (value.clamp(0.0, 1.0) * 255.0).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against rows of matplotlib's table.
    #[test]
    fn it_is_near_the_table() {
        for (t, expected) in [
            (0.0, [0.267_004, 0.004_874, 0.329_415]),
            (0.25, [0.229_739, 0.322_361, 0.545_706]),
            (0.5, [0.127_568, 0.566_949, 0.550_556]),
            (0.75, [0.369_214, 0.788_888, 0.382_914]),
            (1.0, [0.993_248, 0.906_157, 0.143_936]),
        ] {
            for (found, wanted) in viridis(t).into_iter().zip(expected) {
                let off = (f32::from(found) / 255.0 - wanted as f32).abs();
                assert!(off < 0.02, "{t}: {found} for {wanted}");
            }
        }
        assert_eq!(viridis(-1.0), viridis(0.0));
        assert_eq!(viridis(2.0), viridis(1.0));
    }
}
