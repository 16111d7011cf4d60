//! Given velocity at an inlet: its flux, a free stream that stays, and the mass of a blocked wind tunnel.

use crate::common::{Noise, at_rest, isothermal, settings, solver_of};
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::{BoundaryFace, Gas, IdealGas, Inviscid, Isothermal, open_boundary};
use flow_solver::{Loads, Solver, Step};
use mesh::{BoxShape, Patch, box_grid_of, plate_grid};

const WIND: [f64; 3] = [3.0, -2.0, 4.0];

/// Mass by the given velocity and the density at the pressure inside; what enters has the undisturbed temperature;
/// what leaves, where the face sweeps less than the wind, is carried from inside. The pressure is that of inside.
fn flux_of<G: Gas<N>, const N: usize>(gas: G) {
    let grid = box_grid_of(BoxShape::Tetrahedra, [1; 3], [0.0; 3], [1.0, 0.8, 1.1], [Patch::Inlet; 6]);
    let mut s = solver_of(&grid, gas, Inviscid, settings(WIND, 1e-3));
    let q: [f64; N] = std::array::from_fn(|v| [300.0, 1.0, 5.0, -2.0, 4.0][v]);
    let mut seen = [0; 2];
    for k in 0..s.metrics.faces.len() {
        s.metrics.faces[k].grid_flux = 0.3;
    }
    let sides: Vec<_> = s.topology.sides_of(Patch::Inlet).copied().collect();
    assert_eq!(sides.len(), 12);
    for side in sides {
        let metric = &s.metrics.faces[side.face as usize];
        let at = BoundaryFace { scheme: &s.scheme, metric, sign: side.sign, pressure: 0.0 };
        let inlet = open_boundary::<G, N>(Patch::Inlet).expect("air passes");
        let found = inlet.flux(&gas, &at, &q, &q, [0.25, -0.125]);
        let area = metric.area * side.sign;
        let volume = Vec3::from(WIND).dot(&area) - side.sign * metric.grid_flux;
        let mut from = if volume > 0.0 { q } else { gas.undisturbed(WIND.into()) };
        from[0] = q[0];
        seen[usize::from(volume > 0.0)] += 1;
        let mass = gas.density(&from) * volume;
        assert!(
            (found.mass - mass).abs() < 1e-12 * mass.abs() && found.rhie_chow == 0.0,
            "{} {mass}",
            found.mass
        );
        let (carried, push) =
            (gas.carried(&from), gas.pressure_flux(q[0], area, side.sign * metric.grid_flux));
        for v in 0..N {
            let exact = mass * carried[v] + push[v];
            assert!((found.flux[v] - exact).abs() < 1e-12 * exact.abs().max(1.0), "{v}: {found:?} {exact}");
        }
    }
    assert!(seen.iter().all(|n| *n > 0), "{seen:?}");
}

#[test]
fn inlet_has_prescribed_velocity_and_interior_pressure() {
    let air = settings(WIND, 1.0).air;
    flux_of(Isothermal::new(air));
    flux_of(IdealGas::new(air));
}

/// Largest deviation from a uniform stream between inlets and outlets, on a grid whose nodes move at random.
fn drift<G: Gas<N>, const N: usize>(shape: BoxShape, gas: G) -> f64 {
    let (i, o) = (Patch::Inlet, Patch::Outlet);
    let mut grid = box_grid_of(shape, [4, 3, 5], [0.0; 3], [1.0, 0.8, 1.1], [i, o, Patch::FarField, i, i, o]);
    let mut noise = Noise(7);
    grid.coords.iter_mut().flatten().for_each(|x| *x += 0.02 * noise.next());
    let mut s = solver_of(&grid, gas, Inviscid, settings(WIND, 1e-10));
    let start = s.nodes.clone();
    for _ in 0..8 {
        for (x, x0) in s.nodes.iter_mut().zip(&start) {
            *x = x0.map(|x| x + 0.02 * noise.next());
        }
        s.advance(&Step { dt: 4e-3, frame: Vec3::new(0.3, 1.0, -4.9), repeat: false, moved: true }).unwrap();
        s.accept(4e-3, true);
    }
    let far = s.spatial.gas.undisturbed(WIND.into());
    let off = |q: &[f64; N]| {
        (1..4).map(|d| (q[d] - far[d]).abs() / 5.4).fold((q[0] - far[0]).abs() / 18.0, f64::max)
    };
    s.q.iter().map(off).fold(0.0, f64::max)
}

