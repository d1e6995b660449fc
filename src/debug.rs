//! `Debug` of tensors and long lists shows sizes and a few numbers, never thousands of them.

use std::fmt;

use burn::module::Param;
use burn::tensor::kind::Basic;
use burn::tensor::{DType, Device, Tensor};

use crate::device;

/// The largest number of values for which a list is shown in full.
const MAX_LISTED: usize = 12;

/// A text that is shown without quotes.
pub(crate) struct Text(pub String);

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Formats a tensor by its values if it is a short list, otherwise by its shape and device, and whether it is tracked.
/// At most a few numbers are read from the device.
pub(crate) fn tensor<const D: usize>(t: &Tensor<D>) -> Text {
    let graph = graph(t);
    Text(match short_list(t) {
        Some(values) => format!("{values}{graph}"),
        None => format!("{:?} on {}{graph}", t.dims(), place(&t.device(), t.dtype())),
    })
}

/// Formats a tensor of any kind by its shape and device.
pub(crate) fn shape<const D: usize, K: Basic>(t: &Tensor<D, K>) -> Text {
    let device = device::label(&t.device());
    Text(format!("{:?} on {device}", t.dims()))
}

/// Formats the parameter of a module. A parameter that is not initialized yet stays uninitialized.
pub(crate) fn parameter<const D: usize>(p: &Param<Tensor<D>>) -> Text {
    if p.is_initialized() {
        tensor(&p.val())
    } else {
        Text(format!("{:?}, not made yet", p.lazy_shape().as_slice()))
    }
}

/// Formats numbers, or the count, minimum and maximum of a long list.
pub(crate) fn numbers(list: impl ExactSizeIterator<Item = f64> + Clone) -> Text {
    let count = list.len();
    if count <= MAX_LISTED {
        return Text(format!("{:?}", list.collect::<Vec<_>>()));
    }
    let finite = || list.clone().filter(|v| v.is_finite());
    let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    });
    let missing = count - finite().count();
    Text(if missing == count {
        format!("{count} numbers, none of them finite")
    } else if missing > 0 {
        format!("{count} numbers from {low:?} to {high:?}, {missing} not finite")
    } else {
        format!("{count} numbers from {low:?} to {high:?}")
    })
}

/// The text that follows a tracked tensor.
pub(crate) fn graph<const D: usize>(t: &Tensor<D>) -> &'static str {
    if t.is_tracked() { " in the graph" } else { "" }
}

/// A device, with the float type if it is not f32.
pub(crate) fn place(device: &Device, dtype: DType) -> String {
    let device = device::label(device);
    match dtype {
        DType::F32 => device,
        other => format!("{device} in {other:?}"),
    }
}

/// The values of a short list as text. A single number has no brackets.
fn short_list<const D: usize>(t: &Tensor<D>) -> Option<String> {
    let count: usize = t.dims().iter().product();
    if D != 1 || count > MAX_LISTED {
        return None;
    }
    let data = t.clone().inner().try_into_data().ok()?;
    // In the tensor's own float type: 0.3 in f32 is 0.30000001192092896 in f64.
    let values: Vec<String> = match data.dtype() {
        DType::F64 => data.iter::<f64>().map(|v| format!("{v:?}")).collect(),
        _ => data.iter::<f32>().map(|v| format!("{v:?}")).collect(),
    };
    Some(match values.as_slice() {
        [one] => one.clone(),
        all => format!("[{}]", all.join(", ")),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_lists_are_shown_by_their_values() {
        let device = Device::flex();
        let row = Tensor::<1>::from_floats([0.3, -1.0, f32::NAN], &device);
        assert_eq!(tensor(&row).0, "[0.3, -1.0, NaN]");
        let leaf = row.clone().autodiff().require_grad();
        assert_eq!(tensor(&leaf).0, "[0.3, -1.0, NaN] in the graph");
        assert_eq!(
            tensor(&(leaf.clone() * 2.0)).0,
            "[0.6, -2.0, NaN] in the graph"
        );
        let one = row.clone().slice([0..1]);
        assert_eq!(tensor(&one).0, "0.3");
        let double = Tensor::<1>::from_data([0.1f64, 1e-300], (&device, DType::F64));
        assert_eq!(tensor(&double).0, "[0.1, 1e-300]");
        assert_eq!(tensor(&row.slice([0..0])).0, "[]");
    }

    #[test]
    fn others_are_shown_by_their_shape() {
        let device = Device::flex();
        let large = Tensor::<2>::zeros([642, 3], &device);
        assert_eq!(tensor(&large).0, "[642, 3] on flex");
        let double = large.clone().cast(DType::F64);
        assert_eq!(tensor(&double).0, "[642, 3] on flex in F64");
        let leaf = large.autodiff().require_grad();
        assert_eq!(tensor(&leaf).0, "[642, 3] on flex in the graph");
    }

    #[test]
    fn numbers_are_shown_by_their_range() {
        assert_eq!(numbers([1.0, 2.5].into_iter()).0, "[1.0, 2.5]");
        let many: Vec<f64> = (0..100).map(f64::from).collect();
        assert_eq!(
            numbers(many.iter().copied()).0,
            "100 numbers from 0.0 to 99.0"
        );
        let nan = many.iter().map(|v| if *v < 3.0 { f64::NAN } else { *v });
        assert_eq!(numbers(nan).0, "100 numbers from 3.0 to 99.0, 3 not finite");
    }
}
