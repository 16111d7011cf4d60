//! A flow whose arrays are on a device.

use std::rc::Rc;

use nalgebra::Vector3;

use super::steps::Extrapolation;
use super::{Device, DeviceError, DeviceFlow, NoDevice};
use crate::constraints::{FluxConstraints, JumpsOfRows};
use crate::flow::{Flow, PressureJumps};
use crate::free_edges::EdgeFluxes;
use crate::friction::Friction;

impl Flow {
    /// Computes the steps of this flow on `device` from now on; `None`: on this processor. The arrays of the host are those of the last [`Flow::gather`].
    ///
    /// # Errors
    /// Several ranks, too little memory on the device.
    pub fn set_device(&mut self, device: Option<Rc<dyn Device>>) -> Result<(), NoDevice> {
        self.gather();
        self.device = None;
        let Some(device) = device else { return Ok(()) };
        if !self.slabs.alone() {
            return Err(NoDevice::Ranks(self.slabs.ranks().size()));
        }
        let mut device = Box::new(DeviceFlow::new(device, &self.grid, &self.poisson)?);
        device.set_eddies(&self.grid, self.eddies.as_ref());
        self.device = Some(device);
        self.release_arrays();
        self.upload();
        self.device_failure().map_or(Ok(()), |error| Err(error.into()))
    }

    /// The device of [`Self::set_device`].
    pub fn device(&self) -> Option<Rc<dyn Device>> {
        self.device.as_ref().map(|device| device.device().clone())
    }

    /// The first failure of the device; what the flow gave since has no meaning.
    pub fn device_failure(&self) -> Option<DeviceError> {
        self.device.as_ref().and_then(|device| device.failure())
    }

    /// Brings the arrays of the host to the device.
    pub(crate) fn upload(&mut self) {
        if let Some(device) = &mut self.device {
            device.upload(&self.velocity, &self.before);
        }
    }

    /// Brings velocity, rates and pressure of the device to the host.
    pub(crate) fn download(&mut self) {
        if let Some(device) = &self.device {
            device.download(&mut self.velocity, &mut self.before, &mut self.pressure);
            if let Some(eddies) = &mut self.eddies {
                device.download_eddies(&mut eddies.values);
            }
        }
    }

    fn extrapolation(&self) -> Extrapolation {
        Extrapolation { dt: self.dt, back: self.share_before() }
    }

    /// Brings the far field of the step to the device, and what it changes.
    fn set_far_on(&mut self, device: &DeviceFlow, frame: Option<Vector3<f64>>) {
        let (queue, tables) = device.tables();
        tables.set_far(queue, &self.far_field);
        if let Some(air) = &mut self.undisturbed {
            let changes = air.changes(&self.far_field);
            let rates = frame.map(|frame| air.layer_rates(&self.settings.momentum, frame));
            tables.set_undisturbed(queue, &changes, rates.as_ref());
        }
    }

    /// [`Flow::predict_around`] on a device.
    pub(crate) fn predict_on(
        &mut self,
        device: &mut DeviceFlow,
        (dt, frame): (f64, Vector3<f64>),
        edges: &EdgeFluxes,
        friction: Option<&mut Friction>,
    ) {
        self.dt = dt;
        self.set_far_on(device, Some(frame));
        let momentum = self.settings.momentum;
        device.find_rates((&momentum, frame), &self.grid, edges, friction.as_deref());
        device.extrapolate(self.extrapolation());
        self.at_walls.clear();
        if let Some(friction) = friction {
            let numbers = [self.settings.density, momentum.viscosity, dt];
            device.apply_friction(friction, numbers, &self.wall_rates);
            self.at_walls.extend(friction.values());
        }
        device.close_prediction();
        device.solve_pressure();
        self.has_predicted_pressure = true;
    }

    /// Ends the step on a device; `keep`: one may return to it.
    pub(crate) fn end_on(
        &mut self,
        device: &mut DeviceFlow,
        (rows, jumps): (&FluxConstraints, &PressureJumps),
        earlier: Option<JumpsOfRows<'_>>,
        keep: bool,
    ) {
        let rates = device.end_step(
            &self.grid,
            [Some((rows, &jumps.jump[..])), earlier],
            (self.factor(), self.dt),
            keep.then_some(self.previous_dt),
        );
        if keep {
            self.kept_wall_rates.clone_from(&self.wall_rates);
        }
        self.keep_wall_rates(rates);
        self.has_predicted_pressure = false;
        self.previous_dt = Some(self.dt);
    }

    /// [`Flow::return_to_start`] on a device.
    pub(crate) fn return_to_start_on(&mut self, device: &mut DeviceFlow) {
        if let Some(previous_dt) = device.kept_before() {
            self.previous_dt = previous_dt;
            self.wall_rates = std::mem::take(&mut self.kept_wall_rates);
            device.return_to_start();
        }
    }
}
