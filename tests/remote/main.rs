//! Renders on servers, which are processes of their own: the example `render_server`.
#![allow(clippy::unwrap_used)]

mod bytes;
#[path = "../common/mod.rs"]
mod common;
mod faults;
mod same;
mod server;
mod training;
