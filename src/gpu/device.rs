//! The requirements of kernels for a device, lists on the device, and burn's tensors.

use burn::backend::ops::{FloatTensorOps, IntTensorOps};
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Cube, DispatchDevice, TensorMetadata};
use burn::cubecl::bytes::Bytes;
use burn::cubecl::features::AtomicUsage;
use burn::cubecl::ir::{ElemType, Type, UIntKind};
use burn::cubecl::prelude::*;
use burn::cubecl::server::Handle;
use burn::tensor::{Device, FloatDType, IntDType, Shape, Slice, Tensor};
use burn_cubecl::{CubeBackend, tensor::CubeTensor};

use crate::device::count_upload;
use crate::scene::Identity;

/// Maximum number of lists that a kernel needs.
const LISTS: u32 = 7;

/// A list of 32-bit numbers on a device.
#[derive(Clone)]
pub(crate) struct List {
    pub handle: Handle,
    pub length: usize,
}

impl List {
    /// Sends lists of 32-bit numbers to a device in one transfer, as parts of one buffer. In a browser, each list has a
    /// buffer of its own: WebGPU forbids that a launch writes to a part of a buffer and reads another part.
    pub fn send<const N: usize>(client: &Client, lists: [&[u8]; N]) -> [Self; N] {
        if N > 1 && cfg!(target_family = "wasm") {
            return lists.map(|list| {
                let [sent] = Self::send(client, [list]);
                sent
            });
        }
        let alignment = client.properties().memory.alignment as usize;
        let mut all = Vec::with_capacity(lists.iter().map(|l| l.len() + alignment).sum());
        let starts = lists.map(|list| {
            all.resize(all.len().next_multiple_of(alignment), 0);
            all.extend_from_slice(list);
            all.len() - list.len()
        });
        count_upload(all.len());
        let size = all.len();
        let handle = client.create(Bytes::from_bytes_vec(all));
        std::array::from_fn(|i| {
            let past = starts[i] + lists[i].len();
            let handle = handle.clone().offset_start(starts[i] as u64);
            Self {
                handle: handle.offset_end((size - past) as u64),
                length: lists[i].len() / 4,
            }
        })
    }

    pub fn room(client: &Client, length: usize) -> Self {
        Self {
            handle: client.empty(4 * length),
            length,
        }
    }

    #[allow(unsafe_code)]
    pub fn argument(&self) -> BufferArg {
        // The handle was created with this length.
        unsafe { BufferArg::from_raw_parts(self.handle.clone(), self.length) }
    }

    /// Returns the list by four numbers as an additional argument of a kernel, if the device allows so many buffers.
    pub fn fours(&self, client: &Client) -> Option<BufferArg> {
        self.by(4, client, LISTS + 1)
    }

    /// Returns the list by two words as an additional argument of a kernel, if the device allows so many buffers and adds
    /// to 64 bits at once.
    pub fn pairs(&self, client: &Client) -> Option<BufferArg> {
        let number = ElemType::UInt(UIntKind::U64);
        let properties = client.properties();
        let adds = properties.atomic_type_usage(Type::atomic(number));
        let serves = properties.supports_type(number) && adds.contains(AtomicUsage::Add);
        self.by(2, client, LISTS + 2).filter(|_| serves)
    }

    /// Returns the list by `width` numbers as one of so many arguments. It is left out but for SPIR-V: WGSL's devices may
    /// have the fewest bindings, and no test runs on the others.
    #[allow(unsafe_code)]
    fn by(&self, width: usize, client: &Client, arguments: u32) -> Option<BufferArg> {
        let spare = client.properties().hardware.max_bindings >= arguments;
        // The handle was created with this length, and begins at a multiple of the device's alignment.
        let argument =
            || unsafe { BufferArg::from_raw_parts(self.handle.clone(), self.length / width) };
        (spare && client.name().contains("spirv")).then(argument)
    }
}

/// Number of threads in a workgroup.
pub(super) const GROUP: u32 = 64;

/// Returns the number of workgroups for `threads` threads, and their size.
pub(super) fn groups(threads: usize) -> (CubeCount, CubeDim) {
    /// Maximum number of workgroups along one axis.
    const MAX_GROUPS: u32 = 65_535;
    let groups = (threads as u32).div_ceil(GROUP).max(1);
    let count = CubeCount::Static(groups.min(MAX_GROUPS), groups.div_ceil(MAX_GROUPS), 1);
    (count, CubeDim::new_1d(GROUP))
}

