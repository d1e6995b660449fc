//! Conversion between sRGB and linear values.

use image::{ColorType, DynamicImage};

/// Decodes an sRGB image to linear RGB.
pub(super) fn decode_srgb(image: &DynamicImage) -> Vec<f32> {
    let color = image.color();
    if let ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 = color {
        let (table, bytes) = (srgb_table(), image.as_bytes());
        let channels = if color.has_color() { [0, 1, 2] } else { [0; 3] };
        let count = usize::from(color.channel_count());
        let mut pixels = Vec::with_capacity(bytes.len() / count * 3);
        for pixel in bytes.chunks_exact(count) {
            pixels.extend(channels.map(|c| table[usize::from(pixel[c])]));
        }
        return pixels;
    }
    let mut pixels = image.to_rgb32f().into_raw();
    pixels.iter_mut().for_each(|v| *v = srgb_to_linear(*v));
    pixels
}

/// Returns the linear value of each sRGB byte.
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

/// Encodes a linear value, clipped to [0, 1], as an sRGB byte.
pub(crate) fn srgb_byte(linear: f32) -> u8 {
    (linear_to_srgb(linear) * 255.0).round() as u8
}

/// Encodes a linear value, clipped to [0, 1], as 16-bit sRGB.
pub(super) fn srgb_word(linear: f32) -> u16 {
    (linear_to_srgb(linear) * 65535.0).round() as u16
}

/// Encodes a linear value, clipped to [0, 1], as sRGB.
pub(crate) fn linear_to_srgb(linear: f32) -> f32 {
    let v = linear.clamp(0.0, 1.0);
    if v <= 0.003_130_8 {
        v * 12.92
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    }
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
