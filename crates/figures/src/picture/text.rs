//! Labels: a small font of pen strokes, so that no font file is needed.

use tiny_skia::{LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Stroke, Transform};

use super::raster::Rgb;

/// Strokes of a letter. Points are pairs of digits: x from 0 to 4, y from 0 to 8
/// upwards with the baseline at 2. `~` starts a smooth stroke, `@` a closed one.
fn strokes(letter: char) -> &'static [&'static str] {
    match letter {
        '0' | 'O' => &["@08484202"],
        '1' => &["172822"],
        '2' => &["~0708484502", "0242"],
        '3' => &["~0708484515", "~1545420203"],
        '4' => &["38033343", "3632"],
        '5' => &["480805", "~0545420203"],
        '6' => &["@05454202", "~380804"],
        '7' => &["084812"],
        '8' => &["@05454202", "@08484505"],
        '9' => &["@08484505", "~464212"],
        '.' => &["1212"],
        ',' => &["1201"],
        ':' => &["1212", "1515"],
        '-' => &["1434"],
        '+' => &["0444", "2226"],
        '=' => &["0343", "0545"],
        '/' => &["0148"],
        '(' => &["~280521"],
        ')' => &["~084501"],
        'a' => &["@06464202", "4642"],
        'b' => &["0802", "@06464202"],
        'c' => &["~454606024243"],
        'd' => &["4842", "@06464202"],
        'e' => &["0444", "~444606024243"],
        'f' => &["~381817", "1712", "0636"],
        'g' => &["@06464202", "4642", "~42404000"],
        'h' => &["0802", "~04064643", "4342"],
        'i' => &["1612", "1818"],
        'j' => &["1612", "~121000", "1818"],
        'k' => &["0802", "3604", "1532"],
        'l' => &["1812"],
        'm' => &["0602", "~04062624", "2422", "~24264644", "4442"],
        'n' => &["0602", "~04064643", "4342"],
        'o' => &["@06464202"],
        'p' => &["0600", "@06464202"],
        'q' => &["4640", "@06464202"],
        'r' => &["0602", "~040636"],
        's' => &["~4546060444420203"],
        't' => &["1813", "~131232", "0636"],
        'u' => &["0605", "~05024245", "4642"],
        'v' => &["062246"],
        'w' => &["0612253246"],
        'x' => &["0642", "0246"],
        'y' => &["0622", "4610"],
        'z' => &["06460242"],
        'M' => &["0208254842"],
        'N' => &["02084248"],
        'P' => &["0208", "0818", "~18484515", "1505"],
        _ => &[],
    }
}

/// Capitals without a shape of their own are drawn as small letters.
fn shape(letter: char) -> &'static [&'static str] {
    match strokes(letter) {
        [] => strokes(letter.to_ascii_lowercase()),
        found => found,
    }
}

fn points(stroke: &str) -> Vec<[f32; 2]> {
    let digits = stroke.bytes().filter(u8::is_ascii_digit).map(|d| f32::from(d - b'0'));
    digits.collect::<Vec<_>>().as_chunks::<2>().0.to_vec()
}

/// Widths in pen units.
fn advance(letter: char) -> f32 {
    let right = shape(letter).iter().flat_map(|s| points(s)).map(|p| p[0]).reduce(f32::max);
    right.map_or(3.0, |r| r + 1.8)
}

/// Width of a label, in pixels.
pub(super) fn width(text: &str, size: f32) -> f32 {
    (text.chars().map(advance).sum::<f32>() - 1.8).max(0.0) * size / 6.0
}

fn path(text: &str, x: f32, y: f32, size: f32) -> Option<Path> {
    let unit = size / 6.0;
    let mut pen = PathBuilder::new();
    let mut left = x;
    for letter in text.chars() {
        for stroke in shape(letter) {
            let place = |[px, py]: [f32; 2]| [left + px * unit, y - (py - 2.0) * unit];
            let p: Vec<_> = points(stroke).into_iter().map(place).collect();
            let middle = |a: [f32; 2], b: [f32; 2]| [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
            match (stroke.as_bytes()[0], p.as_slice()) {
                (b'~', [first, inner @ .., last]) if !inner.is_empty() => {
                    pen.move_to(first[0], first[1]);
                    for (i, c) in inner.iter().enumerate() {
                        let to = inner.get(i + 1).map_or(*last, |&next| middle(*c, next));
                        pen.quad_to(c[0], c[1], to[0], to[1]);
                    }
                }
                (b'@', [first, .., last]) => {
                    let from = middle(*last, *first);
                    pen.move_to(from[0], from[1]);
                    for (i, c) in p.iter().enumerate() {
                        let to = middle(*c, p[(i + 1) % p.len()]);
                        pen.quad_to(c[0], c[1], to[0], to[1]);
                    }
                    pen.close();
                }
                (_, [first, rest @ ..]) => {
                    pen.move_to(first[0], first[1]);
                    for to in rest {
                        // A dot is a stroke of almost no length with round ends.
                        let dot = if to == first { 0.02 } else { 0.0 };
                        pen.line_to(to[0] + dot, to[1]);
                    }
                }
                _ => {}
            }
        }
        left += advance(letter) * unit;
    }
    pen.finish()
}

/// Writes a label with its baseline's left end at `(x, y)`; `size` is the height of
/// a capital in pixels.
pub(super) fn write(pixmap: &mut Pixmap, text: &str, [x, y]: [f32; 2], size: f32, colour: Rgb) {
    let Some(path) = path(text, x, y, size) else { return };
    let stroke = Stroke {
        width: (0.13 * size).max(1.0),
        line_cap: LineCap::Round,
        line_join: LineJoin::Round,
        ..Stroke::default()
    };
    pixmap.stroke_path(&path, &paint(colour), &stroke, Transform::identity(), None);
}

/// A plain, smooth-edged colour.
pub(super) fn paint(colour: Rgb) -> Paint<'static> {
    let mut paint = Paint::default();
    let [r, g, b] = colour.map(|c| (c.clamp(0.0, 1.0) * 255.0).round() as u8);
    paint.set_color_rgba8(r, g, b, 255);
    paint.anti_alias = true;
    paint
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_letter_of_a_label_has_a_shape() {
        let letters = ('a'..='z').chain('A'..='Z').chain('0'..='9').chain("-+.,:=/()".chars());
        for letter in letters {
            assert!(!shape(letter).is_empty(), "{letter}");
            for stroke in shape(letter) {
                assert_eq!(stroke.trim_start_matches(['~', '@']).len() % 2, 0, "{letter}");
                assert!(path(&letter.to_string(), 0.0, 9.0, 9.0).is_some(), "{letter}");
            }
        }
        assert!(width("10", 12.0) > width("1", 12.0));
    }
}