/// Launches a kernel with at least `$threads` threads. Lists on the device may be passed as they are.
macro_rules! launch {
    ($client:expr, $threads:expr, $kernel:ident($($argument:expr),* $(,)?)) => {{
        #[allow(unused_imports)]
        use $crate::gpu::device::Argument;
        $crate::device::count_launch();
        let (groups, group) = $crate::gpu::device::groups($threads);
        $crate::device::kernel(
            stringify!($kernel),
            || $kernel::launch($client, groups, group, $($argument.argument()),*),
            || $crate::gpu::device::wait($client),
        )
    }};
}
pub(super) use launch;

/// Waits until a device has finished all launches.
pub(super) fn wait(client: &Client) {
    // Failures are reported where buffers are requested.
    let _ = burn::cubecl::future::block_on(client.sync());
}

/// A kernel argument. Lists have their own method of the same name, which takes precedence.
pub(super) trait Argument: Sized {
    fn argument(self) -> Self {
        self
    }
}

impl<T> Argument for T {}

/// Computes tensors of burn's fusion. With fusion, tensors may not be computed yet, and its clients have methods of
/// these names, which compute them and take precedence over a trait's methods. Without fusion, all tensors are
/// computed.
#[allow(dead_code)]
trait Resolve {
    fn resolve_tensor_float<B>(&self, tensor: CubeTensor) -> CubeTensor {
        tensor
    }

    fn resolve_tensor_int<B>(&self, tensor: CubeTensor) -> CubeTensor {
        tensor
    }
}

impl Resolve for Client {}

fn list(tensor: CubeTensor) -> (Client, List) {
    let length = tensor.meta.shape().num_elements();
    let handle = tensor.handle;
    (tensor.client, List { handle, length })
}

/// Returns the client of a tensor's device, and the list of its values. These are in the order of the axes if the
/// tensor is contiguous.
pub(super) fn floats(tensor: FloatTensor<Cube>) -> (Client, List) {
    let client = tensor.client.clone();
    list(client.resolve_tensor_float::<CubeBackend>(tensor))
}

/// Returns an identifier of a tensor's memory, or `None` on other devices. It is valid while the tensor is kept,
/// because burn then does not write to this memory.
pub(crate) fn identity(tensor: &Tensor<1>) -> Option<Identity> {
    identity_and_strides(tensor).map(|both| both.0)
}

/// Returns an identifier of a tensor's memory as [`identity`] does, and the steps in it along each axis.
pub(crate) fn identity_and_strides<const D: usize>(
    tensor: &Tensor<D>,
) -> Option<(Identity, Vec<usize>)> {
    let tensor = tensor.clone().try_into_primitive::<Cube>().ok()?;
    let strides = tensor.meta.strides().to_vec();
    let (_, List { handle, length }) = floats(tensor);
    let memory = std::ptr::from_ref(handle.memory.descriptor()).addr();
    let place = handle.offset_start.unwrap_or(0);
    Some(([memory as u64, place, length as u64], strides))
}

/// Creates a tensor of zeros, and returns it with the list of its values, which a kernel changes. CUDA would leave gaps
/// between the rows of a tensor that is created with several axes.
pub(super) fn zeros(like: &FloatTensor<Cube>, shape: Shape) -> (FloatTensor<Cube>, List) {
    let length = Shape::from([shape.num_elements()]);
    let tensor = Cube::float_zeros(length, &like.device(), FloatDType::F32);
    let (_, list) = floats(tensor.clone());
    (Cube::float_reshape(tensor, shape), list)
}

/// Returns the values of the rows of some views, without gaps. Each view has `of_view` rows of the tensor, which has two
/// axes.
pub(super) fn rows_of(
    tensor: &FloatTensor<Cube>,
    views: &[usize],
    of_view: usize,
) -> FloatTensor<Cube> {
    let columns = Slice::from(0..tensor.shape()[1]);
    let shape = Shape::from([views.len() * of_view, tensor.shape()[1]]);
    // Expanded and transposed tensors have another layout in memory.
    let mut room = Cube::float_zeros(shape, &tensor.device(), FloatDType::F32);
    let mut past = 0;
    for run in views.chunk_by(|a, b| a + 1 == *b) {
        let rows = |first: usize| Slice::from(first * of_view..(first + run.len()) * of_view);
        let part = Cube::float_slice(tensor.clone(), &[rows(run[0]), columns]);
        room = Cube::float_slice_assign(room, &[rows(past), columns], part);
        past += run.len();
    }
    let length = Shape::from([room.shape().num_elements()]);
    Cube::float_reshape(room, length)
}

