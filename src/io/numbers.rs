//! Numbers in binary files.

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    /// Returns the size in bytes.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Returns the little-endian number at the start of `bytes`. Missing bytes count as 0.
    pub fn number(self, bytes: &[u8]) -> f64 {
        let mut all = [0; 8];
        for (byte, &from) in all.iter_mut().zip(bytes.iter().take(self.size())) {
            *byte = from;
        }
        let whole = u64::from_le_bytes(all);
        match self {
            Self::I8 => f64::from(whole as i8),
            Self::U8 => f64::from(whole as u8),
            Self::I16 => f64::from(whole as i16),
            Self::U16 => f64::from(whole as u16),
            Self::I32 => f64::from(whole as i32),
            Self::U32 => f64::from(whole as u32),
            Self::F32 => f64::from(f32::from_bits(whole as u32)),
            Self::F64 => f64::from_bits(whole),
        }
    }

    /// Returns the value that represents 1 in normalized numbers ([0, 1] or [−1, 1]): the largest integer, or 1 for
    /// floats.
    pub fn one(self) -> f64 {
        match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::I16 => 32767.0,
            Self::U16 => 65535.0,
            Self::I32 => f64::from(i32::MAX),
            Self::U32 => f64::from(u32::MAX),
            Self::F32 | Self::F64 => 1.0,
        }
    }
}
