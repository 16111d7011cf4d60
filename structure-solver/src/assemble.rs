//! From a scene to equations: the choices are made here, once.

use std::rc::Rc;

use case::{Fabric, Integration, Law, Membrane, Scene, Solve, Stage};
use comm::Comm;
use mesh::{CableKind, MeshError, StructureMesh};

use crate::dynamics::{Dynamics, DynamicsParams};
use crate::elements::air::Cylinder;
use crate::elements::cable::{self, CableLaw, TensionOnly, TwoWay};
use crate::elements::hysteresis::Hysteresis;
use crate::elements::mass::MassMatrix;
use crate::elements::reefing::Schedule;
use crate::loops::{Contact, ContactLaw, ElementLoop, Elements};
use crate::materials::slider::{self, Friction};
use crate::materials::{
    Elastic, Hysteretic, KelvinVoigt, Material, NeoHookean, NeoHookeanTensionField, OrthotropicTensionField,
    Prestressed, StVenantKirchhoff, StepLaw, TensionField, Viscous,
};
use crate::model::{CableElement, Model, ModelError, Surface, Warp};
use crate::newton::NewtonParams;
use crate::scheme::Scheme;
use crate::system::System;

fn surface(scene: &Scene) -> Surface {
    Surface {
        quadrilaterals: scene.structure.membrane == Membrane::Quadrilateral,
        warp: scene.fabric.orthotropic.as_ref().map(|o| o.direction.map_or(Warp::FirstEdge, Warp::Vector)),
        bending: scene.fabric.bending_stiffness_n_m.is_some(),
    }
}

/// Retardation time of a material in a stage, s; a static shape has no rates.
fn damping(stage: &Stage, of_material: f64) -> f64 {
    stage.stiffness_damping_s + if stage.solve == Solve::Static { 0.0 } else { of_material }
}

/// Limit over elastic stress of the sliders of a material that takes the share `loss` of the work of stretching; a static shape has none.
fn friction(stage: &Stage, loss: Option<f64>) -> f64 {
    slider::friction(loss.filter(|_| stage.solve != Solve::Static).unwrap_or(0.0))
}

type Loops = Vec<Box<dyn ElementLoop>>;

/// The element loops that the scene's effects call for in a stage. Retardation times of stage and material add up.
fn loops(scene: &Scene, stage: usize, model: &Model) -> Result<Loops, ModelError> {
    let damping = damping(&scene.stages[stage], scene.fabric.retardation_time_s);
    let mut all = Loops::new();
    for group in cloths(scene) {
        let fabric = scene.fabric_of(group);
        let quads = scene.structure.membrane == Membrane::Quadrilateral;
        let friction = friction(&scene.stages[stage], fabric.hysteresis);
        let explicit = scene.structure.integration == Integration::Explicit;
        membranes(&Cloth { fabric: &fabric, group, quads, damping, friction, explicit }, model, &mut all);
    }
    if let Some(stiffness) = scene.fabric.bending_stiffness_n_m {
        all.push(Box::new(Elements::bending(model, stiffness)));
    }
    if let Some(c) = model.cables.iter().find(|c| mesh::section(c.kind, c.group, scene).is_none()) {
        return Err(ModelError::NoMaterial { cable: c.global as usize });
    }
    cables(scene, stage, model, &mut all);
    Ok(all)
}

/// The cloths of a scene: `[fabric]`, then the groups of a mesh file.
fn cloths(scene: &Scene) -> impl Iterator<Item = Option<u16>> {
    std::iter::once(None).chain((0..scene.fabric_groups().len()).map(|k| Some(k as u16)))
}

/// A cloth and the elements that are of it.
struct Cloth<'a> {
    fabric: &'a Fabric,
    /// Its group; `None`: `[fabric]`.
    group: Option<u16>,
    /// Faces are bilinear elements.
    quads: bool,
    /// Retardation time, s.
    damping: f64,
    /// Limit of the sliders over the elastic stress; 0: no hysteresis.
    friction: f64,
    /// Steps are central differences.
    explicit: bool,
}

