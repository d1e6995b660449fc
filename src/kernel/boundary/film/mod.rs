//! Jumps of the image that the camera sees.
//!
//! Edges are drawn on the film: where they are seen, in proportion to their length there, to how much may
//! jump at them and to how much the loss depends on the pixels about. So no sample is spent where nothing
//! is asked, and the noise does not depend on how wide the camera's cone is.

mod pieces;
mod pixels;
mod samples;

pub(crate) use pixels::PixelGradients;
