//! The palette of an animation, and what changes from frame to frame.

use std::collections::HashMap;

use crate::pixels::Image;

/// Colours of the palette; one more entry is transparent.
pub(crate) const COLOURS: usize = 255;
/// Index of the transparent entry.
pub(crate) const CLEAR: u8 = COLOURS as u8;
/// Time for which the last frame stays, s.
pub(crate) const REST_S: f64 = 1.5;

/// The rectangle in which a frame differs from the one before; pixels that do not are transparent.
pub(crate) struct Changes {
    pub(crate) x: u32,
    pub(crate) y: u32,
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) pixels: Vec<u8>,
}

impl Changes {
    /// Of two frames of the same size, `width` pixels wide.
    pub(crate) fn between(before: &[u8], now: &[u8], width: usize) -> Self {
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
pub(crate) struct Palette {
    colours: Vec<[u8; 3]>,
    index: HashMap<u32, u8>,
}

/// A colour by 6 bits for each component.
fn coarse(rgb: [u8; 3]) -> u32 {
    rgb.iter().fold(0, |all, &c| all << 6 | u32::from(c >> 2))
}

/// The middle of the colours with the same [`coarse`] bits: the entry of a colour does not depend on which one came first.
fn middle(rgb: [u8; 3]) -> [u8; 3] {
    rgb.map(|c| c & !3 | 2)
}

/// The nearest of some colours.
fn nearest(colours: &[[u8; 3]], rgb: [u8; 3]) -> u8 {
    let far = |c: &[u8; 3]| (0..3).map(|i| (i32::from(c[i]) - i32::from(rgb[i])).pow(2)).sum::<i32>();
    (0..colours.len()).min_by_key(|&i| far(&colours[i])).unwrap_or(0) as u8
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
    pub(crate) fn of(frames: &[Image]) -> Self {
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
        let index = sums
            .iter()
            .map(|(&key, (sum, n))| (key, nearest(&colours, sum.map(|s| (s / n) as u8))))
            .collect();
        Self { colours, index }
    }

    /// Entries of the pixels of an image. A colour that no frame of [`Palette::of`] has gets the nearest entry.
    pub(crate) fn indices(&mut self, image: &Image) -> Vec<u8> {
        let Self { colours, index } = self;
        let entry = |&rgb| *index.entry(coarse(rgb)).or_insert_with(|| nearest(colours, middle(rgb)));
        image.rgb.as_chunks::<3>().0.iter().map(entry).collect()
    }

    /// Red, green and blue of all entries, the transparent one last.
    pub(crate) fn table(&self) -> Vec<u8> {
        let mut table = self.colours.as_flattened().to_vec();
        table.resize(3 * (COLOURS + 1), 0);
        table
    }
}
