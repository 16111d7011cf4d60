//! Animated GIF, written frame by frame: later frames hold only the pixels that change.

use std::io::Write;

use gif::{Encoder, EncodingError, Frame, Repeat};

use crate::palette::{CLEAR, Changes, Palette, REST_S};
use crate::pixels::Image;

/// An animated GIF that repeats without end.
pub(crate) struct GifFile<W: Write> {
    encoder: Encoder<W>,
    palette: Palette,
    width: u16,
    /// Hundredths of a second for which a frame stays.
    delay: u16,
    /// The frame that waits for its duration, and the entries of all its pixels.
    waiting: Option<(Frame<'static>, Vec<u8>)>,
}

impl<W: Write> GifFile<W> {
    /// An animation in the colours of some of its frames, `fps` frames a second, to hundredths of a second.
    ///
    /// # Errors
    /// The output fails.
    pub(crate) fn new(out: W, some: &[Image], fps: u16) -> Result<Self, EncodingError> {
        let (width, height) = some.first().map_or((1, 1), |f| (f.width as u16, f.height as u16));
        let palette = Palette::of(some);
        let mut encoder = Encoder::new(out, width, height, &palette.table())?;
        encoder.set_repeat(Repeat::Infinite)?;
        Ok(Self { encoder, palette, width, delay: (100 + fps / 2) / fps, waiting: None })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// The output fails.
    pub(crate) fn add(&mut self, image: &Image) -> Result<(), EncodingError> {
        let indices = self.palette.indices(image);
        let frame = match &self.waiting {
            None => Frame {
                width: self.width,
                height: image.height as u16,
                buffer: indices.clone().into(),
                ..Frame::default()
            },
            Some((_, before)) => {
                let changed = Changes::between(before, &indices, usize::from(self.width));
                Frame {
                    left: changed.x as u16,
                    top: changed.y as u16,
                    width: changed.width as u16,
                    height: changed.height as u16,
                    transparent: Some(CLEAR),
                    buffer: changed.pixels.into(),
                    ..Frame::default()
                }
            }
        };
        self.write(self.delay)?;
        self.waiting = Some((frame, indices));
        Ok(())
    }

    fn write(&mut self, delay: u16) -> Result<(), EncodingError> {
        match self.waiting.take() {
            Some((frame, _)) => self.encoder.write_frame(&Frame { delay, ..frame }),
            None => Ok(()),
        }
    }

    /// Writes the last frame, which stays longer.
    ///
    /// # Errors
    /// The output fails.
    pub(crate) fn finish(mut self) -> Result<(), EncodingError> {
        self.write((100.0 * REST_S) as u16)?;
        self.encoder.into_inner()?.flush()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square that moves over a ramp of colours; its colour is in the last frames only.
    fn frame(k: u32) -> Image {
        let pixel = |i: u32| {
            let (x, y) = (i % 64, i / 64);
            let inside = (10 + 6 * k..18 + 6 * k).contains(&x) && (8..16).contains(&y);
            if inside { [250, (60 * k) as u8, 0] } else { [(4 * x) as u8, (7 * y) as u8, 120] }
        };
        Image { width: 64, height: 32, rgb: (0..64 * 32).flat_map(pixel).collect() }
    }

    fn encode(n: u32, some: &[Image]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut file = GifFile::new(&mut bytes, some, 12).unwrap();
        (0..n).for_each(|k| file.add(&frame(k)).unwrap());
        file.finish().unwrap();
        bytes
    }

    #[test]
    fn composed_frames_are_the_frames_to_the_resolution_of_the_palette() {
        let bytes = encode(4, &[frame(0), frame(3)]);
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options.read_info(&bytes[..]).unwrap();
        assert_eq!((decoder.width(), decoder.height(), decoder.repeat()), (64, 32, Repeat::Infinite));
        let mut shown = vec![0; 64 * 32 * 3];
        let mut delays = Vec::new();
        let mut k = 0;
        while let Some(part) = decoder.read_next_frame().unwrap() {
            for (i, rgba) in part.buffer.as_chunks::<4>().0.iter().enumerate() {
                let (x, y) = (i % usize::from(part.width), i / usize::from(part.width));
                let to = 3 * ((y + usize::from(part.top)) * 64 + x + usize::from(part.left));
                if rgba[3] > 0 {
                    shown[to..to + 3].copy_from_slice(&rgba[..3]);
                }
            }
            let worst = frame(k).rgb.iter().zip(&shown).map(|(a, b)| a.abs_diff(*b)).max();
            // Frames 1 and 2 have colours that the palette was not made for.
            assert!(worst <= Some(if k % 3 == 0 { 24 } else { 64 }), "frame {k}: {worst:?}");
            delays.push(part.delay);
            k += 1;
        }
        assert_eq!(delays, [8, 8, 8, 150]);
        assert_eq!(bytes, encode(4, &[frame(0), frame(3)]), "the same frames, the same bytes");
        let one = encode(1, &[frame(0), frame(3)]).len();
        assert!(bytes.len() < 2 * one, "later frames hold the square alone: {} and {one}", bytes.len());
    }
}
