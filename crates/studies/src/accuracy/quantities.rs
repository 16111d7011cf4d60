//! Quantities of a study, read from the results of a run.

use std::collections::HashMap;
use std::path::Path;

use case::{Measured, Quantity, Role, Scene, StageKind, Statistic};
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use mesh::Point;
use results::history;

/// Column of `history.csv`, default statistic and required program of a quantity.
fn column(of: Measured) -> Option<(&'static str, Statistic, Role)> {
    use Measured as M;
    Some(match of {
        M::DescentSpeed => ("descent_speed_m_s", Statistic::Mean, Role::Flow),
        M::Drag => ("drag_n", Statistic::Mean, Role::Flow),
        M::DragCoefficient => ("cd", Statistic::Mean, Role::Flow),
        M::LineTension => ("max_line_tension_n", Statistic::Max, Role::Structure),
        M::RiserForce => ("riser_force_n", Statistic::Mean, Role::Structure),
        M::VerticalLoad => ("vertical_load_n", Statistic::Mean, Role::Structure),
        M::ProjectedArea => ("projected_area_m2", Statistic::End, Role::Structure),
        M::Volume => ("volume_m3", Statistic::End, Role::Structure),
        M::StrainEnergy => ("structure_strain_energy_j", Statistic::End, Role::Structure),
        M::KineticEnergy => ("structure_kinetic_energy_j", Statistic::End, Role::Structure),
        M::CouplingEnergy => ("interface_energy_error_sum_j", Statistic::End, Role::Structure),
        M::GridQuality => ("mesh_min_quality", Statistic::Min, Role::Mesh),
        M::GridVolumeRatio => ("mesh_min_volume_ratio", Statistic::Min, Role::Mesh),
        M::MaxPressure => ("flow_max_pressure_pa", Statistic::End, Role::Flow),
        M::MinPressure => ("flow_min_pressure_pa", Statistic::End, Role::Flow),
        M::VentArea | M::Displacement | M::Probe | M::History => return None,
    })
}

/// Suffixes of the columns of a probe in `probes.csv`.
const PROBED: [&str; 5] = ["_p_pa", "_u_m_s", "_v_m_s", "_w_m_s", "_t_k"];

/// Checks that a run of `scene` provides quantity `q`.
///
/// # Errors
/// It does not; the message names the quantity, the reason and the remedy.
pub fn check(q: &Quantity, scene: &Scene, stage: usize) -> Result<(), RunError> {
    let refuse = |why: String| Err(RunError::Input(format!("accuracy.quantity `{}`: {why}", q.name)));
    let stage = stage_of(q, scene, stage)?;
    let s = &scene.stages[stage];
    if let Some((_, _, role)) = column(q.of)
        && !s.kind.roles().contains(&role)
    {
        return refuse(format!(
            "stage `{}` does not run the {}. Select another stage with `stage`, or use another quantity",
            s.name,
            role.program()
        ));
    }
    if q.of == Measured::CouplingEnergy && s.kind != StageKind::Coupled {
        return refuse(format!("stage `{}` is not coupled", s.name));
    }
    if matches!(q.of, Measured::DescentSpeed | Measured::DragCoefficient) && scene.descent.is_none() {
        return refuse("the scene has no [descent]".into());
    }
    if matches!(q.of, Measured::LineTension | Measured::RiserForce) && scene.lines.is_none() {
        return refuse("the scene has no [lines]".into());
    }
    if matches!(q.of, Measured::Probe | Measured::History) && q.column.is_none() {
        return refuse("`column` is missing; give one such as `centre_p_pa` for a probe `centre`".into());
    }
    if q.of == Measured::Probe {
        probe_column(q.column.as_deref().unwrap_or_default(), scene).or_else(refuse)?;
    }
    if q.of == Measured::Displacement && q.at_m.is_none() {
        return refuse(
            "the point is missing; give its position on the unstressed canopy: at_m = [x, y, z]".into(),
        );
    }
    if q.of == Measured::VentArea {
        let interface = CanopyInterface::new(scene)?;
        if openings(&interface.faces).is_empty() {
            return refuse("the canopy has no vent (closed opening)".into());
        }
    }
    let duration = s.duration_s;
    let (from, to) = (q.from_s.unwrap_or(0.0), q.to_s.unwrap_or(duration));
    if duration > 0.0 && !(from >= 0.0 && from < to && to <= duration * (1.0 + 1e-9)) {
        return refuse(format!(
            "the interval {from} to {to} s is not part of stage `{}`, which lasts {duration} s",
            s.name
        ));
    }
    if q.exact == Some(0.0) && q.scale.is_none() {
        return refuse("the exact value is 0; give the `scale` of relative errors".into());
    }
    if q.scale.is_some_and(|s| !(s > 0.0 && s.is_finite())) {
        return refuse("`scale` must be above 0".into());
    }
    Ok(())
}

