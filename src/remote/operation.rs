//! Operations of burn's server: their inputs and outputs, whatever happens in between.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use burn::backend::ir::{BackendIr, CustomOpIr, HandleContainer, TensorIr};
use burn::backend::ops::FloatTensorOps;
use burn::backend::{BackendTensor, Dispatch, DispatchKindConversion, DispatchTensor};
use burn::tensor::{DType, Device, Int, Shape, Tensor};

use crate::error::{Error, Result};
use crate::render::remote::message::{Call, INPUTS};
use crate::render::remote::words::{malformed, tensor};

/// The inputs of an operation, and the shape of its result.
pub(super) struct Inputs {
    pub call: Call,
    pub seed: u64,
    pub words: [Tensor<1, Int>; INPUTS],
    pub tensors: Vec<DispatchTensor>,
    /// The shape of the result, which the client expects.
    pub expected: Shape,
}

/// The result of an operation, and words.
pub(super) type Answer = (DispatchTensor, Vec<u32>);

/// Runs an operation. Its outputs are registered whatever happens, since the client's session would end otherwise: the
/// result, NaN if it failed, and a word that is 0 after success, with the words of the answer. The second output may be
/// missing. `failed` is told of an error.
pub(super) fn answer<B: BackendIr>(
    handles: &mut HandleContainer<B::Handle>,
    operation: &CustomOpIr,
    run: impl FnOnce(Inputs) -> Result<Answer>,
    failed: impl FnOnce(Call, Error),
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
    let Some((result, message)) = operation.outputs.split_first() else {
        log::error!("an operation without outputs");
        return;
    };
    let Some(device) = words.first().map(Tensor::device) else {
        log::error!("an operation without inputs");
        return;
    };
    let expected = result.shape.clone();
    let called = Call::of_scalars(&operation.scalars);
    let run = || {
        let (call, seed) = called.ok_or_else(|| malformed("the scalars"))?;
        let words = words.try_into();
        let words = words.map_err(|_| malformed("too few inputs"))?;
        run(Inputs {
            call,
            seed,
            words,
            tensors,
            expected: expected.clone(),
        })
    };
    let answered = catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|panic| {
        let text = text_of(&*panic);
        let message = format!("it failed in the program: {text}");
        Err(Error::device("", message))
    });
    let (result_of, words) = match answered {
        Ok((result, words)) => (result, [vec![0], words].concat()),
        Err(error) => {
            log::warn!("an operation failed: {error}");
            if let Some((call, _)) = called {
                failed(call, error);
            }
            // The client takes no image of a failed render. Of a gradient it takes this.
            let none = Tensor::<1>::full([1], f32::NAN, (&device, result.dtype)).into_dispatch();
            (Dispatch::float_expand(none, expected), vec![1])
        }
    };
    let result_of = <DispatchTensor as DispatchKindConversion<B>>::try_into_backend(result_of);
    if let Ok(BackendTensor::Float(tensor)) = result_of {
        handles.register_float_tensor::<B>(&result.id, tensor);
    }
    if let Some(message) = message.first() {
        put_int::<B>(handles, message, words, &device);
    }
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

/// Registers words, of which as many follow or are missing as the output has room for.
pub(super) fn put_int<B: BackendIr>(
    handles: &mut HandleContainer<B::Handle>,
    output: &TensorIr,
    mut words: Vec<u32>,
    device: &Device,
) where
    DispatchTensor: DispatchKindConversion<B>,
{
    words.resize(output.shape.num_elements(), 0);
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
