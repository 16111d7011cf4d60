//! Colours of all figures: series colours and two colour scales.

/// Red, green and blue, 0 to 255.
pub use plotters::style::RGBColor as Colour;

/// Text and axes.
pub const INK: Colour = Colour(0x20, 0x26, 0x2e);
/// Reference lines and fits.
pub const GREY: Colour = Colour(0x6e, 0x75, 0x7d);
/// Grid lines.
pub const GRID: Colour = Colour(0xe0, 0xe4, 0xe8);
/// Background.
pub const PAPER: Colour = Colour(0xff, 0xff, 0xff);
/// Uncertainty band behind curves.
pub const BAND: Colour = Colour(0xdc, 0xe9, 0xf5);
/// Colours of series, in order: those of Okabe and Ito (2008), which people with colour blindness distinguish,
/// without yellow and black, and two of Tol.
pub const SERIES: [Colour; 8] = [
    Colour(0x00, 0x72, 0xb2),
    Colour(0xd5, 0x5e, 0x00),
    Colour(0x00, 0x9e, 0x73),
    Colour(0xcc, 0x79, 0xa7),
    Colour(0xe6, 0x9f, 0x00),
    Colour(0x56, 0xb4, 0xe9),
    Colour(0x33, 0x22, 0x88),
    Colour(0x99, 0x99, 0x33),
];

/// Colour of series `number`.
pub fn series(number: usize) -> Colour {
    SERIES[number % SERIES.len()]
}

/// A colour mixed with white: 0 is the colour, 1 is white.
pub fn pale(colour: Colour, white: f64) -> Colour {
    let mix = |c: u8| (f64::from(c) + white * (255.0 - f64::from(c))).round() as u8;
    Colour(mix(colour.0), mix(colour.1), mix(colour.2))
}

/// Colours from low to high values, with increasing lightness.
pub type Scale = &'static [u32];

/// Blue to yellow (viridis), for the flow and for maps.
pub const COOL: Scale =
    &[0x440154, 0x482878, 0x3e4989, 0x31688e, 0x26828e, 0x1f9e89, 0x35b779, 0x6ece58, 0xb5de2b, 0xfde725];
/// Violet to yellow (plasma without its darkest end), for fabric.
pub const WARM: Scale = &[0x4b2991, 0x7a2a9e, 0xa83296, 0xcf4886, 0xea6a6f, 0xf8915a, 0xfdba50, 0xfbe36a];

/// Red, green, blue from 0 to 1, for shading.
pub(crate) type Rgb = [f32; 3];

/// Colour at `t` from 0 to 1, for shading.
pub(crate) fn pick(scale: Scale, t: f64) -> Rgb {
    let last = scale.len() - 1;
    // The conversion maps NaN to 0.
    let x = (t.clamp(0.0, 1.0) * last as f64).max(0.0);
    let i = (x as usize).min(last - 1);
    let part = (x - i as f64) as f32;
    let rgb = |hex: u32| [16, 8, 0].map(|s| ((hex >> s) & 255) as f32 / 255.0);
    let (a, b) = (rgb(scale[i]), rgb(scale[i + 1]));
    [0, 1, 2].map(|c| a[c] + part * (b[c] - a[c]))
}

/// The nearest 8-bit colour.
pub(crate) fn shown(rgb: Rgb) -> Colour {
    let [r, g, b] = rgb.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8);
    Colour(r, g, b)
}

/// Colour at `t` from 0 to 1.
pub fn shade(scale: Scale, t: f64) -> Colour {
    shown(pick(scale, t))
}

/// Text colour with the better contrast on `colour`: ink or paper.
pub(crate) fn ink_on(colour: Colour) -> Colour {
    let light = 0.2126 * f64::from(colour.0) + 0.7152 * f64::from(colour.1) + 0.0722 * f64::from(colour.2);
    if light > 130.0 { INK } else { PAPER }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_increase_in_lightness_and_accept_any_value() {
        let light = |c: Rgb| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
        for scale in [COOL, WARM] {
            let row: Vec<f32> = (0..=40).map(|i| light(pick(scale, f64::from(i) / 40.0))).collect();
            assert!(row.windows(2).all(|w| w[1] > w[0] - 1e-3), "{row:?}");
            for odd in [f64::NAN, f64::INFINITY, -7.0] {
                assert!(pick(scale, odd).iter().all(|c| (0.0..=1.0).contains(c)));
            }
        }
        assert_eq!((ink_on(PAPER), ink_on(SERIES[0])), (INK, PAPER));
        assert_eq!((pale(SERIES[0], 0.0), pale(SERIES[0], 1.0)), (SERIES[0], PAPER));
    }
}
