//! Renders of scenes on devices of servers, as custom operations of burn-remote.
//!
//! A client sends handles of the scene's tensors and, as tensors of words, what else a batch has. A render returns rows
//! of images, counts, and a sentence if it failed. A gradient returns one row for all tracked tensors. What a forward
//! pass prepared stays on the server for its backward pass.

pub(crate) mod bounded;
pub(super) mod client;
pub(crate) mod message;
mod sent;
pub(crate) mod words;
