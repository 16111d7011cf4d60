//! The mover that a scene asks for.

use case::{MeshMotion, MoverKind};

use crate::elastic::{Elastic, Solid};
use crate::inverse_distance::InverseDistance;
use crate::laplacian::Laplacian;
use crate::mover::Mover;
use crate::radial_basis::RadialBasis;

/// The mover of the settings. All movers honour `tolerance` where they iterate.
pub fn mover(settings: &MeshMotion) -> Box<dyn Mover> {
    let solid = Solid::from(settings);
    match settings.mover {
        MoverKind::Elastic => Box::new(Elastic::new(solid)),
        MoverKind::PlainElastic => {
            Box::new(Elastic::new(Solid { chi: 0.0, shape_exponent: 0.0, depth_exponent: 0.0, ..solid }))
        }
        // A relative residual: a hundredth of a cell's share of the motion.
        MoverKind::Laplacian => Box::new(Laplacian::new(solid.chi, 1e-2 * solid.tolerance)),
        MoverKind::RadialBasis => Box::new(RadialBasis::default()),
        MoverKind::InverseDistance => Box::new(InverseDistance::default()),
    }
}