/// The fabric's material: one line for each law. Loaded for the first time, elastic law and slider have the moduli of the fabric.
fn membranes(cloth: &Cloth<'_>, model: &Model, all: &mut Loops) {
    let f = cloth.fabric;
    let elastic = 1.0 / (1.0 + cloth.friction);
    let (y, nu) = (elastic * f.youngs_modulus_pa, f.poisson_ratio);
    match (f.law, &f.orthotropic, f.wrinkling) {
        (Law::NeoHookean, _, true) => cloth.elements(model, NeoHookeanTensionField::new(y), all),
        (Law::NeoHookean, _, false) => cloth.elements(model, NeoHookean::new(y), all),
        (Law::StVenantKirchhoff, None, true) => cloth.prestressed(model, TensionField::new(y, nu), all),
        (Law::StVenantKirchhoff, None, false) => {
            cloth.prestressed(model, StVenantKirchhoff::isotropic(y, nu), all);
        }
        (Law::StVenantKirchhoff, Some(o), true) => {
            let law = OrthotropicTensionField::new(
                y,
                elastic * o.youngs_modulus_2_pa,
                nu,
                elastic * o.shear_modulus_pa,
            );
            cloth.prestressed(model, law, all);
        }
        (Law::StVenantKirchhoff, Some(o), false) => {
            let law = StVenantKirchhoff::orthotropic(
                y,
                elastic * o.youngs_modulus_2_pa,
                nu,
                elastic * o.shear_modulus_pa,
            );
            cloth.prestressed(model, law, all);
        }
    }
}

impl Cloth<'_> {
    /// A law that is linear where it is taut, about the fabric's prestress.
    fn prestressed(&self, model: &Model, law: impl Material + Copy, all: &mut Loops) {
        let prestress = self.fabric.prestress_pa / (1.0 + self.friction);
        self.elements(model, Prestressed::new(law, prestress), all);
    }

    /// Elements of a law. Each kind of element is made for few laws over it: every combination that is written here is compiled.
    fn elements(&self, model: &Model, law: impl Material + Copy, all: &mut Loops) {
        let hysteretic = || {
            let hysteretic = Hysteretic::new(law, self.friction);
            if self.explicit { hysteretic.explicit() } else { hysteretic }
        };
        let (friction, damping) = (self.friction > 0.0, self.damping > 0.0);
        match (self.quads, friction) {
            (true, true) => {
                self.quads(model, hysteretic(), all);
                if damping {
                    let law: Box<dyn Material> = Box::new(law);
                    self.quads(model, Viscous::new(law, self.damping), all);
                }
            }
            // One element has law and damping where that costs less.
            (true, false) if damping => self.quads(model, KelvinVoigt::new(law, self.damping), all),
            (true, false) => self.quads(model, Elastic(law), all),
            (false, friction) => {
                if friction {
                    self.triangles(model, hysteretic(), all);
                } else {
                    self.triangles(model, Elastic(law), all);
                }
                self.bent_faces(model, all);
                if damping {
                    self.triangles(model, Viscous::new(law, self.damping), all);
                }
            }
        }
    }

    fn is_own(&self, group: Option<u16>) -> bool {
        group == self.group
    }

    fn quads(&self, model: &Model, law: impl StepLaw, all: &mut Loops) {
        let (thickness, density) = (self.fabric.thickness_m, self.fabric.density_kg_m3);
        all.push(Box::new(Elements::quads_of(model, |g| self.is_own(g), law, thickness, density)));
    }

    fn triangles(&self, model: &Model, law: impl StepLaw, all: &mut Loops) {
        let (thickness, density) = (self.fabric.thickness_m, self.fabric.density_kg_m3);
        all.push(Box::new(Elements::triangles_of(model, |g| self.is_own(g), law, thickness, density)));
    }

    fn bent_faces(&self, model: &Model, all: &mut Loops) {
        let (thickness, density) = (self.fabric.thickness_m, self.fabric.density_kg_m3);
        if model.split_faces.iter().any(|f| self.is_own(f.fabric)) {
            all.push(Box::new(Elements::bent_faces_of(model, |g| self.is_own(g), thickness, density)));
        }
    }
}

