//! A server whose devices render for other machines: clients use `softray::remote::connect`, or `BURN_DEVICE=ws://…`.
//!
//! WebSocket is unencrypted: bind to an address of a trusted network alone. Beyond it serve over Iroh (`--iroh`), which
//! authenticates and encrypts. `docs/MACHINES.md` has the setup.

use std::error::Error;
use std::io::Write;
use std::net::{SocketAddr, TcpListener};
use std::path::{Path, PathBuf};

use burn::server::{
    AuthorizationRequest, IrohIdentity, IrohTransport, PeerAuthorizer, RemoteServer,
    TokenAuthorizer, Transport, WebSocketTransport,
};
use clap::Parser;
use softray::burn;
use softray::remote::{RenderService, ServiceLimits};

/// A server that renders for its clients.
#[derive(Parser)]
pub struct Arguments {
    /// Address for WebSocket. Port 0 takes a free one, which is printed.
    #[arg(long, default_value = "127.0.0.1:3000", conflicts_with = "iroh")]
    bind: SocketAddr,
    /// Serve over Iroh in place of WebSocket, with the identity in this file, which is made if it is not there.
    #[arg(long, value_name = "FILE")]
    iroh: Option<PathBuf>,
    /// Device, as in BURN_DEVICE; may be repeated.
    #[arg(long = "device", default_value = "flex")]
    devices: Vec<String>,
    /// File with the token that clients must present. Only its owner should be able to read it.
    #[arg(long, value_name = "FILE", required_unless_present = "without_token")]
    token_file: Option<PathBuf>,
    /// Serve every client that reaches the address.
    #[arg(long, conflicts_with = "token_file")]
    without_token: bool,
    /// Maximum number of pixels of a render, over all of its views.
    #[arg(long, default_value_t = ServiceLimits::default().pixels)]
    max_pixels: u64,
    /// Maximum number of samples of a render, over all pixels of all of its views.
    #[arg(long, default_value_t = ServiceLimits::default().samples)]
    max_samples: u64,
    /// Maximum memory of the images of a render, in MiB.
    #[arg(long, default_value_t = ServiceLimits::default().memory >> 20)]
    max_memory: u64,
    /// Number of forward passes that are kept for their backward passes.
    #[arg(long, default_value_t = ServiceLimits::default().kept)]
    kept: usize,
}

/// Logs each session that a client opens.
struct Logged(Option<TokenAuthorizer>);

impl PeerAuthorizer for Logged {
    fn authorize(&self, request: AuthorizationRequest<'_>) -> Result<(), String> {
        let (client, device) = (request.client, request.device_index);
        let result = self.0.as_ref().map_or(Ok(()), |own| own.authorize(request));
        match &result {
            Ok(()) => log::info!("{client} opened a session on device {device}"),
            Err(reason) => log::warn!("a session was refused: {reason}"),
        }
        result
    }
}

fn token(path: &Path) -> Result<TokenAuthorizer, Box<dyn Error>> {
    let named = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    let text = std::fs::read_to_string(path).map_err(|e| named(&e))?;
    Ok(TokenAuthorizer::new(text.trim()).map_err(|e| named(&e))?)
}

/// Serves until Ctrl+C or SIGTERM.
pub fn serve(arguments: &Arguments) -> Result<(), Box<dyn Error>> {
    let authorizer = Logged(arguments.token_file.as_deref().map(token).transpose()?);
    let names = arguments.devices.iter();
    let devices = names.map(|name| softray::device::named(Some(name)));
    let devices = devices.collect::<softray::Result<Vec<_>>>()?;
    let (transport, address): (Transport, _) = match &arguments.iroh {
        Some(file) => {
            let transport = IrohTransport::new(IrohIdentity::load_or_create(file)?);
            let address = format!("iroh:{}", transport.id());
            (transport.into(), address)
        }
        None => {
            let listener = TcpListener::bind(arguments.bind)
                .map_err(|error| format!("{}: {error}", arguments.bind))?;
            let address = listener.local_addr()?;
            if !address.ip().is_loopback() {
                log::warn!(
                    "WebSocket is unencrypted: whoever is on the way to {address} can read all, the token too"
                );
            }
            let transport = WebSocketTransport::from_listener(listener);
            (transport.into(), format!("ws://{address}"))
        }
    };
    let mut limits = ServiceLimits::default();
    limits.pixels = arguments.max_pixels;
    limits.samples = arguments.max_samples;
    limits.memory = arguments.max_memory << 20;
    limits.kept = arguments.kept;
    let service = RenderService::new(limits);
    let server = RemoteServer::new(devices.clone()).with_authorizer(authorizer);
    let server = service.add_to(server, &devices[0])?;
    println!(
        "serving {} at {address}: at most {} pixels, {} samples and {} MiB of images a render, {} forward passes kept, \
         {}",
        arguments.devices.join(", "),
        arguments.max_pixels,
        arguments.max_samples,
        arguments.max_memory,
        arguments.kept,
        if arguments.without_token {
            "no token"
        } else {
            "with a token"
        },
    );
    std::io::stdout().flush()?;
    server.serve(transport)?;
    println!("ended");
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let all = env_logger::Env::default().default_filter_or("warn,render_server=info");
    env_logger::Builder::from_env(all).init();
    serve(&Arguments::parse())
}
