//! Selection of the mover of a scene.

use case::{MeshMotion, MoverKind};

use crate::elastic::{Elastic, Solid};
use crate::inverse_distance::InverseDistance;
use crate::laplacian::Laplacian;
use crate::mover::Mover;
use crate::radial_basis::RadialBasis;

/// The mover for these settings. Iterative movers use `tolerance`.
pub fn mover(settings: &MeshMotion) -> Box<dyn Mover> {
    let solid = Solid::from(settings);
    match settings.mover {
        MoverKind::Elastic => Box::new(Elastic::new(solid)),
        MoverKind::PlainElastic => {
            Box::new(Elastic::new(Solid { chi: 0.0, shape_exponent: 0.0, distance_exponent: 0.0, ..solid }))
        }
        // A relative residual: a hundredth of the tolerance.
        MoverKind::Laplacian => Box::new(Laplacian::new(solid.chi, 1e-2 * solid.tolerance)),
        MoverKind::RadialBasis => Box::new(RadialBasis::default()),
        MoverKind::InverseDistance => Box::new(InverseDistance::default()),
    }
}