/// Elements of lines, risers and tapes: one loop for each section. A static shape has no hysteresis.
fn cables(scene: &Scene, stage: usize, model: &Model, all: &mut Loops) {
    let (stage, explicit) = (&scene.stages[stage], scene.structure.integration == Integration::Explicit);
    let friction = |loss| friction(stage, loss);
    let own_risers = scene.risers.is_some();
    if let Some(l) = &scene.lines {
        let section = CableSection {
            tension_only: l.tension_only,
            youngs_modulus: l.youngs_modulus_pa,
            offset: l.prestress_pa / l.youngs_modulus_pa,
            area: l.area_m2,
            density: l.density_kg_m3,
            friction: friction(l.hysteresis),
            explicit,
        };
        let of_lines = |kind| match kind {
            CableKind::SuspensionLine | CableKind::Reinforcement => true,
            CableKind::Riser => !own_risers,
            CableKind::Tape(_) => false,
        };
        let chosen = |c: &CableElement| c.group.is_none() && of_lines(c.kind);
        section.push(damping(stage, l.retardation_time_s), model, chosen, all);
        if let Some(r) = scene.risers {
            let section = CableSection {
                friction: friction(r.hysteresis),
                explicit,
                ..CableSection::of(l.tension_only, r.axial_stiffness_n, r.mass_kg_m)
            };
            let damping = damping(stage, r.retardation_time_s);
            let chosen = |c: &CableElement| c.group.is_none() && c.kind == CableKind::Riser;
            section.push(damping, model, chosen, all);
        }
    }
    for (k, g) in scene.cable_groups().iter().enumerate() {
        let section = CableSection {
            offset: g.pretension_n / g.axial_stiffness_n,
            ..CableSection::of(g.tension_only, g.axial_stiffness_n, g.mass_kg_m)
        };
        let chosen = |c: &CableElement| c.group == Some(k as u16);
        section.push(damping(stage, g.retardation_time_s), model, chosen, all);
    }
    let Some(tapes) = &scene.tapes else { return };
    for (place, tape) in tapes.places() {
        let section = CableSection::of(tapes.tension_only, tape.axial_stiffness_n, tape.mass_kg_m);
        let damping = damping(stage, tape.retardation_time_s);
        section.push(damping, model, |c| c.kind == CableKind::Tape(place), all);
    }
}

/// Section of cable elements.
struct CableSection {
    tension_only: bool,
    /// Pa.
    youngs_modulus: f64,
    /// Green strain of the pre-stress.
    offset: f64,
    /// m2.
    area: f64,
    /// kg/m3.
    density: f64,
    /// Limit of the slider over the elastic stress; 0: no hysteresis.
    friction: f64,
    /// Steps are central differences.
    explicit: bool,
}

impl CableSection {
    /// Of an axial stiffness (N) and a mass for each metre (kg/m), as a cross-section of 1 m2 that has them.
    fn of(tension_only: bool, axial_stiffness: f64, mass: f64) -> Self {
        Self {
            tension_only,
            youngs_modulus: axial_stiffness,
            offset: 0.0,
            area: 1.0,
            density: mass,
            friction: 0.0,
            explicit: false,
        }
    }

    /// Adds the elements of the `chosen` kinds.
    fn push(&self, damping: f64, model: &Model, chosen: impl Fn(&CableElement) -> bool, all: &mut Loops) {
        if !model.cables.iter().any(&chosen) {
            return;
        }
        // Loaded for the first time, elastic line and slider have the modulus of the line.
        let youngs_modulus = self.youngs_modulus / (1.0 + self.friction);
        if self.tension_only {
            self.push_law(damping, model, chosen, TensionOnly { youngs_modulus }, all);
        } else {
            self.push_law(damping, model, chosen, TwoWay { youngs_modulus }, all);
        }
    }

    fn push_law(
        &self,
        damping: f64,
        model: &Model,
        chosen: impl Fn(&CableElement) -> bool,
        law: impl CableLaw,
        all: &mut Loops,
    ) {
        if self.friction > 0.0 {
            let friction = Friction::new(self.friction, self.youngs_modulus / (1.0 + self.friction));
            let friction = if self.explicit { friction.explicit() } else { friction };
            let slider = Hysteresis::new(law, self.offset, friction);
            all.push(Box::new(Elements::sliders(model, &chosen, slider, self.area)));
        }
        let elastic = || cable::Elastic { law, offset: self.offset };
        all.push(Box::new(Elements::cables_of(model, &chosen, elastic(), self.area, self.density)));
        if damping > 0.0 {
            let viscous = cable::Viscous::new(elastic(), damping);
            all.push(Box::new(Elements::cables_of(model, &chosen, viscous, self.area, self.density)));
        }
    }
}

