//! The one place that draws random numbers.

mod dimension;
mod mix;
mod numbers;
mod points;
mod source;
mod uniform;

pub(crate) use dimension::Dimension;
pub(crate) use mix::mix;
pub(crate) use numbers::{Numbers, RUN, Run};
pub(crate) use source::Sampler;
