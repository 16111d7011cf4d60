//! Windows that adapt to what the coupling stands.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What happens to a window that has no answer: it does not converge, or a program cannot compute it.
///
/// All programs start again from their last accepted state with half the window; after some windows
/// that go well, windows are doubled again, never beyond `window_s`. Costs nothing where every
/// window has an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AdaptiveWindow {
    /// Whether windows adapt; otherwise such a window ends the run.
    pub enabled: bool,
    /// Halvings of `window_s` at most, 0 to 20.
    #[schemars(range(max = 20))]
    pub halvings: u32,
    /// Windows that must go well before the next one is twice as long.
    #[schemars(range(min = 1))]
    pub grow_after: u32,
}

impl Default for AdaptiveWindow {
    fn default() -> Self {
        Self { enabled: true, halvings: 5, grow_after: 4 }
    }
}
