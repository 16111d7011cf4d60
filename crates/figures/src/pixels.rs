//! Raster images with supersampling.

use std::path::Path;

use coupling::error::RunError;
use plotters::coord::Shift;
use plotters::prelude::{BitMapBackend, DrawingArea, IntoDrawingArea};

use crate::colour::Colour;

/// Samples per pixel in each direction; also units per pixel in SVG, whose coordinates are integers.
pub(crate) const FINE: u32 = 3;

/// Samples of an image, row by row.
pub(crate) struct Samples {
    width: u32,
    height: u32,
    pub(crate) rgb: Vec<[u8; 3]>,
}

impl Samples {
    /// An image of `width` by `height` pixels in one colour.
    pub(crate) fn new([width, height]: [u32; 2], background: Colour) -> Self {
        let n = (width * FINE) as usize * (height * FINE) as usize;
        Self { width, height, rgb: vec![[background.0, background.1, background.2]; n] }
    }

    /// Width and height, pixels.
    pub(crate) fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// The samples as a drawing area.
    pub(crate) fn area(&mut self) -> DrawingArea<BitMapBackend<'_>, Shift> {
        let size = (self.width * FINE, self.height * FINE);
        BitMapBackend::with_buffer(self.rgb.as_flattened_mut(), size).into_drawing_area()
    }

    /// The averaged image.
    pub(crate) fn average(&self) -> Image {
        let (fine, width) = (FINE as usize, self.width as usize);
        let row_of_samples = width * fine;
        let mut rgb = Vec::with_capacity(3 * width * self.height as usize);
        for row in 0..self.height as usize {
            for column in 0..width {
                let mut sum = [fine * fine / 2; 3];
                for y in 0..fine {
                    let from = (row * fine + y) * row_of_samples + column * fine;
                    for sample in &self.rgb[from..from + fine] {
                        for c in 0..3 {
                            sum[c] += usize::from(sample[c]);
                        }
                    }
                }
                rgb.extend(sum.map(|s| (s / (fine * fine)) as u8));
            }
        }
        Image { width: self.width, height: self.height, rgb }
    }
}

/// An image: rows of red, green and blue.
pub(crate) struct Image {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) rgb: Vec<u8>,
}

impl Image {
    /// The bytes of a PNG file.
    pub(crate) fn png(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        let written = self.encode(&mut bytes);
        written.expect("a picture with pixels is encoded in memory");
        bytes
    }

    fn encode(&self, bytes: &mut Vec<u8>) -> Result<(), png::EncodingError> {
        let mut encoder = png::Encoder::new(bytes, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::Best);
        encoder.set_adaptive_filter(png::AdaptiveFilterType::Adaptive);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.rgb)?;
        writer.finish()
    }

    /// Copies another picture into this one, its upper left corner at `(x, y)`; what lies outside is cut off.
    pub(crate) fn paste(&mut self, other: &Image, (x, y): (u32, u32)) {
        let columns = other.width.min(self.width.saturating_sub(x)) as usize;
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let from = 3 * (row * other.width) as usize;
            let to = 3 * ((y + row) * self.width + x) as usize;
            self.rgb[to..to + 3 * columns].copy_from_slice(&other.rgb[from..from + 3 * columns]);
        }
    }

    /// Writes a PNG file.
    pub(crate) fn save(&self, path: &Path) -> Result<(), RunError> {
        std::fs::write(path, self.png()).map_err(RunError::file("write", path))
    }
}

/// Reads a PNG file, for tests.
#[cfg(test)]
pub(crate) fn decode(bytes: &[u8]) -> Image {
    let mut reader = png::Decoder::new(bytes).read_info().unwrap();
    let mut rgb = vec![0; reader.output_buffer_size()];
    let info = reader.next_frame(&mut rgb).unwrap();
    assert_eq!(info.color_type, png::ColorType::Rgb);
    Image { width: info.width, height: info.height, rgb }
}

#[cfg(test)]
impl Image {
    /// Colour of a pixel.
    pub(crate) fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let at = 3 * (y * self.width + x) as usize;
        [0, 1, 2].map(|c| self.rgb[at + c])
    }
}
