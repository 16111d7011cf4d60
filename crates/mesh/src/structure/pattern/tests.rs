use std::f64::consts::PI;
use std::fmt::Write as _;

use case::{Canopy, Tape};

use super::*;
use crate::structure::tests::scene;
use crate::structure_mesh;

/// Points of a polyline as TOML.
fn points(all: &[[f64; 2]]) -> String {
    let all: Vec<String> = all.iter().map(|[x, y]| format!("[{x:.12}, {y:.12}]")).collect();
    format!("[{}]", all.join(", "))
}

/// A panel of edges with names and points, and its keys before and after.
fn panel(name: &str, keys: &str, edges: &[(&str, Vec<[f64; 2]>)], start: &str) -> String {
    let mut text = format!("[[panel]]\nname = \"{name}\"\n{keys}\nstart = {start}\n");
    for (edge, all) in edges {
        writeln!(text, "[[panel.edge]]\nname = \"{edge}\"\npoints_m = {}", points(all)).unwrap();
    }
    text
}

/// Trapezoidal gores of a cone around the axis, from the vent to the skirt: distances of their middle lines, m, and the angle below the horizontal.
fn conical(gores: u32, [vent, skirt]: [f64; 2], angle_deg: f64) -> String {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    let length = (skirt - vent) / cos;
    let half = (PI / f64::from(gores)).tan();
    let [a, b] = [skirt * half, vent * half];
    let edges = [
        ("skirt", vec![[-a, 0.0]]),
        ("right", vec![[a, 0.0]]),
        ("vent", vec![[b, length]]),
        ("left", vec![[-b, length]]),
    ];
    let start = format!(
        "{{ meridian_m = [[{skirt}, 0.0], [{vent}, {}]], turn_deg = {} }}",
        length * sin,
        180.0 / f64::from(gores)
    );
    let seam = "[[seam]]\nedges = [\"gore.right\", \"gore.left\"]\nnext_copy = true\n\
                [[attachment]]\nedge = \"gore.skirt\"\nat = 0\n";
    format!(
        "hem = [\"gore.skirt\"]\nvents = [\"gore.vent\"]\n{}{seam}",
        panel("gore", &format!("copies = {gores}"), &edges, &start)
    )
}

/// Lune gores of a sphere: each as wide as the sphere at its middle line.
fn ball(gores: u32, radius: f64) -> String {
    let half = |y: f64| PI / f64::from(gores) * radius * (y / radius).sin();
    let n = 400;
    let at = |i: usize| PI * radius * i as f64 / f64::from(n as u32);
    let right: Vec<[f64; 2]> = (0..n).map(|i| [half(at(i)), at(i)]).collect();
    let left: Vec<[f64; 2]> = (0..n).map(|i| [-half(at(n - i)), at(n - i)]).collect();
    let meridian: Vec<[f64; 2]> = (0..=n)
        .map(|i| [radius * (at(i) / radius).sin().max(0.0), -radius * (at(i) / radius).cos()])
        .collect();
    let start = format!("{{ meridian_m = {} }}", points(&meridian));
    panel("lune", &format!("copies = {gores}"), &[("right", right), ("left", left)], &start)
        + "[[seam]]\nedges = [\"lune.right\", \"lune.left\"]\nnext_copy = true\n\
           [[hold]]\nedge = \"lune.right\"\nat = 0\n"
}

/// A rectangle of the size `2 pi radius` by `height` around a cylinder.
fn cylinder(radius: f64, height: f64) -> String {
    let a = PI * radius;
    let edges = [
        ("lower", vec![[-a, 0.0]]),
        ("right", vec![[a, 0.0]]),
        ("upper", vec![[a, height]]),
        ("left", vec![[-a, height]]),
    ];
    let start = format!("{{ meridian_m = [[{radius}, 0.0], [{radius}, {height}]] }}");
    panel("wall", "", &edges, &start)
        + "[[seam]]\nedges = [\"wall.right\", \"wall.left\"]\n\
        [[hold]]\nedge = \"wall.lower\"\ncomponents = \"z\"\n"
}

fn canopy(folder: &tempfile::TempDir, text: &str, size: f64, line: Option<f64>) -> Canopy {
    let file = folder.path().join("pattern.toml");
    std::fs::write(&file, text).unwrap();
    Canopy::Pattern(PatternCanopy {
        file,
        element_size_m: size,
        line_length_m: line,
        segments_per_line: 1,
        risers: None,
    })
}

