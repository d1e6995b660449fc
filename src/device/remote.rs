//! Devices of servers: connecting to them, and waiting for their answers.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::pin::pin;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Wake, Waker};
use std::thread::Thread;
use std::time::{Duration, Instant};

use burn::backend::{DispatchDevice, RemoteDevice};
use burn::remote::{ConnectError, EndpointId, RemoteHost};
use burn::tensor::{DType, Device, Int, Tensor};

use crate::error::{Error, Result};

/// The environment variable with the token for [`named`](super::named).
pub(super) const TOKEN: &str = "SOFTRAY_TOKEN";

/// The connected devices and their addresses.
static CONNECTED: Mutex<Vec<(Device, String)>> = Mutex::new(Vec::new());

/// How long to wait for an answer, in milliseconds.
static TIME_LIMIT: AtomicU64 = AtomicU64::new(600_000);

/// Connects to a device of a server (the example `render_server`), and returns it. A scene whose tensors are on this
/// device renders on the server, forward and backward.
///
/// `address` is `ws://host:port` or `iroh:` and the server's id. A number after `/` selects one of several devices of
/// the server, as in `ws://host:3000/1`. WebSocket is unencrypted: use it within a trusted network alone, and Iroh
/// beyond it. `token` is the server's token, `""` for a server without one.
///
/// The first tensor of a session is sent when it is created, and operations wait until a value is read.
///
/// ```no_run
/// let device = softray::remote::connect("ws://127.0.0.1:3000", "the server's token")?;
/// let (room, camera) = softray::scene::cornell_box(&device);
/// # Ok::<(), softray::Error>(())
/// ```
///
/// # Errors
/// If the address is not valid, no server answers (after at most some 20 s), the token is wrong, or the server is of
/// another version of burn.
pub fn connect(address: &str, token: &str) -> Result<Device> {
    let invalid = || {
        let expected = "ws://host:port or iroh:<server id>, with /1 for the server's second device";
        Error::invalid("device", "address", format!("{address:?}"), expected)
    };
    let (scheme, rest) = address.split_once(':').ok_or_else(invalid)?;
    let rest = rest.trim_start_matches('/');
    let (place, index) = match rest.split_once('/') {
        Some((place, index)) => (place, index.parse::<usize>().map_err(|_| invalid())?),
        None => (rest, 0),
    };
    let host = match scheme {
        "ws" if !place.is_empty() => RemoteHost::websocket(&format!("ws://{place}")),
        "iroh" => RemoteHost::iroh(place.parse::<EndpointId>().map_err(|_| invalid())?),
        _ => return Err(invalid()),
    };
    let host = match token {
        "" => host,
        token => host.with_credential(token),
    };
    let options = Device::remote_options(&host).device_index(index);
    let device = options
        .init()
        .map_err(|error| Error::device(address, not_connected(error)))?;
    let mut connected = CONNECTED.lock().unwrap_or_else(PoisonError::into_inner);
    if !connected.iter().any(|(known, _)| *known == device) {
        connected.push((device.clone(), address.to_owned()));
    }
    Ok(device)
}

fn not_connected(error: ConnectError) -> String {
    let remedy = match &error {
        ConnectError::Unreachable { .. } => "a server says at its start where it listens",
        ConnectError::Unauthorized => "is this the server's token?",
        ConnectError::IncompatibleProtocol { .. } => "build both with the same version of burn",
        ConnectError::Handshake { .. } => "is it a burn server of the same version?",
        _ => return format!("{error}"),
    };
    format!("{error}; {remedy}")
}

/// Limits how long a render waits for a server's answer, for all devices of this process. The default is ten minutes.
/// A render that takes longer is an error. The server is not told, so the next render waits until it has finished.
pub fn set_time_limit(limit: Duration) {
    let milliseconds = u64::try_from(limit.as_millis()).unwrap_or(u64::MAX);
    TIME_LIMIT.store(milliseconds, Ordering::Relaxed);
}

/// Returns the device of a server, without autodiff, or `None` for other devices.
pub(crate) fn remote(device: &Device) -> Option<RemoteDevice> {
    match device.clone().inner().as_dispatch() {
        DispatchDevice::Remote(device) => Some(device.clone()),
        _ => None,
    }
}

/// Returns the address of a device of a server.
pub(super) fn address(device: &Device) -> Option<String> {
    remote(device)?;
    let device = device.clone().inner();
    let connected = CONNECTED.lock().unwrap_or_else(PoisonError::into_inner);
    let known = connected.iter().find(|(known, _)| *known == device);
    Some(known.map_or_else(|| "of a server".to_owned(), |known| known.1.clone()))
}

/// Reads 32-bit words from a server.
///
/// # Errors
/// If the server has gone or does not answer in time. The message begins with `doing`.
pub(crate) fn read_words(tensor: Tensor<1, Int>, doing: &str) -> Result<Vec<u32>> {
    let device = tensor.device();
    let failed =
        |reason: String| Error::device(super::label(&device), format!("{doing} failed: {reason}"));
    let limit = Duration::from_millis(TIME_LIMIT.load(Ordering::Relaxed));
    let data = match finish(tensor.into_data_async(), limit) {
        None => Err(failed(format!(
            "the server did not answer within {} s (softray::remote::set_time_limit). If it still computes, the next \
             render on this device waits for it; if it has gone, start the program anew, and continue a training from \
             its checkpoint",
            limit.as_secs_f64()
        ))),
        Some(Err(error)) => {
            let reason = error.to_string();
            let reason = reason.lines().next().unwrap_or_default();
            Err(failed(format!(
                "the server ended the session ({reason}). burn cannot use this device again in this process; start the \
                 program anew, and continue a training from its checkpoint"
            )))
        }
        Some(Ok(data)) => Ok(data),
    }?;
    let words = data.convert_dtype(DType::I32);
    let words = words.as_slice::<i32>().map_err(Error::read)?;
    Ok(words.iter().map(|&word| word as u32).collect())
}

/// Returns a number that no other process draws, in all likelihood.
pub(crate) fn unique() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let mut hasher = RandomState::new().build_hasher();
    hasher.write_u64(NEXT.fetch_add(1, Ordering::Relaxed));
    hasher.finish()
}

struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

/// Waits for a future, at most for some time.
fn finish<T>(future: impl Future<Output = T>, limit: Duration) -> Option<T> {
    let mut future = pin!(future);
    let waker = Waker::from(Arc::new(Unpark(std::thread::current())));
    let mut context = Context::from_waker(&waker);
    let begin = Instant::now();
    loop {
        if let Poll::Ready(result) = future.as_mut().poll(&mut context) {
            return Some(result);
        }
        let left = limit.checked_sub(begin.elapsed())?;
        std::thread::park_timeout(left);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_that_are_none_are_errors() {
        for address in ["", "ws:", "host:3000", "ws://host:3000/x", "iroh:host"] {
            let said = connect(address, "").expect_err(address).to_string();
            assert!(said.contains(&format!("address is {address:?}")), "{said}");
        }
    }

    #[test]
    fn waiting_ends() {
        let limit = Duration::from_millis(20);
        assert_eq!(finish(std::future::ready(1), limit), Some(1));
        assert_eq!(finish(std::future::pending::<()>(), limit), None);
    }
}
