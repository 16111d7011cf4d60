//! Loads of the air on the canopy: pressure jump and shear.

use comm::Halo;

use crate::geometry::vec3::Vec3;
use crate::physics::Gas;
use crate::solver::Solver;
use crate::topology::Topology;

/// Load on one canopy face: pressure jump (inside minus outside), Pa, and
/// shear traction x, y, z summed over both sides, Pa. A side without cells has the ambient pressure and no shear.
pub type FaceLoad = [f64; 4];

/// Loads on the canopy faces of one rank.
pub struct Loads {
    halo: Halo,
    /// Local canopy faces in the order of `Topology::canopy`; owned ones first.
    pub faces: Vec<FaceLoad>,
}

/// Load on the whole canopy.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Total {
    /// Force, N.
    pub force: Vec3,
    /// Moment about the origin of the frame, N m.
    pub moment: Vec3,
}

impl Loads {
    /// For the canopy faces of `solver`. Collective.
    pub fn new<G: Gas<N>, const N: usize>(solver: &Solver<G, N>) -> Self {
        let canopy = &solver.topology.canopy;
        Self { halo: Halo::new(solver.comm(), canopy), faces: vec![[0.0; 4]; canopy.n_local()] }
    }

    /// Adds the pressure `p` (Pa) on the sides without cells, whose normal is opposite to that of the sides with cells.
    fn add_ambient(&mut self, t: &Topology, p: f64) {
        if t.one_sided {
            for side in t.slip.iter().chain(&t.no_slip).filter(|s| s.canopy != u32::MAX) {
                self.faces[side.canopy as usize][0] -= side.sign * p;
            }
        }
    }

    /// Loads of the solver's last step; afterwards the owned part of `faces` is
    /// complete. The canopy's normal points from inside to outside. Collective.
    pub fn compute<G: Gas<N>, const N: usize>(&mut self, solver: &Solver<G, N>) -> Total {
        let _part = timing::part("loads");
        let on = solver.domain();
        self.faces.fill([0.0; 4]);
        let t = on.topology;
        for side in t.slip.iter().chain(&t.no_slip).filter(|s| s.canopy != u32::MAX) {
            let p = solver.spatial.wall_pressure(&on, &solver.q, &solver.gradient, side);
            self.faces[side.canopy as usize][0] += side.sign * p;
        }
        if solver.spatial.viscosity.is_active() {
            for side in t.no_slip.iter().filter(|s| s.canopy != u32::MAX) {
                let shear = solver.spatial.wall_traction(&on, &solver.scheme, &solver.q, side);
                for (l, s) in self.faces[side.canopy as usize][1..].iter_mut().zip(&shear) {
                    *l += s;
                }
            }
        }
        self.halo.accumulate(self.faces.as_flattened_mut(), 4);
        self.add_ambient(t, solver.settings.ambient_pressure);
        let mut sum = [0.0; 6];
        for (load, &face) in self.faces[..t.canopy.n_owned].iter().zip(&t.canopy_face) {
            let centre = on.metrics.border(face);
            let face = &on.metrics.faces[face as usize];
            let shear = Vec3::new(load[1], load[2], load[3]) * face.magnitude();
            let force = face.area * load[0] + shear;
            let moment = centre.cross(&force);
            for d in 0..3 {
                sum[d] += force[d];
                sum[3 + d] += moment[d];
            }
        }
        solver.comm().sum_slice(&mut sum);
        let [fx, fy, fz, mx, my, mz] = sum;
        Total { force: Vec3::new(fx, fy, fz), moment: Vec3::new(mx, my, mz) }
    }
}
