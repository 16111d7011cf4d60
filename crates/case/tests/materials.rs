//! `material` of `[fabric]`, `[lines]`, `[risers]` and `[tapes]`, strengths, and the units of permeability.

use std::path::Path;

use case::materials::{Entry, Source};
use case::{FabricMaterial, LineMaterial, Permeability, RiserMaterial, Scene, SceneError, TapeMaterial};

const ATPS: &str = include_str!("../../../cases/atps-descent/scene.toml");
const FABRIC: &str = "youngs_modulus_pa = 9.5648e6\npoisson_ratio = 0.3          # not given in the paper\nthickness_m = 3.048e-5\n\
                      density_kg_m3 = 1223.5093\nwrinkling = true\n";
const LINES: &str = "youngs_modulus_pa = 5.3420e8\narea_m2 = 3.11e-6\ndensity_kg_m3 = 1223.50932\n";

fn read(text: &str) -> Result<Scene, SceneError> {
    case::parse(Path::new("scene.toml"), text)
}

/// The ATPS with these keys of fabric and lines and further tables.
fn atps(fabric: &str, lines: &str, more: &str) -> Result<Scene, String> {
    assert!(ATPS.contains(FABRIC) && ATPS.contains(LINES), "the scene has other materials");
    let text = ATPS.replacen(FABRIC, &format!("{fabric}\n"), 1).replacen(LINES, &format!("{lines}\n"), 1);
    read(&format!("{text}\n{more}")).map_err(|e| e.to_string())
}

fn scene(fabric: &str, lines: &str, more: &str) -> Scene {
    atps(fabric, lines, more).unwrap_or_else(|e| panic!("{e}"))
}

fn refused(fabric: &str, lines: &str, more: &str) -> String {
    atps(fabric, lines, more).expect_err("this scene should be refused")
}

fn near(a: f64, b: f64, tolerance: f64) -> bool {
    (a - b).abs() <= tolerance * b.abs()
}

#[test]
fn every_entry_is_a_valid_material() {
    for material in FabricMaterial::ALL {
        let scene = scene(&format!("material = \"{}\"", material.name()), LINES, "");
        let (f, entry) = (&scene.fabric, material.entry());
        assert_eq!(f.material, Some(material));
        assert_eq!(Some(f.youngs_modulus_pa), entry.get("youngs_modulus_pa"));
        assert_eq!(
            (Some(f.thickness_m), f.strength_n_m),
            (entry.get("thickness_m"), entry.get("strength_n_m"))
        );
        let passes = entry.values.iter().any(|v| v.key.starts_with("permeability"));
        assert!(f.wrinkling && f.permeability.is_some() == passes, "{}", entry.name);
    }
    for material in LineMaterial::ALL {
        let section = format!("material = \"{}\"", material.name());
        let scene = scene(FABRIC, &section, &format!("[risers]\n{section}\n"));
        let (l, r) = (scene.lines.as_ref().expect("lines"), scene.risers.as_ref().expect("risers"));
        assert_eq!((l.material, r.material), (Some(material), Some(RiserMaterial::Line(material))));
        assert_eq!(l.strength_n, r.strength_n);
        assert!(near(r.axial_stiffness_n, l.youngs_modulus_pa * l.area_m2, 1e-3), "{r:?}");
        assert!(near(r.mass_kg_m, l.density_kg_m3 * l.area_m2, 1e-3), "{r:?}");
    }
}

/// Names in a scene, in the table and in the schema agree, and each value has a source or follows from others.
#[test]
fn entries_are_complete() {
    let complete = |entry: &Entry, name: &str, written: String, needed: &[&str]| {
        assert_eq!((entry.name, written), (name, format!("\"{name}\"")));
        assert!(!entry.title.is_empty());
        for key in needed {
            assert!(entry.get(key).is_some_and(|v| v > 0.0), "{name}: {key}");
        }
        for value in &entry.values {
            let published = value.source.is_some_and(|s| s != Source::Paper);
            assert_eq!(published, !value.figure.is_empty(), "{name}: {value:?}");
        }
    };
    for m in FabricMaterial::ALL {
        let needed = ["youngs_modulus_pa", "poisson_ratio", "thickness_m", "density_kg_m3"];
        complete(&m.entry(), m.name(), serde_json::to_string(&m).expect("JSON"), &needed);
    }
    for m in LineMaterial::ALL {
        let needed = ["youngs_modulus_pa", "area_m2", "density_kg_m3"];
        complete(&m.entry(), m.name(), serde_json::to_string(&m).expect("JSON"), &needed);
    }
    for m in TapeMaterial::ALL {
        let needed = ["axial_stiffness_n", "mass_kg_m", "strength_n"];
        complete(&m.entry(), m.name(), serde_json::to_string(&m).expect("JSON"), &needed);
    }
}