/// Checks that the probes of the scene have this column; the error is the reason.
fn probe_column(column: &str, scene: &Scene) -> Result<(), String> {
    let probes: Vec<&str> = scene.flow.iter().flat_map(|f| &f.probes).map(|p| p.name.as_str()).collect();
    let known = |p: &&str| column.strip_prefix(*p).is_some_and(|rest| PROBED.contains(&rest));
    if probes.iter().any(known) {
        return Ok(());
    }
    let (probes, suffixes) = (probes.join(", "), PROBED.join(", "));
    Err(format!(
        "there is no column `{column}`. Columns consist of the name of a probe ({probes}) and one of {suffixes}"
    ))
}

fn stage_of(q: &Quantity, scene: &Scene, stage: usize) -> Result<usize, RunError> {
    let Some(name) = &q.stage else { return Ok(stage) };
    scene.stages.iter().position(|s| &s.name == name).ok_or_else(|| {
        let names: Vec<&str> = scene.stages.iter().map(|s| s.name.as_str()).collect();
        RunError::Input(format!(
            "accuracy.quantity `{}`: the scene has no stage `{name}`; it has: {}",
            q.name,
            names.join(", ")
        ))
    })
}

/// The value of `q` in the results `out` of a run of `scene`.
///
/// # Errors
/// A file or a column is missing, or the value is not finite.
pub fn value(q: &Quantity, scene: &Scene, stage: usize, out: &Path) -> Result<f64, String> {
    let at = stage_of(q, scene, stage).map_err(|e| e.to_string())?;
    let folder = case::stage_folder(out, scene, at);
    let found = match q.of {
        Measured::VentArea | Measured::Displacement => {
            let interface = CanopyInterface::new(scene).map_err(|e| e.to_string())?;
            let state = results::state::load(
                &case::state_folder(out, scene, at),
                interface.nodes(),
                interface.faces.len(),
            )
            .map_err(|e| e.to_string())?;
            let d = |n: usize| -> Point { std::array::from_fn(|i| state.displacement[3 * n + i]) };
            if q.of == Measured::Displacement {
                displacement(q, &interface.coords, &d)
            } else {
                let now = |n: u32| -> Point {
                    let d = d(n as usize);
                    std::array::from_fn(|i| interface.coords[n as usize][i] + d[i])
                };
                openings(&interface.faces).iter().map(|l| loop_area(l, &now)).sum()
            }
        }
        _ => {
            let (file, name, take) = match (q.of, column(q.of)) {
                (Measured::Probe, _) => ("probes.csv", q.column.clone().unwrap_or_default(), Statistic::Mean),
                (_, Some((name, take, _))) => ("history.csv", name.into(), take),
                _ => ("history.csv", q.column.clone().unwrap_or_default(), Statistic::Mean),
            };
            let path = folder.join(file);
            let columns = history::read(&path).map_err(|e| e.to_string())?;
            let get = |name: &str| {
                let found = columns.iter().find(|(n, _)| n == name);
                found.map(|(_, v)| v).ok_or_else(|| format!("{} has no column `{name}`", path.display()))
            };
            let (time, values) = (get("time_s")?, get(&name)?);
            let duration = scene.stages[at].duration_s;
            let take = q.statistic.unwrap_or(take);
            let from = q.from_s.unwrap_or(if matches!(take, Statistic::End) { 0.0 } else { 0.5 * duration });
            let to = q.to_s.unwrap_or(f64::INFINITY);
            // A static stage has one window.
            let (from, to) = if duration > 0.0 { (from, to) } else { (f64::NEG_INFINITY, f64::INFINITY) };
            reduce(time, values, take, from, to)
                .ok_or_else(|| format!("no window lies between {from} and {to} s"))?
        }
    };
    if found.is_finite() { Ok(found) } else { Err(format!("`{}` is not a finite number", q.name)) }
}

