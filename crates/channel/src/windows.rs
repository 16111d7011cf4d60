//! The order of windows, checked by a participant.

use crate::Window;

/// Windows that may come next.
#[derive(Debug, Default)]
pub(crate) struct WindowOrder {
    /// Window and iteration of the last `advance` since the last `accept`.
    open: Option<(u64, u64)>,
    /// The last window that was accepted.
    last: Option<u64>,
    /// Number of accepted windows.
    pub accepted: u64,
}

impl WindowOrder {
    /// The problem with computing `w` now, if any.
    pub fn advance(&mut self, w: &Window) -> Option<String> {
        let problem = match (self.open, self.last) {
            (Some((index, iteration)), _) if w.index != index || w.iteration <= iteration => Some(format!(
                "window {} iteration {} after window {index} iteration {iteration}, which was not accepted",
                w.index, w.iteration
            )),
            (None, Some(last)) if w.index != last + 1 => {
                Some(format!("window {} after window {last} was accepted", w.index))
            }
            _ if !(w.dt > 0.0 && w.dt.is_finite() && w.time.is_finite()) => {
                Some(format!("an invalid window: start {} s, length {} s", w.time, w.dt))
            }
            _ if w.frame_velocity.iter().chain(&w.frame_acceleration).any(|x| !x.is_finite()) => {
                Some(format!(
                    "invalid motion of the frame: velocity {:?} m/s, acceleration {:?} m/s2",
                    w.frame_velocity, w.frame_acceleration
                ))
            }
            _ => None,
        };
        self.open = Some((w.index, w.iteration));
        problem
    }

    /// The problem with accepting `w` now, if any.
    pub fn accept(&mut self, w: &Window) -> Option<String> {
        match self.open.take() {
            Some((index, _)) if index == w.index => {
                self.last = Some(index);
                self.accepted += 1;
                None
            }
            open => Some(format!("window {} is to be accepted, computed was {open:?}", w.index)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(index: u64, iteration: u64) -> Window {
        Window { index, iteration, dt: 0.1, ..Window::default() }
    }

    #[test]
    fn values_of_a_window_must_be_finite() {
        let bad: [fn(&mut Window); 4] = [
            |w| w.dt = f64::NAN,
            |w| w.time = f64::INFINITY,
            |w| w.frame_velocity[2] = f64::NAN,
            |w| w.frame_acceleration[0] = f64::NEG_INFINITY,
        ];
        for change in bad {
            let mut w = window(0, 0);
            change(&mut w);
            assert!(WindowOrder::default().advance(&w).is_some(), "{w:?}");
        }
        assert_eq!(WindowOrder::default().advance(&window(0, 0)), None);
    }

    #[test]
    fn windows_in_order_are_accepted() {
        let mut s = WindowOrder::default();
        // A resumed run starts at any window.
        assert_eq!(s.advance(&window(7, 0)), None);
        assert_eq!(s.advance(&window(7, 1)), None);
        assert_eq!(s.advance(&window(7, 4)), None);
        assert_eq!(s.accept(&window(7, 4)), None);
        assert_eq!(s.advance(&window(8, 0)), None);
        assert_eq!(s.accept(&window(8, 0)), None);
        assert_eq!(s.accepted, 2);
    }

    #[test]
    fn windows_out_of_order_are_rejected() {
        type Step = fn(&mut WindowOrder) -> Option<String>;
        let cases: [(Step, &str); 6] = [
            (|s| s.advance(&window(3, 2)), "window 3 iteration 2 after window 3 iteration 2"),
            (|s| s.advance(&window(3, 1)), "after window 3 iteration 2"),
            (|s| s.advance(&window(4, 0)), "which was not accepted"),
            (|s| s.accept(&window(4, 0)), "window 4 is to be accepted"),
            (|s| s.accept(&window(3, 2)).or_else(|| s.accept(&window(3, 2))), "computed was None"),
            (|s| s.accept(&window(3, 2)).or_else(|| s.advance(&window(5, 0))), "window 5 after window 3"),
        ];
        for (step, text) in cases {
            let mut s = WindowOrder::default();
            assert_eq!(s.advance(&window(3, 2)), None);
            let problem = step(&mut s).expect(text);
            assert!(problem.contains(text), "{problem}");
        }
        let mut s = WindowOrder::default();
        assert!(s.advance(&Window { dt: f64::NAN, ..window(0, 0) }).is_some());
        assert!(WindowOrder::default().advance(&Window::default()).is_some(), "an empty window");
    }
}
