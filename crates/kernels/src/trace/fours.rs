//! Lists of floats that a device loads by four.

use crate::cube::*;
use crate::model::Four;

/// A list of floats by four, if the device can load it so.
pub type Fours<'a> = ComptimeOption<&'a [Vector<f32, Const<4>>]>;

/// Returns four numbers of a list. `at` is their place, divided by four, in the list, or after [`start_of`] in `fours`.
#[cube]
pub fn four(list: &[f32], fours: Fours, at: u32) -> Four {
    let mut four = Four::default();
    #[comptime]
    match fours {
        ComptimeOption::Some(fours) => {
            let all = fours[at as usize];
            four.x = all.extract(0usize);
            four.y = all.extract(1usize);
            four.z = all.extract(2usize);
            four.w = all.extract(3usize);
        }
        ComptimeOption::None => {
            let i = 4 * at as usize;
            four.x = list[i];
            four.y = list[i + 1];
            four.z = list[i + 2];
            four.w = list[i + 3];
        }
    }
    four
}

/// Returns where a list starts for [`four`]: `first` if there are `fours`, in which it starts there, or 0.
#[cube]
pub fn start_of(fours: Fours, first: u32) -> u32 {
    let mut start = 0u32;
    #[comptime]
    match fours {
        ComptimeOption::Some(_) => start = first,
        ComptimeOption::None => {}
    }
    start
}
