//! The small eddies of a flow ([`crate::eddy_viscosity`]).

use crate::eddy_viscosity::{EddyViscosity, SubgridModel};
use crate::flow::Flow;
use crate::friction::Friction;
use crate::projection::cells_of;

impl Flow {
    /// Sets the model of the eddies that cells do not resolve; `None`: laminar flow, which costs nothing.
    pub fn set_subgrid_model(&mut self, model: Option<SubgridModel>) {
        self.eddies = model.map(|model| EddyViscosity::new(&self.grid, model));
        if let Some(device) = &mut self.device {
            device.set_eddies(&self.grid, self.eddies.as_ref());
        }
    }

    /// The model of [`Self::set_subgrid_model`].
    pub fn subgrid_model(&self) -> Option<SubgridModel> {
        self.eddies.as_ref().map(EddyViscosity::model)
    }

    /// Largest $`4 \nu_t \sum_d h_d^{-2}`$ of the velocity as it is, 1/s: what the eddy viscosity adds to the rate that limits the step, as
    /// $`12 \nu / h^2`$ of the molecular one. Zero without a model. `friction`: of the surface as it is. On several ranks collective.
    pub fn largest_eddy_rate(&mut self, friction: Option<&Friction>) -> f64 {
        if let Some(device) = &self.device {
            return device.largest_eddy_rate(friction);
        }
        let Self { grid, velocity, slabs, eddies, .. } = self;
        let Some(eddies) = eddies else { return 0.0 };
        eddies.update(grid, velocity, slabs, friction);
        let mut largest = [eddies.largest_rate(grid, slabs.own())];
        slabs.ranks().largest(&mut largest);
        largest[0]
    }

    /// Kinematic eddy viscosity of the cells at the last prediction, m2/s, x fastest; none without a model. On several ranks of the own cells.
    pub fn eddy_viscosities(&self) -> Vec<f64> {
        let Some(eddies) = &self.eddies else { return Vec::new() };
        let [x, y, _] = self.grid.all_cells();
        let cells = [x, y, self.slabs.own()];
        cells_of(&cells).map(|cell| eddies.values[self.grid.at(cell.map(|i| i as isize))]).collect()
    }
}
