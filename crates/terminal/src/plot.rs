//! A curve as lines of text: braille dots, two across and four down in each character.

/// Characters of the labels of the vertical axis, with the space after them.
const LABELS: usize = 11;
/// Fewest characters of a curve: room for both ends of the horizontal axis.
const MIN_WIDTH: usize = 24;
/// Dots of a character across and down.
const DOTS: [usize; 2] = [2, 4];
/// The character without a dot.
const BLANK: u32 = 0x2800;

/// Bits of the dots of a braille character, by row and column.
const BITS: [[u32; 2]; 4] = [[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]];

/// A raster of dots.
struct Canvas {
    columns: usize,
    rows: usize,
    cells: Vec<u32>,
}

impl Canvas {
    fn new(columns: usize, rows: usize) -> Self {
        Self { columns, rows, cells: vec![0; columns * rows] }
    }

    /// Sets the dot at `x` from the left and `y` from the top.
    fn set(&mut self, x: usize, y: usize) {
        let (column, row) = (x / DOTS[0], y / DOTS[1]);
        if column < self.columns && row < self.rows {
            self.cells[row * self.columns + column] |= BITS[y % DOTS[1]][x % DOTS[0]];
        }
    }

    /// Sets the dots of a straight line.
    fn line(&mut self, [x0, y0]: [usize; 2], [x1, y1]: [usize; 2]) {
        let steps = x0.abs_diff(x1).max(y0.abs_diff(y1)).max(1);
        for k in 0..=steps {
            let share = k as f64 / steps as f64;
            let at = |a: usize, b: usize| (a as f64 + share * (b as f64 - a as f64)).round() as usize;
            self.set(at(x0, x1), at(y0, y1));
        }
    }

    fn row(&self, row: usize) -> String {
        let cells = &self.cells[row * self.columns..(row + 1) * self.columns];
        let letters = cells.iter().filter_map(|c| char::from_u32(BLANK + c));
        letters.collect::<String>().trim_end_matches('\u{2800}').to_owned()
    }
}

/// A number with the decimals that distinguish values which differ by `step`.
pub fn number(value: f64, step: f64) -> String {
    let size = value.abs();
    if size >= 1e6 || (size > 0.0 && size < 1e-4) {
        return format!("{value:.2e}");
    }
    let places = if step > 0.0 { (1.0 - step.log10().floor()).clamp(0.0, 6.0) as usize } else { 4 };
    format!("{value:.places$}")
}

/// The curve through `points` (x, y) as lines of at most `columns` characters, `rows` of them for the curve and one
/// below for the ends of the horizontal axis, in `unit`. A value that is not finite interrupts the curve. Empty without
/// a finite point, and where there is no room.
///
/// # Examples
///
/// ```
/// let points: Vec<(f64, f64)> = (0..=20).map(|i| (f64::from(i), f64::from(i * i))).collect();
/// let lines = terminal::plot::plot(&points, "s", 40, 5);
/// assert_eq!(lines.len(), 6);
/// assert!(lines[0].starts_with("     400 ┤") && lines[4].starts_with("       0 ┤"), "{lines:#?}");
/// assert!(lines[5].ends_with("20.00 s") && lines.iter().all(|l| l.chars().count() <= 40));
/// ```
pub fn plot(points: &[(f64, f64)], unit: &str, columns: usize, rows: usize) -> Vec<String> {
    let finite = || points.iter().filter(|p| p.0.is_finite() && p.1.is_finite());
    let Some(width) = columns.checked_sub(LABELS).filter(|w| *w >= MIN_WIDTH && rows > 0) else {
        return Vec::new();
    };
    if finite().next().is_none() {
        return Vec::new();
    }
    let range = |of: fn(&(f64, f64)) -> f64| {
        finite().map(of).fold([f64::MAX, f64::MIN], |[low, high], v| [low.min(v), high.max(v)])
    };
    let [left, right] = range(|p| p.0);
    let [low, high] = widened(range(|p| p.1));
    let last = [DOTS[0] * width - 1, DOTS[1] * rows - 1];
    let place = |p: &(f64, f64)| {
        let across = if right > left { (p.0 - left) / (right - left) } else { 0.0 };
        let up = (p.1 - low) / (high - low);
        [(across * last[0] as f64).round() as usize, ((1.0 - up) * last[1] as f64).round() as usize]
    };
    let mut canvas = Canvas::new(width, rows);
    let mut before = None;
    for point in points {
        let here = (point.0.is_finite() && point.1.is_finite()).then(|| place(point));
        if let Some(here) = here {
            canvas.line(before.unwrap_or(here), here);
        }
        before = here;
    }
    let step = (high - low) / rows as f64;
    let label = |row: usize| match row {
        0 => number(high, step),
        _ if row + 1 == rows => number(low, step),
        _ => String::new(),
    };
    let mark = |row: usize| if row == 0 || row + 1 == rows { '┤' } else { '│' };
    let mut lines: Vec<String> = (0..rows)
        .map(|row| format!("{:>8} {}{}", label(row), mark(row), canvas.row(row)).trim_end().to_owned())
        .collect();
    let step = (right - left) / width as f64;
    let ends = [left, right].map(|x| format!("{} {unit}", number(x, step)).trim_end().to_owned());
    let between = (width + 1).saturating_sub(ends.iter().map(|e| e.chars().count()).sum());
    lines.push(format!("{:>9}{}{}{}", "", ends[0], " ".repeat(between.max(1)), ends[1]));
    lines
}