/// Every tape gives stiffness and mass to tapes at all places, and strength too to risers; other keys stay those of the scene.
#[test]
fn tapes_and_webbings_give_tapes_and_risers() {
    for material in TapeMaterial::ALL {
        let name = format!("material = \"{}\"\n", material.name());
        let tapes = format!(
            "[tapes.hem]\n{name}[tapes.vents]\n{name}mass_kg_m = 0.5\n[tapes.grid]\n{name}spacing_m = 0.3\n"
        );
        let scene = scene(FABRIC, LINES, &format!("{tapes}[risers]\n{name}"));
        let (t, r) = (scene.tapes.as_ref().expect("tapes"), scene.risers.as_ref().expect("risers"));
        let (entry, hem, vents, grid) =
            (material.entry(), t.hem.expect("a hem"), t.vents.expect("vents"), t.grid.expect("a grid"));
        let (stiffness, mass) = (entry.get("axial_stiffness_n"), entry.get("mass_kg_m"));
        assert_eq!(
            (hem.material, Some(hem.axial_stiffness_n), Some(hem.mass_kg_m)),
            (Some(material), stiffness, mass)
        );
        assert_eq!((Some(vents.axial_stiffness_n), vents.mass_kg_m), (stiffness, 0.5));
        assert_eq!(
            (Some(grid.axial_stiffness_n), Some(grid.mass_kg_m), grid.spacing_m),
            (stiffness, mass, 0.3)
        );
        assert_eq!(r.material, Some(RiserMaterial::Webbing(material)));
        assert_eq!((Some(r.axial_stiffness_n), Some(r.mass_kg_m)), (stiffness, mass));
        assert!(r.strength_n.is_some() && r.strength_n == entry.get("strength_n"));
        let again = read(&toml::to_string(&scene).expect("TOML")).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!((again.tapes, again.risers), (scene.tapes, scene.risers));
    }
    let without_spacing = refused(FABRIC, LINES, "[tapes.grid]\nmaterial = \"mil-t8363-type1\"\n");
    assert!(without_spacing.contains("spacing_m"), "{without_spacing}");
    let without_mass = refused(FABRIC, LINES, "[tapes.hem]\naxial_stiffness_n = 1e4\n");
    assert!(without_mass.contains("mass_kg_m"), "{without_mass}");
    let a_line = refused(FABRIC, LINES, "[tapes.hem]\nmaterial = \"pia-c5040-type3\"\n");
    assert!(a_line.contains("`tapes.hem.material` is \"pia-c5040-type3\", which does not exist"), "{a_line}");
    let misspelt = refused(FABRIC, LINES, "[risers]\nmaterial = \"pia-w1100-type12\"\n");
    assert!(
        misspelt.contains("one of: pia-c5040-type1, ") && misspelt.contains("pia-w1100-type13"),
        "{misspelt}"
    );
}

/// Values of the specifications, by hand: 1 oz/yd2 = 33.906 g/m2, 1 lb/in = 175.13 N/m, 1 lb = 4.4482 N, 225 ft/lb = 6.614 g/m.
#[test]
fn published_units_are_converted() {
    let f = FabricMaterial::PiaC44378Type4.entry();
    let get = |key: &str| f.get(key).expect("a value");
    assert!(near(get("thickness_m") * get("density_kg_m3"), 1.2 * 0.033906, 1e-3));
    assert!(near(get("strength_n_m"), 7880.7, 1e-3));
    // 7880.7 N/m at 20 %: 39 404 N/m for a strain of 1.
    assert!(near(get("youngs_modulus_pa") * get("thickness_m"), 39_404.0, 2e-3));
    let l = LineMaterial::PiaC5040Type3.entry();
    let get = |key: &str| l.get(key).expect("a value");
    assert!(near(get("strength_n"), 2446.5, 1e-3));
    assert!(near(get("area_m2") * get("density_kg_m3"), 6.614e-3, 1e-3));
    assert!(near(get("youngs_modulus_pa") * get("area_m2"), 2446.5 / 0.3, 2e-3));
    // 725 lb at 1.479 N/tex.
    let s = LineMaterial::Spectra725.entry();
    let get = |key: &str| s.get(key).expect("a value");
    assert!(near(get("area_m2") * get("density_kg_m3"), 3224.96 / 1.479e6, 1e-3));
    // 1.62 oz/yd are 50.23 g/m; 4000 lb at 20 %.
    let t = TapeMaterial::PiaW4088Type8.entry();
    let get = |key: &str| t.get(key).expect("a value");
    assert!(near(get("mass_kg_m"), 0.05023, 1e-3) && near(get("axial_stiffness_n"), 88_964.0, 1e-3));
    // 7000 lb at 0.346 N/tex: 90 g/m, 2.90 oz/yd.
    let t = TapeMaterial::PiaW1100Type13.entry();
    assert!(near(t.get("mass_kg_m").expect("a mass"), 2.90 * 0.031_003, 2e-3));
}

