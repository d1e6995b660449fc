//! Servers as processes: this program again, with the example's `serve`.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};

use clap::Parser;
use softray::prelude::*;
use softray::remote::connect;

use crate::common::process::again;

#[allow(dead_code)] // an example is a program of its own
#[path = "../../examples/render_server.rs"]
mod render_server;

const ARGUMENTS: &str = "SOFTRAY_SERVER";
pub const TOKEN: &str = "a token of the tests";

/// The server's process, if the variable has its arguments.
#[test]
fn process() {
    let Ok(arguments) = std::env::var(ARGUMENTS) else {
        return;
    };
    let arguments = ["render_server"].into_iter().chain(arguments.split(' '));
    let arguments = render_server::Arguments::parse_from(arguments);
    // The pipe closes when the program that started this one ends, so servers in statics end, too.
    std::thread::spawn(|| {
        let _ = std::io::stdin().read(&mut [0]);
        std::process::exit(0)
    });
    render_server::serve(&arguments).expect("a server");
}

pub struct Server {
    pub child: Child,
    /// `host:port`.
    pub address: String,
    output: BufReader<std::process::ChildStdout>,
}

impl Server {
    pub fn start() -> Self {
        Self::with("--bind 127.0.0.1:0")
    }

    pub fn with(arguments: &str) -> Self {
        static NUMBER: AtomicUsize = AtomicUsize::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let name = format!("softray-token-{}-{number}", std::process::id());
        let file = std::env::temp_dir().join(name);
        std::fs::write(&file, TOKEN).expect("a file");
        let all = format!("{arguments} --token-file {}", file.display());
        let mut command: Command = again(process);
        let command = command.env(ARGUMENTS, all).env("RAYON_NUM_THREADS", "1");
        let command = command.stdin(Stdio::piped());
        let mut child = command.stdout(Stdio::piped()).spawn().expect("a process");
        let mut output = BufReader::new(child.stdout.take().expect("its output"));
        let mut line = String::new();
        let address = loop {
            line.clear();
            assert!(
                output.read_line(&mut line).expect("a line") > 0,
                "no server"
            );
            if let Some((_, rest)) = line.split_once("ws://") {
                break rest.split(": ").next().expect("an address").to_owned();
            }
        };
        // The server has read it.
        std::fs::remove_file(&file).expect("the file");
        Self {
            child,
            address,
            output,
        }
    }

    pub fn device(&self) -> Device {
        connect(&format!("ws://{}", self.address), TOKEN).expect("a device")
    }

    /// Ends the server by SIGTERM, and returns what it printed since its first line.
    pub fn end(mut self) -> (bool, String) {
        let id = self.child.id().to_string();
        let killed = Command::new("kill").args(["-TERM", &id]).status();
        assert!(killed.expect("kill").success());
        let mut rest = String::new();
        self.output.read_to_string(&mut rest).expect("the rest");
        (self.child.wait().expect("an end").success(), rest)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
