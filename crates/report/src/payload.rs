//! The payload: its place in the 3-D view, its motion, and the path of the system.

use case::{PayloadBody, Scene};
use coupling::interface::CanopyInterface;

use super::chart::{Chart, Series};
use super::data::{Columns, Run, StageData};

/// Shortest side of a payload in the view, m: a rod or a plate has no thickness.
const MIN_SIDE: f64 = 0.02;

/// Place (m) and attitude of the payload in the falling frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    place: [f64; 3],
    /// Unit quaternion x, y, z, scalar part.
    attitude: [f64; 4],
}

impl Pose {
    /// Its place, m.
    pub(super) fn place(&self) -> [f64; 3] {
        self.place
    }

    /// As the viewer reads it, rounded to 0.1 mm.
    pub(super) fn numbers(self) -> [f64; 7] {
        let all = [self.place.as_slice(), self.attitude.as_slice()].concat();
        std::array::from_fn(|i| (1e4 * all[i]).round() / 1e4)
    }
}

/// The payload in a stage.
pub(super) struct Payload<'a> {
    /// Motion of a body.
    motion: &'a Columns,
    /// Where it is held; `None` where that is not known.
    held: Option<Pose>,
}

impl<'a> Payload<'a> {
    /// Of a stage of a run.
    pub(super) fn of(run: &Run, stage: &'a StageData) -> Self {
        let scene = run.scene();
        let body = scene.payload_body();
        let middle = CanopyInterface::new(scene).ok().and_then(|canopy| canopy.payload);
        // The attachments are around the centre of mass; a release at an attitude turns them in the first stage.
        let held = middle.filter(|_| !body.is_some_and(PayloadBody::is_released_turned)).map(|middle| {
            let mean = body.map_or([0.0; 3], |b| mean(&b.attachments_m));
            Pose { place: std::array::from_fn(|i| middle[i] - mean[i]), attitude: [0.0, 0.0, 0.0, 1.0] }
        });
        Self { motion: &stage.payload, held }
    }

    /// At `time`, s.
    pub(super) fn at(&self, time: f64) -> Option<Pose> {
        let Some(times) = self.motion.get("time_s") else { return self.held };
        let nearest =
            (0..times.len()).min_by(|&a, &b| (times[a] - time).abs().total_cmp(&(times[b] - time).abs()))?;
        let value = |name: &str| self.motion.get(name).map_or(0.0, |v| v[nearest]);
        let attitude = ["qx", "qy", "qz", "qw"].map(value);
        Some(Pose { place: ["x_m", "y_m", "z_m"].map(value), attitude })
    }
}

fn mean(points: &[[f64; 3]]) -> [f64; 3] {
    std::array::from_fn(|i| points.iter().map(|p| p[i]).sum::<f64>() / points.len().max(1) as f64)
}

/// Sides of the box of uniform density with the mass and the moments of inertia of the payload, m; `None` where it is a
/// point.
pub(super) fn size(scene: &Scene) -> Option<[f64; 3]> {
    let mass = scene.descent.as_ref()?.payload_mass_kg;
    let inertia = scene.payload_body()?.inertia_kg_m2;
    // I_x = m (b^2 + c^2) / 12.
    let side = |i: usize| 6.0 * (inertia.iter().sum::<f64>() - 2.0 * inertia[i]) / mass;
    Some([0, 1, 2].map(|i| side(i).max(0.0).sqrt().max(MIN_SIDE)))
}

/// What the payload in the view stands for.
pub(super) fn caption(scene: &Scene) -> Option<String> {
    scene.descent.as_ref()?;
    let text = match size(scene) {
        Some(sides) => {
            let [a, b, c] = sides.map(|s| format!("{s:.2}"));
            format!(
                " The payload is shown as the uniform box of its mass and inertia, {a} m x {b} m x {c} m."
            )
        }
        None => " The payload is a point; its box shows the place and has no scale.".into(),
    };
    Some(text)
}

