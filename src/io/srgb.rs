//! sRGB and linear values.

use image::DynamicImage;

/// Linear values of the three colours of an image in sRGB.
pub(super) fn decode_srgb(image: DynamicImage) -> Vec<f32> {
    let table = srgb_table();
    // From bytes with so many channels, of which one or three are colours.
    let of_bytes = |bytes: Vec<u8>, channels: usize| {
        let mut pixels = Vec::with_capacity(bytes.len() / channels * 3);
        for pixel in bytes.chunks_exact(channels) {
            let colours = if channels < 3 {
                [pixel[0]; 3]
            } else {
                [pixel[0], pixel[1], pixel[2]]
            };
            pixels.extend(colours.map(|c| table[usize::from(c)]));
        }
        pixels
    };
    match image {
        DynamicImage::ImageLuma8(i) => of_bytes(i.into_raw(), 1),
        DynamicImage::ImageLumaA8(i) => of_bytes(i.into_raw(), 2),
        DynamicImage::ImageRgb8(i) => of_bytes(i.into_raw(), 3),
        DynamicImage::ImageRgba8(i) => of_bytes(i.into_raw(), 4),
        other => {
            let mut pixels = other.into_rgb32f().into_raw();
            pixels.iter_mut().for_each(|v| *v = srgb_to_linear(*v));
            pixels
        }
    }
}

/// The linear value of each byte of sRGB.
pub(super) fn srgb_table() -> Vec<f32> {
    (0..256).map(|i| srgb_to_linear(i as f32 / 255.0)).collect()
}

pub(crate) fn srgb_to_linear(v: f32) -> f32 {
    if v <= 0.04045 {
        v / 12.92
    } else {
        ((v + 0.055) / 1.055).powf(2.4)
    }
}

/// The byte of sRGB for a linear value, clipped to [0, 1].
pub(crate) fn srgb_byte(linear: f32) -> u8 {
    let v = linear.clamp(0.0, 1.0);
    let encoded = if v <= 0.003_130_8 {
        v * 12.92
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    };
    (encoded * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_bytes_survive() {
        for byte in 0..=255u8 {
            assert_eq!(srgb_byte(srgb_to_linear(f32::from(byte) / 255.0)), byte);
        }
    }
}