#[test]
fn the_papers_entries_are_those_of_its_case() {
    let (from_library, case) =
        (scene("material = \"atps-paper\"", "material = \"atps-paper\"", ""), read(ATPS).expect("a scene"));
    let text = |s: &Scene| toml::to_string(s).expect("TOML").replace("material = \"atps-paper\"\n", "");
    assert_eq!(text(&from_library), text(&case));
}

#[test]
fn keys_of_the_scene_have_priority() {
    let fabric =
        "material = \"pia-c7020-type1\"\nthickness_m = 4e-5\nwrinkling = false\nstrength_n_m = 6000.0";
    let given = scene(&format!("{fabric}\n[fabric.permeability]\ncfm_per_ft2 = 90.0"), LINES, "");
    let (f, entry) = (&given.fabric, FabricMaterial::PiaC7020Type1.entry());
    assert_eq!((f.thickness_m, f.wrinkling, f.strength_n_m), (4e-5, false, Some(6000.0)));
    assert_eq!(f.permeability.as_ref().and_then(|p| p.cfm_per_ft2), Some(90.0));
    assert_eq!(Some(f.density_kg_m3), entry.get("density_kg_m3"));
    let lines = scene(FABRIC, "material = \"dacron-600\"\nstrength_n = 2000.0", "").lines.expect("lines");
    let entry = LineMaterial::Dacron600.entry();
    assert_eq!((lines.strength_n, Some(lines.area_m2)), (Some(2000.0), entry.get("area_m2")));
    // A scene that was read and written is the same scene.
    let again = read(&toml::to_string(&given).expect("TOML")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(toml::to_string(&again).expect("TOML"), toml::to_string(&given).expect("TOML"));
}

/// Without a flow no air passes: the library adds no permeability, which such a scene is not allowed to have.
#[test]
fn permeability_is_added_only_where_air_flows() {
    let still = "name = \"still\"\n[canopy]\nkind = \"air-bag\"\n[fabric]\nmaterial = \"f-111\"\n[[stage]]\nname = \"on\"\n\
                 kind = \"pre-inflation\"\npressure_pa = 10\nsolve = \"static\"\n";
    assert_eq!(read(still).unwrap_or_else(|e| panic!("{e}")).fabric.permeability, None);
}

#[test]
fn unknown_names_and_values_out_of_range_are_refused_with_their_place() {
    let error = refused("material = \"pia-c7020-typ3\"", LINES, "");
    assert!(
        error.contains("scene.toml:17:12: `fabric.material` is \"pia-c7020-typ3\", which does not exist"),
        "{error}"
    );
    assert!(error.contains("did you mean \"pia-c7020-type3\"? one of: pia-c7020-type1, "), "{error}");
    assert!(!error.contains("missing key"), "{error}");
    let error = refused(FABRIC, "material = \"steel-wire-cable\"", "");
    assert!(error.contains("one of: pia-c5040-type1, ") && error.contains("atps-paper"), "{error}");
    // The library gives no second axis; its Poisson's ratio is that of no neo-Hookean film.
    let error = refused("material = \"f-111\"\nlaw = \"neo-hookean\"", LINES, "");
    assert!(error.contains("scene.toml:17:12: `fabric.poisson_ratio` is 0.3"), "{error}");
    let risers = "[risers]\naxial_stiffness_n = 1e4\nmass_kg_m = 0.01\n";
    for (fabric, lines, more, message) in [
        ("strength_n_m = -1.0", "", "", "`fabric.strength_n_m` is -1"),
        ("", "strength_n = 0.0", "", "`lines.strength_n` is 0"),
        ("", "", "strength_n = 1e9", "`risers.strength_n` is 1000000000"),
        ("", "strength_n = 100.0\nsafety_factor = 0.5", "", "`lines.safety_factor` is 0.5"),
        ("safety_factor = 2.0", "", "", "add `fabric.strength_n_m`, or remove it"),
        ("", "safety_factor = 2.0", "", "add `lines.strength_n`, or remove it"),
        ("", "", "safety_factor = 2.0", "add `risers.strength_n`, or remove it"),
    ] {
        let error =
            refused(&format!("{FABRIC}{fabric}"), &format!("{LINES}{lines}"), &format!("{risers}{more}"));
        assert!(error.contains(message), "{message}: {error}");
    }
}

fn permeability(keys: &str) -> Result<Permeability, String> {
    let scene = atps(&format!("{FABRIC}[fabric.permeability]\n{keys}"), LINES, "")?;
    Ok(scene.fabric.permeability.expect("permeability"))
}

/// ASTM D737: 3 cfm/ft2 are 0.01524 m/s, at 124.5 Pa.
#[test]
fn air_at_one_pressure_gives_the_viscous_coefficient() {
    let (a, b) = permeability("cfm_per_ft2 = 3.0").expect("a scene").coefficients(1.225);
    assert!(near(a, 124.5 / 0.01524, 1e-12) && b == 0.0, "{a} {b}");
    assert!(near(a, 8169.29, 1e-6));
    // 20 inches of water.
    let (a, _) =
        permeability("cfm_per_ft2 = 400.0\nat_pressure_pa = 4982.0").expect("a scene").coefficients(1.225);
    assert!(near(a, 4982.0 / 2.032, 1e-12), "{a}");
}

/// The worked example of 20 % openings at sea level: 32 Pa at 1 m/s. The loss is that of the air's density and falls with the porosity.
#[test]
fn geometric_porosity_is_a_pressure_loss() {
    let open = |share: f64| permeability(&format!("geometric_porosity = {share}")).expect("a scene");
    let by_hand = 0.6125 * (0.707 * 0.894_427_19 + 0.8_f64).powi(2) / 0.04;
    let (a, b) = open(0.2).coefficients(1.225);
    assert!(a == 0.0 && (b / by_hand - 1.0).abs() < 1e-8, "{b} {by_hand}");
    assert!((open(0.2).coefficients(2.45).1 / b - 2.0).abs() < 1e-12);
    assert!(open(0.1).coefficients(1.225).1 > b && open(0.5).coefficients(1.225).1 < b);
    let error = permeability("geometric_porosity = 20.0").expect_err("a percentage");
    assert!(error.contains("the share of openings"), "{error}");
    let two = permeability("geometric_porosity = 0.2\ncfm_per_ft2 = 100.0").expect_err("two ways");
    assert!(two.contains("two kinds of permeability: cfm_per_ft2, geometric_porosity"), "{two}");
}

#[test]
fn two_points_give_both_coefficients() {
    // By a = 254 and b = 37.6: 65.85 Pa at 0.25 m/s, 658.4 Pa at 2 m/s.
    let points = |text: &str| permeability(&format!("points = {text}"));
    let (a, b) = points("[[65.85, 0.25], [658.4, 2.0]]").expect("a scene").coefficients(1.225);
    assert!(near(a, 254.0, 1e-9) && near(b, 37.6, 1e-9), "{a} {b}");
    let (c, d) = points("[[658.4, 2.0], [65.85, 0.25]]").expect("a scene").coefficients(1.225);
    assert!(near(c, a, 1e-12) && near(d, b, 1e-12));
    // 100 Pa at 1 m/s, 150 at 2: b = (75 - 100) / 1, a = 125. 100 at 1, 500 at 2: b = 150, a = -50.
    let error = points("[[100, 1], [150, 2]]").expect_err("b below 0");
    assert!(error.contains("a = 1.2500e2 Pa s/m and b = -2.5000e1 Pa s2/m2"), "{error}");
    let error = points("[[100, 1], [500, 2]]").expect_err("a below 0");
    assert!(error.contains("a = -5.0000e1 Pa s/m and b = 1.5000e2 Pa s2/m2"), "{error}");
    assert!(error.contains("check the order [pressure_pa, velocity_m_s]"), "{error}");
    for wrong in ["[[100, 1], [200, 1]]", "[[0, 1], [200, 2]]", "[[100, -1], [200, 2]]"] {
        let error = points(wrong).expect_err(wrong);
        assert!(error.contains("do not determine a curve"), "{wrong}: {error}");
    }
    assert!(points("[[100, 1]]").is_err());
}

#[test]
fn permeability_is_given_in_exactly_one_way() {
    for (keys, message) in [
        ("", "the fabric has no permeability"),
        ("cloth = \"mil-c44378\"\ncfm_per_ft2 = 3.0", "two kinds of permeability: cloth, cfm_per_ft2"),
        ("viscous_pa_s_m = 3.0\npoints = [[1, 1], [2, 2]]", "two kinds of permeability"),
        ("cfm_per_ft2 = 3.0\nviscous_pa_s_m = 3.0\npoints = [[1, 1], [2, 2]]", "three kinds of permeability"),
        ("cloth = \"mil-c44378\"\nat_pressure_pa = 100.0", "add `cfm_per_ft2`, or remove it"),
        ("cfm_per_ft2 = 0.0", "`fabric.permeability.cfm_per_ft2` is 0"),
        ("cfm_per_ft2 = 3.0\nat_pressure_pa = 0.0", "`fabric.permeability.at_pressure_pa` is 0"),
    ] {
        let error = permeability(keys).expect_err(keys);
        assert!(error.contains(message), "{keys}: {error}");
    }
}

/// A plate from a Gmsh file in air, with these groups of cloth and keys of `[fabric]`.
fn plate(groups: &str, fabric: &str) -> Scene {
    const PLATE: &str = include_str!("../../../cases/plate-gmsh/scene.toml");
    let text = PLATE.replacen("\n[fabric]\n", &format!("\n{groups}\n[fabric]\n{fabric}\n"), 1);
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../cases/plate-gmsh/scene.toml");
    case::parse(&file, &text).unwrap_or_else(|e| panic!("{e}"))
}

/// A group has what the library says of its material, its own keys before that, and nothing of the other cloth that the library does not know.
#[test]
fn group_of_a_mesh_file_has_its_own_material() {
    let [known, unknown] = [true, false].map(|passes| {
        let has = |m: &FabricMaterial| m.entry().values.iter().any(|v| v.key.starts_with("permeability"));
        FabricMaterial::ALL.into_iter().find(|m| has(m) == passes).expect("both kinds")
    });
    let groups = format!(
        "[[canopy.fabric]]\ngroup = \"a\"\nmaterial = \"{}\"\nthickness_m = 9e-5\n[[canopy.fabric]]\ngroup = \"b\"\nmaterial = \"{}\"\n\
         [[canopy.fabric]]\ngroup = \"c\"\ndensity_kg_m3 = 900.0\n",
        known.name(),
        unknown.name()
    );
    let fabric = "strength_n_m = 1234.0\npermeability = { cfm_per_ft2 = 77.0 }\n\
                  orthotropic = { youngs_modulus_2_pa = 1e8, shear_modulus_pa = 1e6 }";
    let scene = plate(&groups, fabric);
    let [a, b, c] = [0, 1, 2].map(|k| scene.fabric_of(Some(k)));
    let entry = known.entry();
    assert_eq!(Some(a.youngs_modulus_pa), entry.get("youngs_modulus_pa"));
    assert_eq!((a.thickness_m, a.strength_n_m), (9e-5, entry.get("strength_n_m")));
    assert!(a.permeability.is_some() && a.permeability != scene.fabric.permeability, "{a:?}");
    assert_eq!((b.permeability.as_ref(), b.strength_n_m), (None, unknown.entry().get("strength_n_m")));
    let bias = |f: &case::Fabric| {
        let o = f.orthotropic.as_ref().expect("warp and weft");
        [o.youngs_modulus_2_pa, o.shear_modulus_pa]
    };
    for f in [&a, &b] {
        let isotropic = [f.youngs_modulus_pa, 0.5 * f.youngs_modulus_pa / (1.0 + f.poisson_ratio)];
        assert_eq!(bias(f), isotropic);
    }
    assert_eq!((c.density_kg_m3, bias(&c)), (900.0, [1e8, 1e6]));
    assert_eq!((c.strength_n_m, &c.permeability), (Some(1234.0), &scene.fabric.permeability));
    assert!(scene.has_permeable_groups() && scene.has_strengths_by_group());
    // What equals [fabric] is no cloth of its own.
    let same = plate("[[canopy.fabric]]\ngroup = \"c\"\nstrength_n_m = 1234.0\n", fabric);
    assert!(!same.has_permeable_groups() && !same.has_strengths_by_group() && same.has_permeable_fabric());
}