/// Creates an integer tensor of zeros, and returns it with the list of its values.
pub(super) fn int_zeros(like: &FloatTensor<Cube>, length: usize) -> (IntTensor<Cube>, List) {
    let tensor = Cube::int_zeros(Shape::from([length]), &like.device(), IntDType::I32);
    let client = tensor.client.clone();
    let (_, numbers) = list(client.resolve_tensor_int::<CubeBackend>(tensor.clone()));
    (tensor, numbers)
}

/// Returns the client of a GPU, or `None` for another device.
pub(super) fn client_of(device: &Device) -> Option<Client> {
    match device.clone().inner().as_dispatch() {
        DispatchDevice::Cube(device) => Some(device.client()),
        _ => None,
    }
}

/// Checks that a device has enough bindings for kernels and room for lists of numbers. Otherwise returns a message
/// about what it lacks.
pub(super) fn has_room(device: &Device, lists: &[(&str, usize)]) -> Result<(), String> {
    let Some(client) = client_of(device) else {
        return Ok(());
    };
    let properties = client.properties();
    let bindings = properties.hardware.max_bindings;
    fits(bindings, properties.memory.max_page_size, lists)
}

/// Maximum length of a list, since kernels number words by u32. A scene within it has less than 2²⁸ triangles, as many as
/// leaves of its tree can number: each triangle takes 16 words of a list, or more.
const WORDS: usize = u32::MAX as usize;

/// Checks lists of numbers against the number of bindings and the maximum size of a buffer in bytes.
fn fits(bindings: u32, bytes: u64, lists: &[(&str, usize)]) -> Result<(), String> {
    const INSTEAD: &str = "a tensor of a CPU's device renders there";
    if bindings < LISTS {
        return Err(format!(
            "a kernel binds {LISTS} buffers and one of cubecl's, and this device allows {} in all; {INSTEAD}",
            bindings + 1
        ));
    }
    match lists.iter().max_by_key(|l| l.1) {
        Some((name, length)) if 4 * *length as u64 > bytes => Err(format!(
            "{name} takes a buffer of {:.1} MB, and this device allows {:.1} MB; {INSTEAD}",
            4e-6 * *length as f64,
            1e-6 * bytes as f64
        )),
        Some((name, length)) if *length > WORDS => Err(format!(
            "{name} takes {length} numbers, and a list has at most {WORDS}; {INSTEAD}"
        )),
        _ => Ok(()),
    }
}

/// Returns the text of an error without CubeCL's backtrace.
pub(super) fn without_backtrace(error: impl ToString) -> String {
    let text = error.to_string();
    let lines = text.lines().map(str::trim);
    let message = lines.take_while(|line| !line.starts_with("Backtrace"));
    message.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Only the caller knows what the driver can do, so that without the variable there is nothing to compare with. CI runs
    /// it with `--ignored`, for one driver of each kind.
    #[test]
    #[ignore = "SOFTRAY_SUMS has to say how many bits of a sum kernels for the device add to at once"]
    fn sums_of_64_bits_where_a_device_adds_them() {
        let bits = std::env::var("SOFTRAY_SUMS").expect("SOFTRAY_SUMS is 32 or 64");
        let client = client_of(&crate::device::of_tests()).expect("a GPU");
        let pairs = List::room(&client, 2).pairs(&client);
        assert_eq!(if pairs.is_some() { "64" } else { "32" }, bits);
    }

    #[test]
    fn a_device_that_allows_too_little_is_an_error() {
        let lists = [("the scene", 1000), ("the image", 3000)];
        assert_eq!(fits(7, 12_000, &lists), Ok(()));
        let said = fits(6, 12_000, &lists).expect_err("few bindings");
        assert!(
            said.contains("7 buffers") && said.contains("allows 7"),
            "{said}"
        );
        let said = fits(7, 11_999, &lists).expect_err("a small buffer");
        assert!(said.contains("the image"), "{said}");
        let lists = [("the scene", 1 << 32)];
        let said = fits(7, 1 << 40, &lists).expect_err("a list that is too long");
        assert!(said.contains("4294967296 numbers"), "{said}");
    }
}
