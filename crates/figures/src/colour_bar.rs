//! Colour bar: the colours of a scale with their values.

use crate::colour::{INK, Scale, shade};
use crate::sheet::{Anchor, Canvas, Drawn, Sheet};

/// A colour bar, from low (left) to high values.
pub(crate) struct ColourBar<'a> {
    pub(crate) title: &'a str,
    pub(crate) scale: Scale,
    /// Labels and their positions, 0 to 1 along the bar.
    pub(crate) marks: Vec<(f64, String)>,
}

impl ColourBar<'_> {
    /// Draws the bar from `corner`, with title above and labels below. Lengths in pixels; `text` is the font size.
    pub(crate) fn draw<DB: Canvas>(
        &self,
        sheet: &Sheet<'_, DB>,
        [x, y]: [f64; 2],
        [w, h]: [f64; 2],
        text: f64,
    ) -> Drawn<DB> {
        let steps = 96;
        for i in 0..steps {
            let t = f64::from(i) / f64::from(steps);
            // Rectangles overlap to the right end to avoid visible seams.
            let colour = shade(self.scale, (f64::from(i) + 0.5) / f64::from(steps));
            sheet.rectangle([x + t * w, y], [(1.0 - t) * w, h], colour)?;
        }
        sheet.text(self.title, [x, y - 0.85 * text], text, Anchor::Left, INK)?;
        for (share, label) in &self.marks {
            let at = x + share * w;
            sheet.line(&[[at, y + h], [at, y + h + 0.3 * text]], (0.08 * text).max(1.0), INK)?;
            sheet.text(label, [at, y + h + 0.95 * text], text, Anchor::Middle, INK)?;
        }
        Ok(())
    }
}