fn meshed(text: &str, size: f64, line: Option<f64>) -> StructureMesh {
    let folder = tempfile::tempdir().unwrap();
    structure_mesh(&scene(canopy(&folder, text, size, line))).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn error(text: &str) -> String {
    error_of(text, 0.3)
}

fn error_of(text: &str, size: f64) -> String {
    let folder = tempfile::tempdir().unwrap();
    let line = text.contains("[[attachment]]").then_some(20.0);
    match structure_mesh(&scene(canopy(&folder, text, size, line))) {
        Ok(_) => panic!("accepted:\n{text}"),
        Err(e) => e.to_string(),
    }
}

fn stretches(mesh: &StructureMesh) -> [f64; 2] {
    let all = (0..mesh.triangles.len()).map(|t| mesh.starting_stretches(t));
    all.fold([0.0, f64::INFINITY], |m, s| [m[0].max(s[0]), m[1].min(s[1])])
}

/// Volume enclosed with the origin, m3.
fn volume(mesh: &StructureMesh) -> f64 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|n| crate::geometry::at(&mesh.coords, n));
        a.cross(&b).dot(&c) / 6.0
    };
    mesh.triangles.iter().map(of).sum()
}

/// Each edge of the mesh has one triangle on each side at most, which run along it in opposite directions.
fn is_oriented(mesh: &StructureMesh) -> bool {
    let mut sides: Vec<[u32; 2]> =
        mesh.triangles.iter().flat_map(|t| (0..3).map(|i| [t[i], t[(i + 1) % 3]])).collect();
    let all = sides.len();
    sides.sort_unstable();
    sides.dedup();
    sides.len() == all
}

#[test]
fn gores_have_the_area_of_their_drawing() {
    for (gores, angle) in [(8, 0.0), (12, 25.0)] {
        let text = conical(gores, [0.3, 3.0], angle);
        let mesh = meshed(&text, 0.4, Some(5.0));
        let exact =
            f64::from(gores) * (PI / f64::from(gores)).tan() * (9.0 - 0.09) / angle.to_radians().cos();
        assert!((mesh.fabric_area(|_| true) / exact - 1.0).abs() < 1e-12);
        assert!((mesh.fabric_area(|c| c == 3) * f64::from(gores) / exact - 1.0).abs() < 1e-12);
        // Flat triangles are counter-clockwise, so that normals point out: upwards.
        assert!(mesh.flat.iter().all(|x| outline::area(x) > 0.0) && is_oriented(&mesh));
        let up: f64 = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|n| crate::geometry::at(&mesh.coords, n));
                0.5 * (b - a).cross(&(c - a)).z
            })
            .sum();
        assert!(up > 0.9 * exact * angle.to_radians().cos(), "{up} {exact}");
        let [most, least] = stretches(&mesh);
        // Seams are longer than the middle line by 1 / cos(pi / N), and both gores end beyond the seam by r (tan(pi / N) - pi / N), of triangles at least h / 2 wide.
        let angle = PI / f64::from(gores);
        let slack = 1.0 - angle.cos() + 3.0 * (angle.tan() - angle) / (0.5 * 0.4);
        assert!(most <= 1.0 + 1e-9 && least > 1.0 - slack, "{most} {least} {slack}");
        // The lines, in the order of their angle, are as long as given; the longest is taut.
        let skirt = mesh.skirt();
        assert_eq!((skirt.len(), mesh.cables.len()), (gores as usize, gores as usize));
        let begins: Vec<f64> = mesh
            .cables
            .iter()
            .map(|c| {
                let x = mesh.coords[c.nodes[0] as usize];
                x[1].atan2(x[0]).rem_euclid(2.0 * PI - 1e-6)
            })
            .collect();
        assert!(begins.windows(2).all(|a| a[0] < a[1]), "{begins:?}");
        assert!(mesh.cables.iter().all(|c| c.rest_length == 5.0));
        assert_eq!(mesh.node_sets["gore.right"], mesh.node_sets["gore.left"]);
    }
}

