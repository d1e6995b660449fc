//! The font of plots. plotters draws text in bitmaps only with a font that it was given.

use plotters::style::{FontStyle, register_font};

/// Makes `sans-serif` known to plotters. To be called before anything is drawn.
pub fn register() {
    let known = register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular());
    assert!(known.is_ok(), "DejaVu Sans is a font");
}