/// The structure of a scene in stage `stage`, at rest. Collective.
pub fn dynamics(
    comm: &Comm,
    scene: &Scene,
    stage: usize,
    mesh: &Rc<StructureMesh>,
) -> Result<Dynamics, ModelError> {
    let owner = owners(comm, mesh)?;
    let (ties, skirt) = reefed(scene, stage, mesh)?;
    let model = Model::with_ties(comm, mesh, &owner, surface(scene), &ties)?;
    let mut loops = loops(scene, stage, &model)?;
    air_and_reefing(scene, stage, &model, skirt, &mut loops);
    let s = &scene.structure;
    let mass = match s.integration {
        Integration::Explicit => MassMatrix::Lumped,
        _ => s.mass.into(),
    };
    if let Some(c) = &scene.fabric.contact {
        let f = &scene.fabric;
        let law = ContactLaw {
            thickness: c.distance_m,
            stiffness: c.stiffness * f.youngs_modulus_pa * f.thickness_m,
            friction: c.friction,
        };
        loops.push(Box::new(Contact::new(&model, mesh, law)));
    }
    let system = System::new(model, loops, mass);
    let size = mesh.coords.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
    let params = DynamicsParams {
        scheme: match s.integration {
            Integration::Newmark => Scheme::newmark(),
            _ => Scheme::generalized_alpha(s.spectral_radius()),
        },
        damping: scene.stages[stage].mass_damping_per_s,
        newton: NewtonParams {
            tolerance: s.newton_tolerance,
            // Positions carry about 16 digits; strains of soft fabric need fewer.
            smallest_correction: 1e-14 * size,
            max_steps: s.newton_max_steps,
        },
        // A static solution leaves turns of the whole free; solves that respect the
        // balance of moments do not turn it.
        linear_tolerance: match scene.stages[stage].solve {
            Solve::Static => s.gmres_tolerance.min(1e-6),
            Solve::Dynamic => s.gmres_tolerance,
        },
        max_cuts: s.max_step_cuts,
    };
    Ok(Dynamics::new(system, params))
}

/// Reefing lines that hold in a stage, or are cut in it.
fn holding(scene: &Scene, stage: usize) -> impl Iterator<Item = (&case::Reefing, bool)> {
    scene.reefing.iter().filter_map(move |r| {
        let cut = r.release_stage.as_ref().map(|name| scene.stages.iter().position(|s| &s.name == name));
        match cut.flatten() {
            Some(at) if at < stage => None,
            Some(at) => Some((r, at == stage)),
            None => Some((r, false)),
        }
    })
}

/// Pairs of neighbours on the skirt, and its unstressed length (m), where a line reefs it.
fn reefed(scene: &Scene, stage: usize, mesh: &StructureMesh) -> Result<(Vec<[u32; 2]>, f64), ModelError> {
    if holding(scene, stage).next().is_none() {
        return Ok((Vec::new(), 0.0));
    }
    let ring = mesh.skirt();
    if ring.len() < 3 {
        return Err(ModelError::NoSkirt { nodes: ring.len() });
    }
    let ties: Vec<[u32; 2]> = (0..ring.len()).map(|k| [ring[k], ring[(k + 1) % ring.len()]]).collect();
    let length = |[a, b]: &[u32; 2]| {
        (mesh::geometry::at(&mesh.coords, *a) - mesh::geometry::at(&mesh.coords, *b)).norm()
    };
    let skirt = ties.iter().map(length).sum();
    Ok((ties, skirt))
}