/// Tapes have the flat lengths of the edges; lines come first.
#[test]
fn tapes_follow_hem_vents_and_seams() {
    let folder = tempfile::tempdir().unwrap();
    let mut s = scene(canopy(&folder, &conical(8, [0.3, 3.0], 25.0), 0.4, Some(5.0)));
    let tape = Some(Tape { axial_stiffness_n: 1e4, mass_kg_m: 0.01, ..Tape::default() });
    s.tapes = Some(Tapes { hem: tape, seams: tape, vents: tape, ..Tapes::default() });
    let mesh = structure_mesh(&s).unwrap();
    let length = |place| mesh.cable_length(CableKind::Tape(place));
    let half = (PI / 8.0).tan();
    assert!((length(TapePlace::Hem) - 16.0 * 3.0 * half).abs() < 1e-9);
    assert!((length(TapePlace::Vents) - 16.0 * 0.3 * half).abs() < 1e-9);
    let seam = (2.7 / 25_f64.to_radians().cos()).hypot(2.7 * half);
    assert!((length(TapePlace::Seams) - 8.0 * seam).abs() < 1e-9);
    let free = mesh.cables.iter().take_while(|c| c.kind == CableKind::SuspensionLine).count();
    assert_eq!(free, 8);
    // Lines of one number are of one kind.
    let kind = |k: u32| mesh.cables.iter().find(|c| c.line == k).map(|c| c.kind);
    assert!(mesh.cables.iter().all(|c| kind(c.line) == Some(c.kind)));
}

/// A sheet around a cylinder: chords instead of arcs only, its flat area, and no stretch.
#[test]
fn a_sheet_becomes_a_cylinder() {
    let (radius, height) = (0.5, 1.0);
    let mesh = meshed(&cylinder(radius, height), 0.1, None);
    assert!((mesh.fabric_area(|_| true) / (2.0 * PI * radius * height) - 1.0).abs() < 1e-12);
    let far = mesh.coords.iter().map(|x| (x[0].hypot(x[1]) - radius).abs()).fold(0.0, f64::max);
    // Relaxed by at most its margin: the third corner of a triangle is farther out than the chord of the other two, by h^2 / (8 R).
    assert!(far < 1e-3 * radius, "{far}");
    let [most, least] = stretches(&mesh);
    // A chord over the angle h / R is shorter than its arc by the share (h / R)^2 / 24; sides are at most 1.5 h long.
    assert!(most <= 1.0 + 1e-9 && least > 1.0 - (1.5 * 0.1 / radius).powi(2) / 24.0, "{most} {least}");
    assert!(is_oriented(&mesh) && mesh.node_sets["rim"].len() == 2 * 32);
    // Outwards: the divergence theorem with the open ends at z = 0 and z = h.
    let closed = volume(&mesh) * 1.5;
    assert!((closed / (PI * radius * radius * height) - 1.0).abs() < 0.02, "{closed}");
}

/// Lunes that are as wide as a sphere enclose its volume up to the square of their width.
#[test]
fn lunes_make_a_ball_of_second_order() {
    let sphere = 4.0 / 3.0 * PI;
    let lost = [6, 12, 24].map(|gores| {
        let mesh = meshed(&ball(gores, 1.0), 2.0 * PI / f64::from(gores) / 3.0, None);
        let [most, _] = stretches(&mesh);
        assert!(most <= 1.0 + 1e-9 && is_oriented(&mesh) && mesh.node_sets["rim"].is_empty());
        // The flat area of lunes is that of the sphere, up to the chords of the curved edges.
        let chords = (2.0 * PI / f64::from(gores) / 3.0).powi(2) / 12.0;
        assert!((mesh.fabric_area(|_| true) / (4.0 * PI) - 1.0).abs() < chords);
        1.0 - volume(&mesh) / sphere
    });
    let orders = [lost[0] / lost[1], lost[1] / lost[2]].map(f64::log2);
    assert!(orders.iter().all(|o| (1.7..2.4).contains(o)), "{lost:?} {orders:?}");
}

/// Half circles of different radii are no matter: a longer edge is gathered evenly, and no triangle starts stretched.
fn gathered(fullness: f64) -> String {
    let edges = |w: f64| {
        vec![
            ("lower", vec![[0.0, 0.0]]),
            ("right", vec![[w, 0.0]]),
            ("upper", vec![[w, 1.0]]),
            ("left", vec![[0.0, 1.0]]),
        ]
    };
    let start = |z: f64| {
        format!("{{ origin_m = [0.0, 0.0, {z}], x_axis = [1.0, 0.0, 0.0], y_axis = [0.0, 0.0, 1.0] }}")
    };
    panel("band", "", &edges(2.0), &start(0.0))
        + &panel("sail", "", &edges(2.0 * (1.0 + fullness)), &start(1.0))
        + "[[seam]]\nedges = [\"band.upper\", \"sail.lower\"]\n[[hold]]\nedge = \"band.lower\"\n"
}

