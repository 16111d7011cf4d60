//! The embedded font, which makes figures independent of the fonts of a machine.

use std::sync::Once;

use plotters::style::{FontDesc, FontFamily, FontStyle, register_font};

/// DejaVu Sans, reduced to Latin, Greek and mathematical characters; its licence is in the same folder.
const BYTES: &[u8] = include_bytes!("../assets/DejaVuSans.ttf");

/// Plotters sizes a font by its line height: 1.24 of the em (its SVG backend divides by it).
const LINE_HEIGHT: f64 = 1.24;

/// The font with size `size`, pixels. In SVG it is named `sans-serif`, because the viewer supplies the font.
pub(crate) fn font(size: f64) -> FontDesc<'static> {
    static REGISTERED: Once = Once::new();
    REGISTERED.call_once(|| {
        let registered = register_font("sans-serif", FontStyle::Normal, BYTES);
        assert!(registered.is_ok(), "the embedded font is damaged");
    });
    FontDesc::new(FontFamily::SansSerif, LINE_HEIGHT * size, FontStyle::Normal)
}

/// Width of a text of font size `size`, both in pixels.
pub(crate) fn width(text: &str, size: f64) -> f64 {
    // Measured at a large size, because plotters returns whole pixels.
    const LARGE: f64 = 200.0;
    let (w, _) = font(LARGE).box_size(text).expect("the embedded font measures any text");
    f64::from(w) * size / LARGE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_increase_with_text_and_size() {
        assert!(width("10", 12.0) > width("1", 12.0));
        assert!((width("10", 24.0) / width("10", 12.0) - 2.0).abs() < 1e-9);
        assert_eq!(width("", 12.0), 0.0);
    }
}
