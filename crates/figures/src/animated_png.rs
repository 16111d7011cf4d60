//! Animated PNG (APNG): frames in one palette, of which later ones hold only the pixels that change.

use png::{BlendOp, DisposeOp, EncodingError};

use crate::palette::{COLOURS, Changes, Palette, REST_S};
use crate::pixels::Image;

/// Bytes of an animated PNG file that repeats without end, `fps` frames a second. Frames have one size.
pub(crate) fn encode(frames: &[Image], fps: u16) -> Vec<u8> {
    let mut palette = Palette::of(frames);
    let indices: Vec<Vec<u8>> = frames.iter().map(|f| palette.indices(f)).collect();
    let mut bytes = Vec::new();
    let written = write(&mut bytes, frames, &indices, &palette, fps);
    written.expect("frames of one size are encoded in memory");
    bytes
}

fn write(
    bytes: &mut Vec<u8>,
    frames: &[Image],
    indices: &[Vec<u8>],
    palette: &Palette,
    fps: u16,
) -> Result<(), EncodingError> {
    let (width, height) = (frames[0].width, frames[0].height);
    let mut encoder = png::Encoder::new(bytes, width, height);
    encoder.set_color(png::ColorType::Indexed);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_palette(palette.table());
    let mut alpha = vec![255; COLOURS];
    alpha.push(0);
    encoder.set_trns(alpha);
    encoder.set_compression(png::Compression::Best);
    encoder.set_adaptive_filter(png::AdaptiveFilterType::NonAdaptive);
    encoder.set_filter(png::FilterType::NoFilter);
    encoder.set_animated(frames.len() as u32, 0)?;
    encoder.set_frame_delay(1, fps)?;
    let mut writer = encoder.write_header()?;
    writer.set_blend_op(BlendOp::Over)?;
    writer.set_dispose_op(DisposeOp::None)?;
    writer.write_image_data(&indices[0])?;
    for (i, pair) in indices.windows(2).enumerate() {
        if i + 2 == indices.len() {
            writer.set_frame_delay((REST_S * f64::from(fps)) as u16, fps)?;
        }
        let changed = Changes::between(&pair[0], &pair[1], width as usize);
        // In this order: the library checks position and size against each other.
        writer.reset_frame_position()?;
        writer.set_frame_dimension(changed.width, changed.height)?;
        writer.set_frame_position(changed.x, changed.y)?;
        writer.write_image_data(&changed.pixels)?;
    }
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::palette::CLEAR;

    /// A square that moves over a ramp of colours.
    fn frames() -> Vec<Image> {
        let frame = |k: u32| {
            let pixel = |i: u32| {
                let (x, y) = (i % 64, i / 64);
                let inside = (10 + 6 * k..18 + 6 * k).contains(&x) && (8..16).contains(&y);
                if inside { [255, 0, 0] } else { [(4 * x) as u8, (7 * y) as u8, 120] }
            };
            Image { width: 64, height: 32, rgb: (0..64 * 32).flat_map(pixel).collect() }
        };
        (0..5).map(frame).collect()
    }

    /// Frames of an animation as a viewer composes them, with their times in s.
    fn compose(bytes: &[u8]) -> Vec<(f64, Image)> {
        let mut decoder = png::Decoder::new(bytes);
        decoder.set_transformations(png::Transformations::IDENTITY);
        let mut reader = decoder.read_info().unwrap();
        let (width, height) = (reader.info().width, reader.info().height);
        let palette = reader.info().palette.clone().unwrap().into_owned();
        let count = reader.info().animation_control.unwrap().num_frames;
        let mut shown = Image { width, height, rgb: vec![0; 3 * (width * height) as usize] };
        let mut all = Vec::new();
        for _ in 0..count {
            let mut indices = vec![0; reader.output_buffer_size()];
            let info = reader.next_frame(&mut indices).unwrap();
            let control = *reader.info().frame_control.as_ref().unwrap();
            for (i, &index) in indices[..info.buffer_size()].iter().enumerate() {
                let (x, y) = (i as u32 % control.width, i as u32 / control.width);
                let to = 3 * ((y + control.y_offset) * width + x + control.x_offset) as usize;
                if index != CLEAR {
                    shown.rgb[to..to + 3].copy_from_slice(&palette[3 * usize::from(index)..][..3]);
                }
            }
            let time = f64::from(control.delay_num) / f64::from(control.delay_den);
            all.push((time, Image { width, height, rgb: shown.rgb.clone() }));
        }
        all
    }

    #[test]
    fn composed_frames_are_the_frames_to_the_resolution_of_the_palette() {
        let frames = frames();
        let bytes = encode(&frames, 10);
        let found = compose(&bytes);
        assert_eq!(found.iter().map(|(time, _)| *time).collect::<Vec<_>>(), [0.1, 0.1, 0.1, 0.1, 1.5]);
        for (frame, (_, found)) in frames.iter().zip(&found) {
            let worst = frame.rgb.iter().zip(&found.rgb).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(worst < Some(24), "{worst:?}");
        }
        // Later frames hold the square alone.
        assert!(bytes.len() < 2 * encode(&frames[..1], 10).len(), "{}", bytes.len());
        assert_eq!(bytes, encode(&frames, 10), "the same frames, the same bytes");
    }

    #[test]
    fn equal_frames_take_a_pixel() {
        let [first, ..] = &frames()[..] else { unreachable!() };
        let still = || Image { rgb: first.rgb.clone(), ..*first };
        let (one, three) = (encode(&[still()], 5), encode(&[still(), still(), still()], 5));
        assert!(three.len() < one.len() + 250, "{} {}", one.len(), three.len());
        assert_eq!(compose(&three).len(), 3);
    }
}