#[test]
fn fullness_is_gathered_evenly_without_tension() {
    let folder = tempfile::tempdir().unwrap();
    for fullness in [0.05, 0.2] {
        let mut s = scene(canopy(&folder, &gathered(fullness), 0.1, None));
        let tape = Some(Tape { axial_stiffness_n: 1e4, mass_kg_m: 0.01, ..Tape::default() });
        s.tapes = Some(Tapes { seams: tape, ..Tapes::default() });
        let mesh = structure_mesh(&s).unwrap();
        assert!((mesh.fabric_area(|_| true) - 2.0 - 2.0 * (1.0 + fullness)).abs() < 1e-12);
        assert!(stretches(&mesh)[0] <= 1.0 + 1e-9, "{:?}", stretches(&mesh));
        // Onto the shorter edge.
        assert!((mesh.cable_length(CableKind::Tape(TapePlace::Seams)) - 2.0).abs() < 1e-12);
        // All parts of the seam keep their share of the longer edge.
        let parts = mesh.node_sets["sail.lower"].len() - 1;
        let part = 2.0 * (1.0 + fullness) / parts as f64;
        let seam = &mesh.node_sets["sail.lower"];
        assert_eq!(seam, &mesh.node_sets["band.upper"]);
        let sewn = |t: usize| {
            let on = mesh.triangles[t].map(|n| seam.contains(&n));
            let x = mesh.reference_triangle(t);
            (0..3)
                .filter(|i| on[*i] && on[(i + 1) % 3])
                .map(|i| (x[i] - x[(i + 1) % 3]).norm())
                .collect::<Vec<_>>()
        };
        let of_sail = (0..mesh.triangles.len()).filter(|t| mesh.face_panel[*t] == 1).flat_map(sewn);
        let lengths: Vec<f64> = of_sail.collect();
        assert!(lengths.len() == parts && lengths.iter().all(|l| (l - part).abs() < 1e-12), "{lengths:?}");
    }
    let twice = error(&gathered(1.2));
    assert!(twice.contains("seam[0]") && twice.contains("2.0000 and 4.4000 m"), "{twice}");
}

/// A drawing of the inner side is the mirror image of that of the outer side: the same canopy, also its warp.
#[test]
fn drawings_of_both_sides_make_one_canopy() {
    let skew = |seen: &str, mirror: f64, warp: f64| {
        let x = |x: f64| mirror * x;
        let mut corners = vec![
            ("lower", vec![[x(0.0), 0.0]]),
            ("right", vec![[x(2.0), 0.0]]),
            ("upper", vec![[x(1.5), 1.0]]),
            ("left", vec![[x(0.2), 1.0]]),
        ];
        if mirror < 0.0 {
            // Counter-clockwise in the mirrored drawing: each edge begins where it ended.
            let points: Vec<_> = corners.iter().map(|(_, p)| p.clone()).collect();
            corners = vec![
                ("left", points[0].clone()),
                ("upper", points[3].clone()),
                ("right", points[2].clone()),
                ("lower", points[1].clone()),
            ];
        }
        let start = format!(
            "{{ origin_m = [0.0, 0.0, 1.0], x_axis = [{mirror}, 0.0, 0.0], y_axis = [0.0, 1.0, 0.0] }}"
        );
        panel("sheet", &format!("seen_from = \"{seen}\"\nwarp_deg = {warp}"), &corners, &start)
            + "[[hold]]\nedge = \"lower\"\n".replace("lower", "sheet.lower").as_str()
            + "[[hold]]\nedge = \"sheet.right\"\nat = 0.25\n"
    };
    let [a, b] = [("outside", 1.0, 30.0), ("inside", -1.0, 150.0)].map(|(seen, m, w)| {
        let at = if m < 0.0 { "at = 0.75" } else { "at = 0.25" };
        meshed(&skew(seen, m, w).replace("at = 0.25", at), 0.25, None)
    });
    assert_eq!(a.coords.len(), b.coords.len());
    let near = |x: &Point| b.coords.iter().any(|y| (0..3).all(|i| (x[i] - y[i]).abs() < 1e-9));
    assert!(a.coords.iter().all(near));
    let sum = |m: &StructureMesh| m.flat.iter().map(|x| (x[1][0] - x[0][0]).abs().max(0.0)).sum::<f64>();
    assert!(sum(&a) > 0.0 && (volume(&a) / volume(&b) - 1.0).abs() < 1e-9 && volume(&a) > 0.0);
    assert_eq!(
        (a.node_sets["sheet.right"].len(), a.fixed.len()),
        (b.node_sets["sheet.right"].len(), b.fixed.len())
    );
    // The first axis is the warp: at 30 degrees from x in space.
    for m in [&a, &b] {
        for (t, nodes) in m.triangles.iter().enumerate() {
            let x = nodes.map(|n| crate::geometry::at(&m.coords, n));
            for i in 1..3 {
                let warp = Vec3::new(30_f64.to_radians().cos(), 30_f64.to_radians().sin(), 0.0);
                assert!(((x[i] - x[0]).dot(&warp) - (m.flat[t][i][0] - m.flat[t][0][0])).abs() < 1e-9);
            }
        }
    }
}