/// Statistic of values at the ends of windows, between the times `from` and `to`. Means are those of the piecewise
/// linear interpolant, so that they do not jump when the window changes. `None` without a value in the interval.
pub fn reduce(time: &[f64], values: &[f64], take: Statistic, from: f64, to: f64) -> Option<f64> {
    let slack = 1e-9 * time.last()?.abs().max(1e-300);
    let (from, to) = (from, to.min(*time.last()?));
    let inside: Vec<(f64, f64)> = time
        .iter()
        .copied()
        .zip(values.iter().copied())
        .filter(|(t, _)| *t >= from - slack && *t <= to + slack)
        .collect();
    let end = inside.last()?.1;
    let all = || inside.iter().map(|p| p.1);
    Some(match take {
        Statistic::Max => all().fold(f64::MIN, f64::max),
        Statistic::Min => all().fold(f64::MAX, f64::min),
        Statistic::End => end,
        Statistic::Mean => integral(time, values, from, to, |v| v)?,
        Statistic::Rms => integral(time, values, from, to, |v| v * v)?.sqrt(),
    })
}

/// Mean of `f(value)` over time by the trapezoidal rule.
fn integral(time: &[f64], values: &[f64], from: f64, to: f64, f: impl Fn(f64) -> f64) -> Option<f64> {
    let at = |t: f64| {
        let i = time.partition_point(|&x| x < t).clamp(1, time.len().max(2) - 1);
        match (time.get(i - 1), time.get(i)) {
            (Some(&a), Some(&b)) if b > a && t > a => {
                let s = ((t - a) / (b - a)).min(1.0);
                f(values[i - 1]) * (1.0 - s) + f(values[i]) * s
            }
            _ => f(values[i - 1]),
        }
    };
    let mut points = vec![(from, at(from))];
    points.extend(time.iter().zip(values).filter(|(t, _)| **t > from && **t < to).map(|(&t, &v)| (t, f(v))));
    points.push((to, at(to)));
    let length = to - from;
    if !length.is_finite() || length <= 0.0 {
        return points.last().map(|p| p.1);
    }
    Some(points.windows(2).map(|p| 0.5 * (p[0].1 + p[1].1) * (p[1].0 - p[0].0)).sum::<f64>() / length)
}

fn displacement(q: &Quantity, coords: &[Point], d: &dyn Fn(usize) -> Point) -> f64 {
    let point = q.at_m.unwrap_or_default();
    let far = |x: &Point| (0..3).map(|i| (x[i] - point[i]).powi(2)).sum::<f64>();
    let near = (0..coords.len()).min_by(|&a, &b| far(&coords[a]).total_cmp(&far(&coords[b])));
    let moved = near.map(d).unwrap_or([f64::NAN; 3]);
    let length = |v: &Point| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    match &q.direction {
        Some(n) => moved.iter().zip(n).map(|(a, b)| a * b).sum::<f64>() / length(n),
        None => length(&moved),
    }
}

/// Closed boundary polygons of a surface except the longest, which is the skirt: nodes in order.
fn openings(faces: &[[u32; 4]]) -> Vec<Vec<u32>> {
    let mut next: HashMap<u32, Vec<u32>> = HashMap::new();
    let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
    for face in faces {
        let corners = if face[2] == face[3] { &face[..3] } else { &face[..] };
        for (i, &a) in corners.iter().enumerate() {
            *edges.entry((a, corners[(i + 1) % corners.len()])).or_default() += 1;
        }
    }
    for &(a, b) in edges.keys() {
        if !edges.contains_key(&(b, a)) {
            next.entry(a).or_default().push(b);
        }
    }
    let mut loops: Vec<Vec<u32>> = Vec::new();
    let mut starts: Vec<u32> = next.keys().copied().collect();
    starts.sort_unstable();
    for start in starts {
        let mut path = vec![start];
        while let Some(to) = next.get_mut(path.last().unwrap_or(&start)).and_then(Vec::pop) {
            // If two loops share a node, the inner one is closed first.
            if let Some(at) = path.iter().position(|&n| n == to) {
                loops.push(path.split_off(at));
                path.push(to);
            } else {
                path.push(to);
            }
        }
    }
    let longest = (0..loops.len()).max_by_key(|&i| loops[i].len());
    if let Some(longest) = longest {
        loops.remove(longest);
    }
    loops
}

/// Norm of the area vector of a closed polygon, m2.
fn loop_area(nodes: &[u32], at: &dyn Fn(u32) -> Point) -> f64 {
    let mut area = [0.0; 3];
    for (i, &a) in nodes.iter().enumerate() {
        let (p, q) = (at(a), at(nodes[(i + 1) % nodes.len()]));
        for (k, sum) in area.iter_mut().enumerate() {
            let (l, m) = ((k + 1) % 3, (k + 2) % 3);
            *sum += 0.5 * (p[l] * q[m] - p[m] * q[l]);
        }
    }
    area.iter().map(|a| a * a).sum::<f64>().sqrt()
}