/// Charts of the motion of a payload that is a body, and of the path of the frame over ground.
pub(super) fn charts(stage: &StageData, id: &str) -> Vec<Chart> {
    let chart = |name: &str, title: &str, unit, note: &str, series| Chart {
        id: format!("{id}-{name}"),
        title: title.into(),
        unit,
        note: note.into(),
        series,
        ..Chart::default()
    };
    let curves = |columns: &[(&str, &str)], factor: f64| -> Vec<Series> {
        let of = |(column, label): &(&str, &str)| Series {
            label: (*label).into(),
            points: stage.payload.series(column).into_iter().map(|(t, v)| (t, factor * v)).collect(),
        };
        columns.iter().map(of).filter(|s| s.points.iter().any(|p| p.1.abs() > 1e-12)).collect()
    };
    let xyz = |start: &str, end: &str| ["x", "y", "z"].map(|axis| format!("{start}{axis}{end}"));
    let axes = |names: &[String; 3], factor: f64| {
        curves(&[(&names[0], "along x"), (&names[1], "along y"), (&names[2], "along z")], factor)
    };
    let degrees = 1f64.to_degrees();
    let mut found = path(&stage.columns, id);
    found.extend([
        chart(
            "payload-tilt",
            "Tilt of the payload",
            "deg",
            "Angle between the vertical axis of the payload and the vertical.",
            curves(&[("tilt_rad", "tilt")], degrees),
        ),
        chart(
            "payload-rates",
            "Angular velocity of the payload",
            "deg/s",
            "Components along the axes of the payload.",
            axes(&xyz("rate_", "_rad_s"), degrees),
        ),
        chart(
            "payload-place",
            "Position of the payload in the frame",
            "m",
            "Centre of mass in the falling frame, whose origin is that of the scene.",
            axes(&xyz("", "_m"), 1.0),
        ),
        chart(
            "payload-velocity",
            "Velocity of the payload in the frame",
            "m/s",
            "Centre of mass relative to the falling frame.",
            axes(&xyz("v", "_m_s"), 1.0),
        ),
        chart(
            "payload-force",
            "Force of the lines and the air on the payload",
            "N",
            "Components along the axes of the scene.",
            axes(&xyz("force_", "_n"), 1.0),
        ),
    ]);
    found.retain(|c| !c.is_empty());
    found
}

/// The path of the frame over ground, from above and from the side.
fn path(columns: &Columns, id: &str) -> Vec<Chart> {
    let (Some(x), Some(y), Some(z)) =
        (columns.get("frame_x_m"), columns.get("frame_y_m"), columns.get("frame_z_m"))
    else {
        return Vec::new();
    };
    let aside = || x.iter().zip(y).map(|(x, y)| x.hypot(*y));
    if aside().all(|d| d < 1e-9) {
        return Vec::new();
    }
    let chart = |name: &str, title: &str, along, note: &str, points| Chart {
        id: format!("{id}-{name}"),
        title: title.into(),
        unit: "m",
        note: note.into(),
        series: vec![Series { label: "path".into(), points }],
        along,
        ..Chart::default()
    };
    vec![
        chart(
            "path-above",
            "Trajectory from above: y",
            "x, m",
            "Path of the payload over ground since its release.",
            x.iter().copied().zip(y.iter().copied()).collect(),
        ),
        chart(
            "path-side",
            "Trajectory from the side: height",
            "horizontal distance, m",
            "Height of the payload relative to its release, over the horizontal distance from there.",
            aside().zip(z.iter().copied()).collect(),
        ),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box of 12 kg and 1 m x 2 m x 3 m: I_x = 12 (4 + 9) / 12 = 13, I_y = 10, I_z = 5 kg m2.
    #[test]
    fn payload_is_the_box_of_its_inertia() {
        let text = include_str!("../../../cases/square-drop/scene.toml");
        let parse = |text: &str| {
            case::parse(std::path::Path::new("scene.toml"), text).unwrap_or_else(|e| panic!("{e}"))
        };
        assert_eq!(size(&parse(text)), None);
        let body = "[descent.body]\ninertia_kg_m2 = [13.0, 10.0, 5.0]\nattachments_m = [[0.0, 0.0, 0.2]]\n";
        let scene = text.replace("payload_mass_kg = 5.0", "payload_mass_kg = 12.0").replacen(
            "[[stage]]",
            &format!("[fabric_gravity]\n{body}\n[[stage]]"),
            1,
        );
        let sides = size(&parse(&scene)).expect("a body");
        assert!(sides.iter().zip([1.0, 2.0, 3.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{sides:?}");
        assert!(caption(&parse(&scene)).is_some_and(|text| text.contains("1.00 m x 2.00 m x 3.00 m")));
    }
}
