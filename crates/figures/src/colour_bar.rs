//! The colours of a scale with their values.

use crate::colour::{INK, Scale, shade};
use crate::sheet::{Anchor, Canvas, Drawn, Sheet};

/// A bar of colours, low to high from the left.
pub(crate) struct ColourBar<'a> {
    pub(crate) title: &'a str,
    pub(crate) scale: Scale,
    /// Labels at shares of its width.
    pub(crate) marks: Vec<(f64, String)>,
}

impl ColourBar<'_> {
    /// Draws it with the bar from `corner`, its title above, its marks below; lengths in pixels, `text` the em.
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
            // Overlapping to the right end, so that no seam shows.
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
