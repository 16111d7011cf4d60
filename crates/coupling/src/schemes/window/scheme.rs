//! The interface of a coupling scheme.

use case::Coupling;

use super::solvers::Solvers;
use super::state::WindowState;
use super::values::InterfaceState;
use crate::error::RunError;
use crate::schemes::acceleration::accelerator::Accelerator;
use crate::schemes::surrogate::added_mass_surrogate::AddedMassSurrogate;
use crate::schemes::unknowns::Unknowns;

/// A coupling scheme as a map from the coupled unknowns to the response of the solvers.
///
/// One loop ([`super::window_loop::WindowLoop`]) serves all schemes: it predicts, sweeps, and either accepts the
/// first response or iterates until iterate and response agree.
pub trait CouplingScheme {
    /// Whether sweeps are repeated until iterate and response agree.
    fn iterates(&self) -> bool;

    /// First iterate of the window into [`WindowState::x`], which holds the unknowns at its start.
    ///
    /// # Errors
    /// Errors of the solvers, where they are called.
    fn predict(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError>;

    /// Calls the solvers at the iterate [`WindowState::x`]: fills [`WindowState::end`] and the response
    /// [`WindowState::x_tilde`].
    ///
    /// # Errors
    /// Errors of the solvers, and a response that is not finite.
    fn sweep(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<(), RunError>;

    /// The next iterate into [`WindowState::next`] by the scheme's own method, after a sweep at [`WindowState::x`];
    /// `false` where the acceleration provides it.
    ///
    /// # Errors
    /// Errors of the solvers, where they are called.
    fn improve(&mut self, state: &mut WindowState, solvers: &mut Solvers<'_>) -> Result<bool, RunError> {
        let _ = (state, solvers);
        Ok(false)
    }

    /// Resets data for windows of the last length; where the last window was `rejected`, also the columns added in
    /// it.
    fn reset(&mut self, rejected: bool) {
        let _ = rejected;
    }

    /// The window is accepted with the last sweep's iterate [`WindowState::x`], response [`WindowState::x_tilde`]
    /// and values [`WindowState::end`].
    fn accept(&mut self, state: &WindowState);

    /// State that later windows depend on.
    fn save_state(&self) -> Vec<u8>;

    /// Restores a [`CouplingScheme::save_state`] of the same scheme.
    ///
    /// # Errors
    /// A state of another one.
    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError>;
}

/// Settings for the construction of a scheme.
#[derive(Clone, Copy)]
pub struct SchemeSettings<'a> {
    /// Settings of the scene.
    pub coupling: &'a Coupling,
    /// Layout of the unknowns.
    pub unknowns: Unknowns,
    /// Values on the interface at the start of the stage.
    pub interface: &'a InterfaceState,
}

impl SchemeSettings<'_> {
    /// The coupled unknowns at the start of the stage.
    pub fn start(&self) -> Vec<f64> {
        self.interface.unknowns(&self.unknowns)
    }

    /// Order of the extrapolation in a staggered scheme.
    pub fn predictor(&self) -> usize {
        self.coupling.staggered.predictor as usize
    }
}

/// The surrogate of the flow with the acceleration of its inner iteration.
pub struct Surrogate {
    /// The surrogate.
    pub model: AddedMassSurrogate,
    /// Acceleration of the structure's iterations against the surrogate.
    pub accelerator: Box<dyn Accelerator>,
}

/// A scheme that a scene can select.
pub trait FromScene: CouplingScheme + Sized + 'static {
    /// The scheme at the start of a stage.
    fn from_scene(settings: SchemeSettings<'_>) -> Self;

    /// The scheme in a few words, for the log.
    fn describe(coupling: &Coupling) -> String;
}

/// A scheme that a scene can select and that needs a surrogate of the flow.
pub trait FromSurrogate: CouplingScheme + Sized + 'static {
    /// Replaces the scheme where the surrogate cannot be constructed.
    type Fallback: FromScene;

    /// The scheme at the start of a stage.
    fn from_surrogate(settings: SchemeSettings<'_>, surrogate: Surrogate) -> Self;

    /// The scheme in a few words, for the log.
    fn describe(coupling: &Coupling) -> String;
}
