//! Operations of burn's server: their inputs and outputs, whatever happens in between.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use burn::backend::ir::{BackendIr, CustomOpIr, HandleContainer, TensorIr};
use burn::backend::{BackendTensor, DispatchKindConversion, DispatchTensor};
use burn::tensor::{DType, Device, Int, Shape, Tensor};

use crate::error::{Error, Result};
use crate::render::remote::message::{Failure, GRADIENT, INPUTS};
use crate::render::remote::words::{encode, malformed, pack, tensor};

/// The inputs of an operation, and the shapes of its outputs.
pub(super) struct Inputs {
    pub words: [Tensor<1, Int>; INPUTS],
    pub tensors: Vec<DispatchTensor>,
    /// The shape of the result, which the client expects.
    pub expected: Shape,
}

/// The result of an operation, and the words after the one for success.
pub(super) type Answer = (DispatchTensor, Vec<u32>);

/// Runs an operation. Its outputs are registered whatever happens, since the client's session would end otherwise.
pub(super) fn answer<B: BackendIr>(
    handles: &mut HandleContainer<B::Handle>,
    operation: &CustomOpIr,
    run: impl FnOnce(Inputs) -> Result<Answer>,
) where
    DispatchTensor: DispatchKindConversion<B>,
{
    let (words, floats) = operation
        .inputs
        .split_at(INPUTS.min(operation.inputs.len()));
    let words: Vec<Tensor<1, Int>> = words.iter().map(|t| int::<B>(handles, t)).collect();
    let float = |tensor: &TensorIr| {
        let own = BackendTensor::Float(handles.get_float_tensor::<B>(tensor));
        <DispatchTensor as DispatchKindConversion<B>>::from_backend(own)
    };
    let tensors: Vec<DispatchTensor> = floats.iter().map(float).collect();
    let [result, success, message] = &operation.outputs[..] else {
        log::error!("an operation of {} outputs", operation.outputs.len());
        return;
    };
    let Some(device) = words.first().map(Tensor::device) else {
        log::error!("an operation without inputs");
        return;
    };
    let expected = result.shape.clone();
    let run = || {
        let words = words.try_into();
        let words = words.map_err(|_| malformed("too few inputs"))?;
        run(Inputs {
            words,
            tensors,
            expected,
        })
    };
    let answered = catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|panic| {
        let text = text_of(&*panic);
        Err(Error::device(
            "",
            format!("it failed in the program: {text}"),
        ))
    });
    let room = success.shape.num_elements();
    let (rows, mut words, failure) = match answered {
        Ok((rows, mut words)) => {
            words.insert(0, 0);
            (rows, words, Vec::new())
        }
        Err(error) => {
            log::warn!("an operation failed: {error}");
            // The client takes no image of a failed render. Of a gradient it takes this.
            let count = if operation.id == GRADIENT {
                result.shape.num_elements()
            } else {
                1
            };
            let none = Tensor::<1>::full([count], f32::NAN, (&device, result.dtype));
            let failure = encode(&Failure::new(error)).unwrap_or_default();
            (none.into_dispatch(), vec![1], pack(&failure))
        }
    };
    let rows = <DispatchTensor as DispatchKindConversion<B>>::try_into_backend(rows);
    if let Ok(BackendTensor::Float(rows)) = rows {
        handles.register_float_tensor::<B>(&result.id, rows);
    }
    words.resize(room, 0);
    put_int::<B>(handles, success, words, &device);
    let mut failure = failure;
    failure.resize(message.shape.num_elements(), 0);
    put_int::<B>(handles, message, failure, &device);
}

fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
    text.unwrap_or("no message").to_owned()
}

pub(super) fn int<B: BackendIr>(
    handles: &mut HandleContainer<B::Handle>,
    of: &TensorIr,
) -> Tensor<1, Int>
where
    DispatchTensor: DispatchKindConversion<B>,
{
    Tensor::from_primitive::<B>(handles.get_int_tensor::<B>(of))
}

pub(super) fn put_int<B: BackendIr>(
    handles: &mut HandleContainer<B::Handle>,
    output: &TensorIr,
    words: Vec<u32>,
    device: &Device,
) where
    DispatchTensor: DispatchKindConversion<B>,
{
    match tensor(words, device).try_into_primitive::<B>() {
        Ok(words) => handles.register_int_tensor::<B>(&output.id, words),
        Err(error) => log::error!("a tensor of another device: {error:?}"),
    }
}

pub(super) fn words_of(tensor: &Tensor<1, Int>) -> Result<Vec<u32>> {
    let data = tensor.clone().try_into_data().map_err(Error::read)?;
    let data = data.convert_dtype(DType::I32);
    let words = data.as_slice::<i32>().map_err(Error::read)?;
    Ok(words.iter().map(|&word| word as u32).collect())
}
