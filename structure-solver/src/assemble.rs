//! From a scene to equations: the choices are made here, once.

use std::rc::Rc;

use case::Scene;
use comm::Comm;
use mesh::StructureMesh;

use crate::dynamics::{Dynamics, DynamicsParams};
use crate::elements::cable::{TensionOnly, TwoWay};
use crate::elements::mass::MassMatrix;
use crate::loops::{Cables, ElementLoop, Membranes};
use crate::materials::{StVenantKirchhoff, TensionField};
use crate::model::{Model, ModelError};
use crate::newton::NewtonParams;
use crate::scheme::Scheme;
use crate::system::System;

/// The element loops that the scene's effects call for.
fn loops(scene: &Scene, model: &Model) -> Result<Vec<Box<dyn ElementLoop>>, ModelError> {
    let f = &scene.fabric;
    let (y, nu, h, rho) = (f.youngs_modulus_pa, f.poisson_ratio, f.thickness_m, f.density_kg_m3);
    let mut all: Vec<Box<dyn ElementLoop>> = Vec::new();
    all.push(if f.wrinkling {
        Box::new(Membranes::new(model, TensionField::new(y, nu), h, rho))
    } else {
        Box::new(Membranes::new(model, StVenantKirchhoff::isotropic(y, nu), h, rho))
    });
    match (&scene.lines, model.cables.first()) {
        (_, None) => {}
        (None, Some(c)) => return Err(ModelError::NoMaterial { cable: c.global as usize }),
        (Some(l), Some(_)) => {
            let youngs_modulus = l.youngs_modulus_pa;
            all.push(if l.tension_only {
                Box::new(Cables::new(model, TensionOnly { youngs_modulus }, l.area_m2, l.density_kg_m3))
            } else {
                Box::new(Cables::new(model, TwoWay { youngs_modulus }, l.area_m2, l.density_kg_m3))
            });
        }
    }
    Ok(all)
}

/// The structure of a scene in stage `stage`, at rest. Collective.
pub fn dynamics(
    comm: &Comm,
    scene: &Scene,
    stage: usize,
    mesh: &Rc<StructureMesh>,
) -> Result<Dynamics, ModelError> {
    let owner = owners(comm, mesh)?;
    let model = Model::new(comm, mesh, &owner)?;
    let loops = loops(scene, &model)?;
    let s = &scene.structure;
    let system = System::new(model, loops, s.mass.into());
    let size = mesh.coords.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
    let params = DynamicsParams {
        scheme: s.spectral_radius.map_or_else(Scheme::newmark, Scheme::generalized_alpha),
        damping: scene.stages[stage].mass_damping_per_s,
        newton: NewtonParams {
            tolerance: s.newton_tolerance,
            // Positions carry about 16 digits; strains of soft fabric need fewer.
            smallest_correction: 1e-14 * size,
            max_steps: s.newton_max_steps,
        },
        linear_tolerance: s.gmres_tolerance,
        max_cuts: s.max_step_cuts,
    };
    Ok(Dynamics::new(system, params))
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
