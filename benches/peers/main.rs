//! What `benches/peers/run` measures of this project: one request, a line of JSON, is answered on the standard output
//! by another. `mitsuba_side.py` answers the same requests by Mitsuba, so that both are measured alike.

mod bits;
mod camera;
mod fits;
mod gradient;
mod image;
mod scenes;
mod speed;

use std::error::Error;

use serde::Deserialize;

type Answer = Result<serde_json::Value, Box<dyn Error>>;

#[derive(Deserialize)]
#[serde(tag = "measure", rename_all = "snake_case")]
enum Request {
    /// Seconds of an image, or of an image and its backward pass.
    Speed(speed::Request),
    /// Images of several seeds, with their times.
    Image(image::Request),
    /// Estimates of one derivative, with their times.
    Gradient(gradient::Request),
    /// The bits of an image and of its gradient.
    Bits(bits::Request),
    /// Gradients by camera, lens and shutter beside differences.
    Camera(camera::Request),
    /// Fits and their errors over time.
    Fit(fits::Request),
}

fn main() -> Result<(), Box<dyn Error>> {
    let request = std::env::args().nth(1).filter(|a| a.starts_with('{'));
    let Some(request) = request else {
        eprintln!("a part of `benches/peers/run`, which tells it what to measure");
        return Ok(());
    };
    let answer = match serde_json::from_str(&request)? {
        Request::Speed(r) => r.answer()?,
        Request::Image(r) => r.answer()?,
        Request::Gradient(r) => r.answer()?,
        Request::Bits(r) => r.answer()?,
        Request::Camera(r) => r.answer()?,
        Request::Fit(r) => r.answer()?,
    };
    println!("{answer}");
    Ok(())
}