#[test]
fn free_stream_is_preserved_between_inlets_and_outlets() {
    let air = settings(WIND, 1.0).air;
    for shape in [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra] {
        let e = drift(shape, Isothermal::new(air));
        assert!(e < 1e-12, "{shape:?}: {e:e}");
        let e = drift(shape, IdealGas::new(air));
        assert!(e < 1e-10, "{shape:?}, energy: {e:e}");
    }
}

/// Mass that leaves through the faces of `patch`, kg/s.
fn leaving(s: &Solver<Isothermal, 4>, patch: Patch) -> f64 {
    s.topology.sides_of(patch).map(|side| f64::from(s.face_flux()[side.face as usize].mass)).sum()
}

/// A plate blocks a quarter of a tunnel of 4 m2 whose walls slip. The air is denser ahead of the plate by p / (R T):
/// with that the inlet passes what the wind says, the outlet the same, and a far field in its place less.
#[test]
fn blocked_tunnel_conserves_the_inlet_mass_flux() {
    let speed = 5.0;
    let tunnel = |first: Patch, upwind: f64| {
        let w = Patch::Slip;
        let ends = [w, w, w, w, first, Patch::Outlet];
        let grid = plate_grid([8, 8, 20], [-1.0, -1.0, -2.0], [1.0, 1.0, 3.0], ends, 8, [2..6, 2..6]);
        let mut s = isothermal(&grid, Inviscid, settings([0.0, 0.0, speed], 1e-6));
        s.spatial.upwind_share = upwind;
        let mut loads = Loads::new(&s);
        for _ in 0..12 {
            s.advance(&at_rest(1.0)).unwrap();
            s.accept(1.0, false);
        }
        (leaving(&s, first), leaving(&s, Patch::Outlet), loads.compute(&s).force[2], s)
    };
    let (entering, out, drag, s) = tunnel(Patch::Inlet, 1.0);
    let air = s.settings.air;
    let ahead: f64 = (s.topology.sides_of(Patch::Inlet))
        .map(|side| {
            let (f, c) = (&s.metrics.faces[side.face as usize], side.cell as usize);
            let d = s.metrics.border(side.face) - s.metrics.centre(c);
            let q = flow_solver::gradient::extrapolated(&s.q[c], &s.gradient[c], &d);
            f.magnitude() * s.spatial.gas.density(&q)
        })
        .sum();
    let given = ahead * speed;
    println!("inlet {entering}, given {given}, outlet {out} kg/s, drag {drag} N");
    assert!((given / (4.0 * speed * air.density) - 1.0).abs() < 2e-3, "the density is that of the air");
    // Mass fluxes of faces are kept in single precision.
    assert!((entering + given).abs() < 1e-6 * given, "{entering} {given}");
    assert!((out - given).abs() < 1e-6 * given, "{out} {given}");
    let (entering, out, ..) = tunnel(Patch::Inlet, 0.0);
    println!("hybrid flux: inlet {entering}, outlet {out} kg/s");
    assert!((entering + out).abs() < 1e-6 * out, "hybrid flux: {entering} {out}");
    let (far, ..) = tunnel(Patch::FarField, 1.0);
    println!("far field {far} kg/s");
    assert!(-far < 0.999 * given, "a far field yields to the plate: {far}");
    assert!(drag > 0.0);
}