/// A range that is not empty: a constant is in its middle.
fn widened([low, high]: [f64; 2]) -> [f64; 2] {
    let size = high.abs().max(low.abs());
    if high - low > 1e-9 * size {
        return [low, high];
    }
    let margin = if size > 0.0 { 0.05 * size } else { 1.0 };
    [low - margin, high + margin]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A straight line from corner to corner of 8 x 8 dots: the dots of each character are by hand.
    #[test]
    fn straight_line_joins_the_corners() {
        let mut canvas = Canvas::new(4, 2);
        canvas.line([0, 7], [7, 0]);
        assert_eq!([canvas.row(0), canvas.row(1)], ["\u{2800}\u{2800}⡠⠊", "⡠⠊"]);
        let mut falls = Canvas::new(4, 2);
        falls.line([0, 0], [7, 7]);
        assert_eq!([falls.row(0), falls.row(1)], ["⠑⢄", "\u{2800}\u{2800}⠑⢄"]);
        let lines = plot(&[(0.0, 0.0), (1.0, 1.0)], "s", LABELS + 24, 2);
        let dots = |line: &str| line.chars().skip(10).filter(|c| *c != '\u{2800}').count();
        assert_eq!((dots(&lines[0]), dots(&lines[1])), (12, 12), "{lines:#?}");
        assert_eq!(lines[2], format!("{:>9}0.000 s{:11}1.000 s", "", ""));
    }

    #[test]
    fn gaps_constants_and_small_widths_are_drawn_or_left_out() {
        let gap = plot(&[(0.0, 1.0), (1.0, f64::NAN), (2.0, 1.0)], "s", 40, 3);
        assert_eq!(gap[1].chars().filter(|c| !"│ \u{2800}".contains(*c)).count(), 2, "{gap:#?}");
        assert!(gap[0].starts_with("   1.050 ┤") && gap[2].starts_with("   0.950 ┤"), "{gap:#?}");
        assert!(plot(&[(0.0, 0.0)], "s", 40, 3)[1].contains('⠄'));
        for (points, columns, rows) in [
            (vec![], 80, 5),
            (vec![(0.0, f64::NAN)], 80, 5),
            (vec![(0.0, 1.0)], LABELS + 23, 5),
            (vec![(0.0, 1.0)], 80, 0),
        ] {
            assert_eq!(plot(&points, "s", columns, rows), Vec::<String>::new());
        }
    }

    #[test]
    fn numbers_have_the_decimals_of_their_step() {
        for (value, step, text) in [
            (3.9751, 0.003, "3.9751"),
            (1045.2, 30.0, "1045"),
            (0.0, 0.1, "0.00"),
            (2.5e7, 1e6, "2.50e7"),
            (3e-7, 1e-8, "3.00e-7"),
            (1.0, 0.0, "1.0000"),
        ] {
            assert_eq!(number(value, step), text);
        }
    }
}
