//! What optimising a scene takes beside a renderer.

pub mod loss;
