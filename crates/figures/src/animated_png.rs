//! Animated PNG (APNG): frames in one palette, of which later ones hold only the pixels that change.

use std::collections::HashMap;

use png::{BlendOp, DisposeOp, EncodingError};

use crate::pixels::Image;

/// Colours of the palette; one more entry is transparent.
const COLOURS: usize = 255;
/// Index of the transparent entry.
const CLEAR: u8 = COLOURS as u8;
/// Time for which the last frame stays, s.
const REST_S: f64 = 1.5;

/// Bytes of an animated PNG file that repeats without end, `fps` frames a second. Frames have one size.
pub(crate) fn encode(frames: &[Image], fps: u16) -> Vec<u8> {
    let palette = Palette::of(frames);
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
    let mut colours = palette.colours.as_flattened().to_vec();
    colours.resize(3 * (COLOURS + 1), 0);
    encoder.set_palette(colours);
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

/// The rectangle in which a frame differs from the one before; pixels that do not are transparent.
struct Changes {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
    pixels: Vec<u8>,
}

impl Changes {
    fn between(before: &[u8], now: &[u8], width: usize) -> Self {
        let differs = |&i: &usize| before[i] != now[i];
        let (mut x, mut y) = ([usize::MAX, 0], [usize::MAX, 0]);
        for i in (0..now.len()).filter(differs) {
            let at = (i % width, i / width);
            x = [x[0].min(at.0), x[1].max(at.0)];
            y = [y[0].min(at.1), y[1].max(at.1)];
        }
        if x[0] > x[1] {
            // A frame holds at least one pixel.
            (x, y) = ([0; 2], [0; 2]);
        }
        let row = |row: usize| (x[0]..=x[1]).map(move |column| row * width + column);
        let pixels = (y[0]..=y[1]).flat_map(row).map(|i| if differs(&i) { now[i] } else { CLEAR }).collect();
        let [x, y] = [x, y].map(|[a, b]| (a as u32, (b - a + 1) as u32));
        Self { x: x.0, y: y.0, width: x.1, height: y.1, pixels }
    }
}

/// At most [`COLOURS`] colours, and the one that stands for each colour of the frames, by its [`coarse`] bits.
struct Palette {
    colours: Vec<[u8; 3]>,
    index: HashMap<u32, u8>,
}

/// A colour by 6 bits for each component.
fn coarse(rgb: [u8; 3]) -> u32 {
    rgb.iter().fold(0, |all, &c| all << 6 | u32::from(c >> 2))
}

/// Colours that stand for one entry: how many pixels have each.
struct Cell(Vec<([u8; 3], u64)>);

impl Cell {
    /// The component with the largest spread, and that spread.
    fn longest(&self) -> (usize, u8) {
        let spread = |c: usize| {
            let values = || self.0.iter().map(|(rgb, _)| rgb[c]);
            (c, values().max().unwrap_or(0) - values().min().unwrap_or(0))
        };
        (0..3).map(spread).max_by_key(|(_, spread)| *spread).unwrap_or((0, 0))
    }

    /// How much a split is worth: the spread, weighted by the root of the number of pixels.
    fn worth(&self) -> f64 {
        let pixels: u64 = self.0.iter().map(|(_, n)| n).sum();
        f64::from(self.longest().1) * (pixels as f64).powf(0.35)
    }

    /// Both sides of the median pixel along the longest side.
    fn split(mut self) -> [Self; 2] {
        let (c, _) = self.longest();
        self.0.sort_unstable_by_key(|(rgb, _)| rgb[c]);
        let half = self.0.iter().map(|(_, n)| n).sum::<u64>() / 2;
        let mut below = 0;
        let median = self.0.iter().position(|(_, n)| {
            below += n;
            below > half
        });
        let at = median.unwrap_or(0).clamp(1, self.0.len() - 1);
        let upper = self.0.split_off(at);
        [self, Self(upper)]
    }

    fn mean(&self) -> [u8; 3] {
        let all: u64 = self.0.iter().map(|(_, n)| n).sum();
        [0, 1, 2].map(|c| {
            let sum: u64 = self.0.iter().map(|(rgb, n)| u64::from(rgb[c]) * n).sum();
            ((sum + all / 2) / all) as u8
        })
    }
}

impl Palette {
    /// Median cut (Heckbert 1982) over the colours of all frames.
    fn of(frames: &[Image]) -> Self {
        let mut sums: HashMap<u32, ([u64; 3], u64)> = HashMap::new();
        for &rgb in frames.iter().flat_map(|f| f.rgb.as_chunks::<3>().0) {
            let (sum, n) = sums.entry(coarse(rgb)).or_default();
            *n += 1;
            (0..3).for_each(|c| sum[c] += u64::from(rgb[c]));
        }
        let mut all: Vec<_> =
            sums.values().map(|(sum, n)| (sum.map(|s| ((s + n / 2) / n) as u8), *n)).collect();
        // The order of a hash map is not that of another run.
        all.sort_unstable();
        let mut cells = vec![Cell(all)];
        while cells.len() < COLOURS {
            let best = (0..cells.len())
                .filter(|&i| cells[i].0.len() > 1)
                .max_by(|&a, &b| cells[a].worth().total_cmp(&cells[b].worth()));
            let Some(best) = best else { break };
            let [low, high] = cells.swap_remove(best).split();
            cells.extend([low, high]);
        }
        let colours: Vec<[u8; 3]> = cells.iter().map(Cell::mean).collect();
        let index = sums.iter().map(|(&key, (sum, n))| {
            let rgb = sum.map(|s| (s / n) as i32);
            let far = |c: &[u8; 3]| (0..3).map(|i| (i32::from(c[i]) - rgb[i]).pow(2)).sum::<i32>();
            let nearest = (0..colours.len()).min_by_key(|&i| far(&colours[i])).unwrap_or(0);
            (key, nearest as u8)
        });
        let index = index.collect();
        Self { colours, index }
    }

    fn indices(&self, image: &Image) -> Vec<u8> {
        image.rgb.as_chunks::<3>().0.iter().map(|&rgb| self.index[&coarse(rgb)]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
