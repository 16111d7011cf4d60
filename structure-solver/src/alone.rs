//! A pre-inflation stage in one process, without coupler: for developers.

use std::path::Path;
use std::rc::Rc;
use std::time::Instant;

use case::Scene;
use comm::Comm;

use crate::dynamics::LoadPath;
use crate::loops::FaceLoad;
use crate::measures::Gauge;

/// Runs stage `stage` of `scene` and prints a table on rank 0.
pub fn run(comm: &Comm, scene: &Scene, stage: usize, _out: &Path, profile: bool) -> Result<(), String> {
    let mesh = Rc::new(mesh::structure_mesh(scene).map_err(|e| e.to_string())?);
    let mut d = crate::assemble::dynamics(comm, scene, stage, &mesh).map_err(|e| e.to_string())?;
    let mut gauge = Gauge::new(&d.system, &mesh);
    let s = &scene.stages[stage];
    let p = s.pressure_pa.ok_or("the stage has no pressure_pa")?;
    let pressure = vec![p; mesh.faces.len()];
    let load = LoadPath { pressure: [&pressure; 2], traction: [&[]; 2] };
    let face_load = FaceLoad { pressure: &pressure, traction: &[] };
    d.balance_start(face_load, [0.0; 3]).map_err(|e| e.to_string())?;
    let windows = (s.duration_s / s.window_s).round() as u64;
    if comm.is_root() {
        println!("# {} nodes, {} triangles, {} cables", mesh.coords.len(), mesh.triangles.len(), mesh.cables.len());
        println!(
            "#     t s    kinetic J   strain J   load N   riser N   area m2  volume m3  tension N  newton cuts gmres factor   wall s"
        );
    }
    let start = Instant::now();
    let (mut newton, mut cuts, mut last) = (0, 0, d.linear.cost);
    let every = (windows / 40).max(1);
    for w in 0..windows {
        let info = d.window(s.window_s, u64::from(s.substeps), load, [0.0; 3], false).map_err(|e| e.to_string())?;
        d.accept();
        newton += info.newton_steps;
        cuts += info.cuts;
        let done = w + 1 == windows;
        if (w + 1) % every == 0 || done || s.settled_energy_ratio.is_some() {
            let m = gauge.measure(&d.system, &d.accepted, face_load);
            let settled = s.settled_energy_ratio.is_some_and(|r| m.kinetic < r * m.strain) && w > 10;
            if comm.is_root() && ((w + 1) % every == 0 || done || settled) {
                let cost = d.linear.cost;
                println!(
                    "{:9.5} {:12.5e} {:10.4e} {:8.2} {:9.2} {:9.3} {:10.3} {:10.3} {:7} {:4} {:5} {:6} {:8.2}",
                    (w + 1) as f64 * s.window_s,
                    m.kinetic,
                    m.strain,
                    m.vertical_load,
                    m.riser_force,
                    m.projected_area,
                    m.volume,
                    m.max_line_tension,
                    newton,
                    cuts,
                    cost.iterations - last.iterations,
                    cost.factorisations - last.factorisations,
                    start.elapsed().as_secs_f64()
                );
                last = cost;
            }
            if settled {
                break;
            }
        }
    }
    if comm.is_root() && profile {
        let total = start.elapsed().as_secs_f64();
        let c = d.linear.cost;
        let share = |s: f64| 100.0 * s / total;
        println!(
            "# {total:.2} s: {newton} Newton steps, {:.3} ms each; assembly {:.1} %, factorisation {:.1} % ({}), GMRES {:.1} % ({} iterations), line searches {}",
            1e3 * total / newton as f64,
            share(d.newton.assembly_s),
            share(c.factorisation_s),
            c.factorisations,
            share(c.solve_s),
            c.iterations,
            d.newton.evaluations,
        );
    }
    Ok(())
}