/// From gores placed a tenth too far apart the relaxation finds a start without tension.
#[test]
fn a_stretched_placement_is_relaxed() {
    let text = conical(8, [0.3, 3.0], 25.0).replace("[[3, 0.0], [0.3,", "[[3.3, 0.0], [0.33,");
    let mesh = meshed(&text, 0.3, Some(5.0));
    assert!(stretches(&mesh)[0] <= 1.0 + 1e-9 && stretches(&mesh)[1] > 0.8, "{:?}", stretches(&mesh));
}

#[test]
fn patterns_that_cannot_be_sewn_are_refused() {
    let good = conical(8, [0.3, 3.0], 25.0);
    let refused = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        error(&good.replace(from, to))
    };
    let says = |text: String, parts: &[&str]| assert!(parts.iter().all(|p| text.contains(p)), "{text}");
    says(refused("copies = 8", "copies = 0"), &["panel \"gore\"", "from 1 to 1000"]);
    says(refused("gore.right\", ", "gore.rigth\", "), &["seam[0]", "gore.rigth", "gore.left"]);
    says(
        refused("next_copy = true", "next_copy = true\n[[seam]]\nedges = [\"gore.left\", \"gore.right\"]"),
        &["gore.left", "seam[0] and seam[1]", "at most two panels"],
    );
    says(refused("next_copy = true", "copies = [0, 8]"), &["seam[0]", "copies 0 to 7"]);
    says(refused("next_copy = true", "copies = [0, 1]"), &["copy 2", "\"gore\"", "[[seam]]"]);
    says(refused("next_copy = true", ""), &["fold panel \"gore\""]);
    says(refused("at = 0", "at = 1.5"), &["attachment[0]", "1.5"]);
    says(refused("at = 0", "at = 0.2345678"), &["attachment[0]", "0.2345678"]);
    says(refused("[[seam]]", "[[sewn]]"), &["unknown field `sewn`", "line"]);
    says(
        refused("meridian_m = [[3, 0.0], [0.3, 1.", "meridian_m = [[0.3, 1.3], [3, 0."),
        &["from below to the crown"],
    );
    says(refused(", turn_deg", ", origin_m = [0.0, 0.0, 0.0], turn_deg"), &["either meridian_m"]);
    let mut clockwise = cylinder(0.5, 1.0);
    for (a, b) in [("lower", "x"), ("upper", "lower"), ("x", "upper")] {
        clockwise = clockwise.replace(a, b);
    }
    let corner = |y: f64| format!("{:.12}, {y:.12}]", PI * 0.5);
    let swapped =
        clockwise.replace(&corner(0.0), "P").replace(&corner(1.0), &corner(0.0)).replace('P', &corner(1.0));
    says(error(&swapped), &["runs clockwise", "3.1416 m2"]);
    let crossed =
        cylinder(0.5, 1.0).replace("[[-1.570796326795, 1.000000000000]]", "[[2.5, 0.5], [-2.0, 0.5]]");
    says(error(&crossed), &["panel \"wall\"", "cross or touch"]);
    says(error(&cylinder(0.02, 1.0)), &["fold panel \"wall\""]);
    let two = gathered(0.0).replace("[[seam]]\nedges = [\"band.upper\", \"sail.lower\"]\n", "");
    says(error(&two), &["copy 0 of panel \"sail\"", "not joined"]);
    let fine = error_of(&good, 1e-3);
    says(fine, &["canopy.element_size_m", "edges of 0.001 m make about", "in metres"]);
    let counts = gathered(0.0).replace("name = \"sail\"", "name = \"sail\"\ncopies = 2");
    says(error(&counts), &["seam[0]", "1 and 2 copies"]);
    says(error(&cylinder(0.5, 1.0).replace("\"wall.left\"", "\"wall.right\"")), &["sewn to itself"]);
}