/// Default quantities of a scene.
pub fn defaults(scene: &Scene, stage: usize) -> Vec<Quantity> {
    let s = &scene.stages[stage];
    let quantity = |name: &str, of| Quantity {
        name: name.into(),
        of,
        statistic: None,
        stage: None,
        from_s: None,
        to_s: None,
        column: None,
        at_m: None,
        direction: None,
        exact: None,
        scale: None,
    };
    let mut all = vec![
        quantity("descent speed, m/s", Measured::DescentSpeed),
        quantity("drag, N", Measured::Drag),
        quantity("projected area, m2", Measured::ProjectedArea),
        quantity("line tension, N", Measured::LineTension),
        quantity("volume, m3", Measured::Volume),
        quantity("vent area, m2", Measured::VentArea),
    ];
    // Only the inflation of a closed shape is described by a volume.
    if s.kind != StageKind::PreInflation {
        all.retain(|q| q.of != Measured::Volume);
    }
    all.retain(|q| check(q, scene, stage).is_ok());
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(name: &str) -> Scene {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases").join(name).join("scene.toml");
        case::load(&file).unwrap()
    }

    #[test]
    fn means_of_a_linear_function_do_not_depend_on_the_window() {
        for n in [4usize, 7, 20, 33] {
            let time: Vec<f64> = (1..=n).map(|i| i as f64 / n as f64).collect();
            let values: Vec<f64> = time.iter().map(|t| 2.0 + 3.0 * t).collect();
            let mean = reduce(&time, &values, Statistic::Mean, 0.5, 1.0).unwrap();
            assert!((mean - 4.25).abs() < 1e-12, "{n}: {mean}");
            assert_eq!(reduce(&time, &values, Statistic::Max, 0.5, 1.0), Some(5.0));
            assert_eq!(reduce(&time, &values, Statistic::End, 0.0, f64::INFINITY), Some(5.0));
        }
        assert_eq!(reduce(&[1.0], &[7.0], Statistic::Mean, f64::NEG_INFINITY, f64::INFINITY), Some(7.0));
        assert_eq!(reduce(&[], &[], Statistic::Mean, 0.0, 1.0), None);
        assert_eq!(reduce(&[0.5, 1.0], &[3.0, -4.0], Statistic::Max, 2.0, 3.0), None);
    }

    #[test]
    fn atps_has_four_equal_vents() {
        let interface = CanopyInterface::new(&scene("atps-descent")).unwrap();
        let vents = openings(&interface.faces);
        assert_eq!(vents.len(), 4);
        // On the unstressed canopy all are equal.
        let at = |n: u32| interface.coords[n as usize];
        let areas: Vec<f64> = vents.iter().map(|v| loop_area(v, &at)).collect();
        assert!(areas.iter().all(|a| (a - areas[0]).abs() < 1e-6 * areas[0].max(1e-3)), "{areas:?}");
        assert!(openings(&CanopyInterface::new(&scene("square-drop")).unwrap().faces).is_empty());
    }

    #[test]
    fn loop_area_of_a_square_is_exact() {
        let square: [Point; 4] = [[0.0; 3], [2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 2.0, 0.0]];
        assert!((loop_area(&[0, 1, 2, 3], &|n| square[n as usize]) - 4.0).abs() < 1e-12);
    }

    #[test]
    fn unavailable_quantities_are_refused() {
        let s = scene("square-drop");
        let named = |of| Quantity { of, ..defaults(&s, 2)[0].clone() };
        let why = |q: &Quantity, stage| check(q, &s, stage).unwrap_err().to_string();
        assert!(why(&named(Measured::Drag), 0).contains("flow-solver"));
        assert!(why(&named(Measured::VentArea), 2).contains("vent"));
        assert!(why(&named(Measured::Displacement), 2).contains("at_m"));
        assert!(why(&named(Measured::Probe), 2).contains("column"));
        let mut q = named(Measured::Drag);
        q.from_s = Some(3.0);
        assert!(why(&q, 2).contains("not part"));
        q.stage = Some("descend".into());
        assert!(why(&q, 2).contains("developed-flow"));
        let names: Vec<_> = defaults(&scene("atps-descent"), 2).into_iter().map(|q| q.of).collect();
        assert!(names.contains(&Measured::VentArea) && names.contains(&Measured::LineTension));
        assert_eq!(defaults(&scene("air-bag"), 0).len(), 2);
    }
}
