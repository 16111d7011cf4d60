//! The window loop of a coupled stage, assembled from a scene.

use case::{Acceleration, Coupling, CouplingOrder, LoadShape, Scene, Scheme};
use channel::LOAD_WIDTH;

use crate::descent::DescentModel;
use crate::floors::{SHAPE_FLOOR, load_floor, load_scale, speed_floor};
use crate::frame_axes::FrameAxes;
use crate::geometry::Vec3;
use crate::interface::CanopyInterface;
use crate::schemes::{
    AddedMassRelaxation, AddedMassSurrogate, Air, Criterion, Field, InterfaceState, JacobiRelaxation,
    MEAN_WEIGHTS, MassProperties, Relaxation, SURROGATE_DENSITY_FACTOR, Surrogate, Uniform, Unknowns,
    VortexLattice, WindowLoop, WindowLoopSetup, accelerator, needs_surrogate, window_loop,
};

/// A coupled stage of a scene.
#[derive(Clone, Copy)]
pub struct CoupledStage<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Number of the stage.
    pub stage: usize,
    /// The canopy.
    pub interface: &'a CanopyInterface,
    /// The descent equation.
    pub descent: Option<DescentModel>,
    /// The undisturbed air without gusts, m/s.
    pub wind_m_s: [f64; 3],
    /// Accepts windows that do not converge as long as they are finite.
    pub accept_unconverged: bool,
}

