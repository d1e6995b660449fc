//! What optimising a scene takes beside a renderer.

pub mod loss;
mod schedule;

pub use schedule::{Blur, BlurSchedule, PlateauBlur, pixel_footprint};