/// Drag of lines and reefing lines, where they are asked for.
fn air_and_reefing(scene: &Scene, stage: usize, model: &Model, skirt: f64, all: &mut Loops) {
    let (Some(l), density) = (&scene.lines, scene.resolved().air.density_kg_m3) else { return };
    if let Some(d) = &l.drag {
        let cylinder = Cylinder::new(density, l.diameter_m(), d.coefficient, d.friction_coefficient);
        all.push(Box::new(Elements::line_drag(model, cylinder)));
    }
    for (r, cut) in holding(scene, stage) {
        let schedule = Schedule {
            length: r.length_m,
            draw_in: if stage == 0 { r.draw_in_s } else { 0.0 },
            release: if cut { r.release_s } else { f64::INFINITY },
            ramp: r.release_ramp_s,
        };
        all.push(Box::new(Elements::reefing(model, l.youngs_modulus_pa, l.area_m2, schedule, skirt)));
    }
}

/// Nodes that the motions of a stage move, with their components.
fn moved(scene: &Scene, stage: usize, mesh: &StructureMesh) -> Result<Vec<(u32, [bool; 3])>, MeshError> {
    let mut all = Vec::new();
    for (k, m) in scene.stages[stage].motions.iter().enumerate() {
        let nodes = mesh.nodes_of(&format!("stage[{stage}].motion[{k}]"), m.nodes.as_deref(), m.at_m)?;
        let components = ['x', 'y', 'z'].map(|c| m.components.contains(c));
        all.extend(nodes.into_iter().map(|n| (n, components)));
    }
    Ok(all)
}

/// Refuses a structure with a part that nothing holds in stage `stage`.
pub fn check_held(scene: &Scene, stage: usize, mesh: &StructureMesh) -> Result<(), SetupError> {
    Ok(crate::connected::check(mesh, &moved(scene, stage, mesh)?)?)
}

/// A structure that cannot be set up.
#[derive(Debug, thiserror::Error)]
pub enum SetupError {
    /// Its mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// Its elements.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A motion by a text that is no formula.
    #[error("{key}: {error}")]
    Formula {
        /// Where the scene says so.
        key: String,
        /// What is wrong with the text.
        error: case::FormulaError,
    },
}

/// Prescribes the motions and forces of stage `stage` from the accepted state on; the stages before it took
/// `times`.
/// Collective.
pub fn nodal(
    dynamics: &mut Dynamics,
    scene: &Scene,
    stage: usize,
    times: &case::StageTimes,
    mesh: &StructureMesh,
) -> Result<(), SetupError> {
    let s = &scene.stages[stage];
    for (k, f) in s.forces.iter().enumerate() {
        let key = format!("stage[{stage}].force[{k}]");
        for node in mesh.nodes_of(&key, f.nodes.as_deref(), f.at_m)? {
            dynamics.system.add_force(node, f.force_n);
        }
    }
    for (k, m) in s.motions.iter().enumerate() {
        let key = format!("stage[{stage}].motion[{k}]");
        let nodes = mesh.nodes_of(&key, m.nodes.as_deref(), m.at_m)?;
        let components = ['x', 'y', 'z'].map(|c| m.components.contains(c));
        let motion = m
            .in_stage(scene, stage, times)
            .map_err(|error| SetupError::Formula { key: key.clone(), error })?;
        dynamics.prescribe_motion(&nodes, components, motion);
    }
    let first = scene.source_stage(stage, case::Role::Structure).is_none();
    let turned = scene.payload_body().filter(|b| b.is_released_turned());
    if let Some(body) = turned.filter(|_| first && s.kind != case::StageKind::Coupled) {
        let attachments = mesh.node_sets.get("payload").map_or(&[][..], Vec::as_slice);
        dynamics.turn_payload(body, attachments, 0.5 * s.duration_s);
    }
    Ok(())
}

impl From<case::Mass> for MassMatrix {
    fn from(mass: case::Mass) -> Self {
        match mass {
            case::Mass::Consistent => Self::Consistent,
            case::Mass::Lumped => Self::Lumped,
        }
    }
}

fn owners(comm: &Comm, mesh: &StructureMesh) -> Result<Vec<u32>, ModelError> {
    let nodes = mesh.coords.len();
    mesh::partition_structure(mesh, comm.size())
        .map_err(|_| ModelError::TooManyRanks { ranks: comm.size(), nodes })
}