impl CoupledStage<'_> {
    /// The window loop from `state`, and lines for the log.
    pub fn window_loop(&self, state: InterfaceState) -> (WindowLoop, Vec<String>) {
        let (interface, mut lines) = (self.interface, Vec::new());
        let coupling =
            &Coupling { load_interpolation: Some(self.scene.load_shape()), ..self.scene.coupling.clone() };
        let axes = self.descent.map_or(FrameAxes::None, |d| d.axes);
        let motion = Unknowns::new(interface.nodes(), self.window_s(), axes);
        let mut fields = self.fields(&state, motion);
        let unknowns = self.with_loads(motion, &mut fields);
        let criterion = Criterion::new(fields, coupling.tolerance);
        let lattice = self.lattice(&state);
        let added = lattice.as_ref().and_then(|lattice| self.added_mass(motion, lattice, &mut lines));
        let surrogate = self.surrogate(motion, &state, lattice.as_ref(), added.clone(), &mut lines);
        let windows = window_loop(WindowLoopSetup {
            stage: self.name(),
            coupling,
            unknowns,
            criterion,
            faces: interface.faces.len(),
            descent: self.descent,
            interface: state,
            relaxation: self.relaxation(unknowns, added),
            surrogate,
            accept_unconverged: self.accept_unconverged,
        });
        (windows, lines)
    }

    fn name(&self) -> &str {
        &self.scene.stages[self.stage].name
    }

    fn window_s(&self) -> f64 {
        self.scene.stages[self.stage].window_s
    }

    /// Fields of the criterion: the shape, and the descent speed where there is one.
    fn fields(&self, state: &InterfaceState, motion: Unknowns) -> Vec<Field> {
        let (scene, interface, dt) = (self.scene, self.interface, self.window_s());
        let speed = (Vec3::from(self.wind_m_s) - Vec3::from(state.velocity)).norm();
        let moved = motion.displacements();
        let root = (interface.nodes() as f64).sqrt();
        let pressure = load_scale(scene, self.stage, interface, state, speed);
        let load = load_floor(scene, interface, state, [pressure, dt, response(scene)]);
        let mut fields = vec![Field { load, ..Field::new(0..moved, SHAPE_FLOOR * speed * dt * root) }];
        if self.descent.is_some() {
            let floor = speed_floor(scene, interface, pressure, dt) * motion.velocity_scale();
            fields.push(Field::new(motion.velocities(), floor));
        }
        fields
    }

    /// The canopy's positions in `state`, m.
    fn positions(&self, state: &InterfaceState) -> Vec<mesh::Point> {
        let shifted = self.interface.coords.iter().zip(state.displacement.chunks_exact(3));
        shifted.map(|(x, d)| std::array::from_fn(|i| x[i] + d[i])).collect()
    }

    fn is_immersed(&self) -> bool {
        self.scene.flow.as_ref().is_some_and(case::Flow::is_immersed)
    }

    /// The air that the canopy accelerates. The lattice is that of a sheet with air on both sides, each of which has half of the
    /// added mass: with air on one side only the density is halved.
    fn air(&self) -> Air {
        let flow = self.scene.flow.as_ref();
        let air = match flow {
            Some(f) if f.is_immersed() => Air::incompressible(f.density_kg_m3),
            Some(f) => Air { density: f.density_kg_m3, sound: f.sound_speed() },
            None => Air::incompressible(0.0),
        };
        let sides = if self.scene.is_one_sided() { 0.5 } else { 1.0 };
        Air { density: sides * air.density, ..air }
    }

    /// Vortex lattice of the canopy in `state`; `None` where its faces cannot be merged into few enough groups.
    fn lattice(&self, state: &InterfaceState) -> Option<VortexLattice> {
        let coupling = &self.scene.coupling;
        // Without a surrogate, relaxation converges faster with the larger, incompressible added mass: 7.5 instead of
        // 7.8 iterations of IQN-ILS a window on the ATPS descent.
        let screening = if needs_surrogate(coupling) { self.air().screening(self.window_s()) } else { 0.0 };
        let most = coupling.added_mass_max_panels as usize;
        let gain = Some(self.mass_properties().gain()).filter(|gain| gain.is_finite());
        VortexLattice::with_relaxation(&self.positions(state), &self.interface.faces, most, screening, gain)
    }

    /// The added-mass surrogate of the flow, for schemes that need one.
    fn surrogate(
        &self,
        unknowns: Unknowns,
        state: &InterfaceState,
        lattice: Option<&VortexLattice>,
        added: Option<AddedMassRelaxation>,
        lines: &mut Vec<String>,
    ) -> Option<Surrogate> {
        let coupling = &self.scene.coupling;
        if !needs_surrogate(coupling) {
            return None;
        }
        let mut air = self.air();
        if coupling.scheme == Scheme::Staggered {
            air.density *= SURROGATE_DENSITY_FACTOR;
        }
        let faces = &self.interface.faces;
        let most = coupling.added_mass_max_panels as usize;
        let model = lattice.and_then(|lattice| {
            let model = AddedMassSurrogate::new(
                unknowns,
                lattice,
                &state.displacement,
                state.velocity,
                faces,
                air,
                most,
            );
            if self.is_immersed() { model.map(AddedMassSurrogate::with_first_order_steps) } else { model }
        });
        let name = self.name();
        if model.is_none() {
            lines.push(format!(
                    "stage `{name}`: {} interface faces cannot be merged into {most} panel groups, so there is no added-mass \
                     surrogate and the acceleration is iqn-ils; raise coupling.added_mass_max_panels to avoid this",
                faces.len()
            ));
        } else if faces.len() > most {
            lines.push(format!(
                    "stage `{name}`: the added-mass surrogate merges {} interface faces into at most {most} panel groups",
                faces.len()
            ));
        }
        // Each window has several inner solves: columns of few windows suffice.
        let iqn = Coupling { acceleration: Acceleration::IqnIls, reused_windows: 4, ..coupling.clone() };
        let rest = self.relaxation(unknowns, added);
        model.map(|model| Surrogate { model, accelerator: accelerator(&iqn, unknowns.len(), rest) })
    }

    /// In Jacobi order the load is one of the coupled unknowns, scaled to the displacement of the fabric that it
    /// causes within a window.
    fn with_loads(&self, unknowns: Unknowns, fields: &mut Vec<Field>) -> Unknowns {
        let coupling = &self.scene.coupling;
        if coupling.scheme != Scheme::Implicit || coupling.order != CouplingOrder::Jacobi {
            return unknowns;
        }
        let (nodes, faces) = (self.interface.nodes() as f64, self.interface.faces.len());
        let fabric = &self.scene.fabric;
        let dt = self.window_s();
        let moved = response(self.scene) * dt * dt / (fabric.thickness_m * fabric.density_kg_m3);
        let before = unknowns.len();
        let unknowns = unknowns.with_loads(faces * LOAD_WIDTH, moved * (nodes / faces as f64).sqrt());
        fields.push(Field { range: before..unknowns.len(), ..fields[0].clone() });
        unknowns
    }

    /// Masses of fabric, air and falling system.
    fn mass_properties(&self) -> MassProperties {
        let (fabric, interface) = (&self.scene.fabric, self.interface);
        // Tapes move with the fabric.
        let tapes = interface.masses.all_tapes();
        let cloth = if self.scene.fabric_groups().is_empty() {
            fabric.thickness_m * fabric.density_kg_m3
        } else {
            interface.masses.fabric / interface.sizes.fabric_area
        };
        let smeared = if tapes > 0.0 { tapes / interface.sizes.fabric_area } else { 0.0 };
        MassProperties {
            fabric_kg_m2: cloth + smeared,
            air: self.air(),
            response: response(self.scene),
            difference: if self.is_immersed() { 1.0 } else { 1.5 },
            falling_kg: self.descent.map_or(0.0, |d| d.mass_kg),
        }
    }

    /// Relaxation by the canopy's added mass.
    fn added_mass(
        &self,
        motion: Unknowns,
        lattice: &VortexLattice,
        lines: &mut Vec<String>,
    ) -> Option<AddedMassRelaxation> {
        let interface = self.interface;
        let model = AddedMassRelaxation::new(motion, &interface.faces, &self.mass_properties(), lattice)?;
        lines.push(format!(
            "stage `{}`: {:.2} kg of fabric, added mass of the air in vertical motion {:.0} kg{}",
            self.name(),
            interface.masses.fabric,
            model.vertical_added_mass,
            if lattice.screening > 0.0 { " (as far as sound travels in a window)" } else { "" },
        ));
        Some(model)
    }

    /// Relaxation of the part of a residual that no column spans: by the added mass, or by one factor where that is
    /// not available.
    fn relaxation(&self, unknowns: Unknowns, added: Option<AddedMassRelaxation>) -> Box<dyn Relaxation> {
        match added {
            Some(model) if unknowns.loads() > 0 => {
                Box::new(JacobiRelaxation::new(model, unknowns, &self.mass_properties(), self.window_s()))
            }
            Some(model) => Box::new(model),
            None => Box::new(Uniform(self.scene.coupling.relaxation)),
        }
    }
}

/// Displacement at the end of a window, in dt^2/m, per pressure at its end.
fn response(scene: &Scene) -> f64 {
    0.5 * if scene.load_shape() == LoadShape::Mean { MEAN_WEIGHTS[0] } else { 1.0 }
}
