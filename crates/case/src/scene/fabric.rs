//! `[fabric]`: its material, what passes through it, and its contact with itself.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::lines::{hysteresis, retardation};
use crate::check::Check;
use crate::materials::required_without_material;
use crate::{Canopy, FabricMaterial, GmshCanopy, Scene, StageKind};

/// Material of the fabric, in plane stress.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(transform = required_without_material)]
pub struct Fabric {
    /// Fabric of the library: it gives the keys of this table that the scene leaves out. Absent: the scene gives them all.
    pub material: Option<FabricMaterial>,
    /// Law between strain and stress.
    #[serde(default)]
    pub law: Law,
    /// Young's modulus ("membrane stiffness"), Pa.
    pub youngs_modulus_pa: f64,
    /// Poisson's ratio.
    pub poisson_ratio: f64,
    /// Thickness, m.
    pub thickness_m: f64,
    /// Density, kg/m3.
    pub density_kg_m3: f64,
    /// Breaking force for each width, N/m. Absent: no safety factor.
    pub strength_n_m: Option<f64>,
    /// Safety factor that the fabric should have: strength over largest force for each width. Absent: 1.
    pub safety_factor: Option<f64>,
    /// Tension field (taut, wrinkled, slack) after Lu, Accorsi and Leonard
    /// (2001). Off: the fabric carries compression.
    #[serde(default)]
    pub wrinkling: bool,
    /// Stress of the fabric in its cut shape, Pa, the same along all directions.
    #[serde(default)]
    pub prestress_pa: f64,
    /// Bending stiffness of the flat cloth, N m: moment for each width over curvature, the B of Kawabata's bending test (1 gf cm2/cm is 9.8e-5 N m; light
    /// nylon cloth has 1e-6 to 1e-5). Absent: fabric bends freely.
    pub bending_stiffness_n_m: Option<f64>,
    /// Share of the work of stretching that a slow cycle from zero along any one strain and back does not return, at most 0.4. Absent: 0, elastic. Each stage
    /// starts as after a first loading; stages with `solve = "static"` have none.
    pub hysteresis: Option<f64>,
    /// As `lines.retardation_time_s`: retardation time (Kelvin-Voigt), s.
    #[serde(default)]
    pub retardation_time_s: f64,
    /// Different stiffness along warp and weft. Absent: isotropic.
    pub orthotropic: Option<Orthotropic>,
    /// Air that passes through. Absent: airtight.
    pub permeability: Option<Permeability>,
    /// Contact with itself. Absent: fabric passes through fabric.
    pub contact: Option<Contact>,
}

/// Laws of the fabric.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Law {
    /// Linear between Green strain and second Piola-Kirchhoff stress: woven fabric.
    #[default]
    StVenantKirchhoff,
    /// Incompressible neo-Hookean: rubber, latex, soft polymer films at large strain. The modulus is
    /// that at small strains.
    NeoHookean,
}

/// A fabric that is stiffer one way: the modulus and the ratio of `[fabric]` are then
/// those of a pull along the first direction (the warp).
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Orthotropic {
    /// Young's modulus across the first direction (along the weft), Pa.
    pub youngs_modulus_2_pa: f64,
    /// Shear modulus in the plane of the fabric, Pa.
    pub shear_modulus_pa: f64,
    /// First direction, laid onto the unstressed fabric. Absent: along the first
    /// edge of each face, that is along the panels of a generated canopy.
    pub direction: Option<[f64; 3]>,
}

/// Fabric that lets air through: the pressure jump is `a v + b v |v|` for air that passes at
/// `v` relative to the fabric. Given in one of four ways: a cloth by name, both coefficients, the air that passes at one
/// pressure, or two measured points.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Permeability {
    /// A common cloth.
    pub cloth: Option<Cloth>,
    /// Viscous coefficient `a`, Pa s/m.
    pub viscous_pa_s_m: Option<f64>,
    /// Inertial coefficient `b`, Pa s2/m2.
    pub inertial_pa_s2_m2: Option<f64>,
    /// Cubic feet of air a minute through a square foot at `at_pressure_pa` (ASTM D737): a = pressure / velocity, b = 0.
    pub cfm_per_ft2: Option<f64>,
    /// Pressure jump of `cfm_per_ft2`, Pa. Absent: 124.5, half an inch of water.
    pub at_pressure_pa: Option<f64>,
    /// Two measured points, each a pressure jump (Pa) and a velocity (m/s): both coefficients.
    pub points: Option<[[f64; 2]; 2]>,
    /// Share of openings in the area, such as the slots of a ribbon or ringslot canopy, that the flow grid does not resolve: a cloth with the pressure loss of
    /// sharp-edged openings. a = 0.
    pub geometric_porosity: Option<f64>,
}

/// Inertial coefficient b (Pa s2/m2) of a cloth with the pressure loss of sharp-edged openings of the share $`\lambda`$ in air of density $`\rho`$ (kg/m3):
/// $`\Delta p = b\, w^2`$ for the velocity w upstream, with the loss coefficient of a thin perforated plate,
/// ```math
/// b = \tfrac12 \rho\, \frac{\left(0.707 \sqrt{1 - \lambda} + 1 - \lambda\right)^2}{\lambda^2}
/// ```
/// (Idelchik, Handbook of Hydraulic Resistance, diagram 8-1; quoted from memory).
fn loss_of_openings(porosity: f64, density: f64) -> f64 {
    let solid = 1.0 - porosity;
    0.5 * density * ((0.707 * solid.sqrt() + solid) / porosity).powi(2)
}

/// Velocity of a cubic foot a minute through a square foot, m/s.
const CFM_PER_FT2: f64 = 0.3048 / 60.0;

/// Half an inch of water, Pa.
const HALF_INCH_OF_WATER: f64 = 124.5;

/// Cloths of parachutes with their permeability at sea level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Cloth {
    /// MIL-C-7020 type III, nylon rip-stop of 1.6 oz/yd2: a = 254 Pa s/m, b = 37.6 Pa s2/m2,
    /// a fit to measurements (weak at low pressure).
    MilC7020Type3,
    /// MIL-C-44378, calendered nylon of low porosity: a = 8170 Pa s/m, b = 0, from its limit
    /// of 3 cubic feet a minute through a square foot at half an inch of water
    /// (0.01524 m/s at 124.5 Pa).
    MilC44378,
}

impl Cloth {
    /// All of them.
    pub const ALL: [Cloth; 2] = [Cloth::MilC7020Type3, Cloth::MilC44378];

    /// Name in a scene.
    pub fn name(self) -> &'static str {
        match self {
            Cloth::MilC7020Type3 => "mil-c7020-type3",
            Cloth::MilC44378 => "mil-c44378",
        }
    }
}

impl Permeability {
    /// Viscous (Pa s/m) and inertial (Pa s2/m2) coefficients in air of `density` (kg/m3), on which only those of a geometric porosity depend; default 0.
    pub fn coefficients(&self, density: f64) -> (f64, f64) {
        if let Some(porosity) = self.geometric_porosity {
            return (0.0, loss_of_openings(porosity, density));
        }
        match (self.cloth, self.cfm_per_ft2, self.points) {
            (Some(Cloth::MilC7020Type3), ..) => (254.0, 37.6),
            (Some(Cloth::MilC44378), ..) => (8170.0, 0.0),
            (_, Some(cfm), _) => (self.pressure_of_cfm() / (cfm * CFM_PER_FT2), 0.0),
            (_, _, Some(points)) => through(points),
            _ => (self.viscous_pa_s_m.unwrap_or(0.0), self.inertial_pa_s2_m2.unwrap_or(0.0)),
        }
    }

    /// Pressure jump at which `cfm_per_ft2` was measured, Pa.
    fn pressure_of_cfm(&self) -> f64 {
        self.at_pressure_pa.unwrap_or(HALF_INCH_OF_WATER)
    }

    /// The ways in which it is given, as the keys of the scene.
    fn ways(&self) -> Vec<&'static str> {
        let coefficients = self.viscous_pa_s_m.is_some() || self.inertial_pa_s2_m2.is_some();
        [
            (self.cloth.is_some(), "cloth"),
            (coefficients, "viscous_pa_s_m and inertial_pa_s2_m2"),
            (self.cfm_per_ft2.is_some(), "cfm_per_ft2"),
            (self.points.is_some(), "points"),
            (self.geometric_porosity.is_some(), "geometric_porosity"),
        ]
        .into_iter()
        .filter_map(|(given, key)| given.then_some(key))
        .collect()
    }
}

/// Coefficients `a` (Pa s/m) and `b` (Pa s2/m2) of the curve `a v + b v^2` through two points of pressure and velocity.
fn through([[p, v], [q, w]]: [[f64; 2]; 2]) -> (f64, f64) {
    let b = (q / w - p / v) / (w - v);
    (p / v - b * v, b)
}

/// Contact of the fabric with itself: nodes keep a distance from faces that they are not part
/// of, and edges from edges that they cross, by a penalty.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Contact {
    /// Distance that is kept, m: well below an edge of the mesh, and far enough that fabric does
    /// not cross it within a step.
    pub distance_m: f64,
    /// Stiffness of a node in contact in shares of the fabric's own (modulus times thickness).
    #[serde(default = "quarter")]
    pub stiffness: f64,
    /// Coefficient of friction. Absent: layers slide without resistance.
    pub friction: Option<f64>,
}

fn quarter() -> f64 {
    0.25
}

/// Gravity on fabric and lines.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FabricGravity {}

impl Fabric {
    /// Smaller of the moduli along warp and weft, Pa.
    pub fn softest_modulus_pa(&self) -> f64 {
        let weft = self.orthotropic.as_ref().map_or(f64::INFINITY, |o| o.youngs_modulus_2_pa);
        weft.min(self.youngs_modulus_pa)
    }
}

impl Fabric {
    /// What a scene without the section `[fabric]` has.
    pub(crate) fn absent() -> Self {
        Self {
            material: None,
            law: Law::default(),
            youngs_modulus_pa: 0.0,
            poisson_ratio: 0.0,
            thickness_m: 0.0,
            density_kg_m3: 0.0,
            strength_n_m: None,
            safety_factor: None,
            wrinkling: false,
            prestress_pa: 0.0,
            bending_stiffness_n_m: None,
            hysteresis: None,
            retardation_time_s: 0.0,
            orthotropic: None,
            permeability: None,
            contact: None,
        }
    }

    /// Whether the scene has no section `[fabric]`.
    pub fn is_absent(&self) -> bool {
        [self.youngs_modulus_pa, self.thickness_m, self.density_kg_m3] == [0.0; 3]
    }
}

/// Refuses invalid materials.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    let f = &scene.fabric;
    if f.is_absent() {
        match &scene.canopy {
            Canopy::None => {}
            Canopy::Gmsh(canopy) => cables_alone(canopy, scene, c),
            _ => c.refuse(
                "fabric",
                "the canopy has no material: the section [fabric] is missing",
                "add [fabric] with a `material` of the library, or with youngs_modulus_pa, poisson_ratio, thickness_m and density_kg_m3",
            ),
        }
        return;
    }
    c.positive("fabric.youngs_modulus_pa", f.youngs_modulus_pa, 1e13, "a modulus in Pa");
    c.above(
        "fabric.poisson_ratio",
        f.poisson_ratio,
        -1.0..=0.5,
        "an isotropic solid has at most 0.5, where plane stress is still regular (it needs |nu| < 1)",
    );
    c.positive(
        "fabric.thickness_m",
        f.thickness_m,
        0.1,
        "a fabric is thinner than 0.1 m: is the value in metres?",
    );
    c.positive("fabric.density_kg_m3", f.density_kg_m3, 30_000.0, "a density in kg/m3");
    c.range(
        "fabric.prestress_pa",
        f.prestress_pa,
        0.0..=0.5 * f.softest_modulus_pa(),
        "at most half the modulus",
    );
    hysteresis("fabric", f.hysteresis, c);
    retardation("fabric", f.retardation_time_s, c);
    if let Some(stiffness) = f.bending_stiffness_n_m {
        let why = "a moment for each width over curvature in N m: light nylon cloth has 1e-6 to 1e-5, a steel sheet of 1 mm 18";
        c.positive("fabric.bending_stiffness_n_m", stiffness, 1e6, why);
    }
    strength(scene, c);
    if f.law == Law::NeoHookean {
        neo_hookean(f, c);
    }
    if let Some(o) = &f.orthotropic {
        orthotropic(o, f, c);
    }
    if let Some(p) = &f.permeability {
        permeability("fabric.permeability", p, scene, c);
    }
    if let Some(k) = &f.contact {
        contact(k, c);
    }
}

/// Refuses what needs fabric in a scene of cables alone.
fn cables_alone(canopy: &GmshCanopy, scene: &Scene, c: &mut Check) {
    let fabric = "add [fabric], if the mesh file has surfaces of fabric";
    if !canopy.fabrics.is_empty() {
        c.refuse(
            "canopy.fabric",
            "keys that a group does not have are those of [fabric], which is missing",
            fabric,
        );
    }
    for (k, s) in scene.stages.iter().enumerate() {
        if !matches!(s.kind, StageKind::PreInflation | StageKind::Trajectory) {
            c.refuse(
                &format!("stage[{k}].kind"),
                format!("stage \"{}\" has air around the fabric, and the scene has no [fabric]", s.name),
                format!("{fabric}, or use kind = \"pre-inflation\": cables under forces, weight and prescribed motions"),
            );
        }
    }
}

/// What the strength of a fabric is.
pub(super) const STRENGTH: &str = "a breaking force for each width in N/m: 1 lb/in is 175 N/m";

fn strength(scene: &Scene, c: &mut Check) {
    let f = &scene.fabric;
    if let Some(strength) = f.strength_n_m {
        c.positive("fabric.strength_n_m", strength, 1e7, STRENGTH);
    }
    let known = f.strength_n_m.is_some() || scene.has_strengths_by_group();
    safety_factor("fabric", f.safety_factor, known, "strength_n_m", c);
}

/// Refuses a safety factor below 1 and one without the strength `key` in the same `section`.
pub(super) fn safety_factor(
    section: &str,
    factor: Option<f64>,
    has_strength: bool,
    key: &str,
    c: &mut Check,
) {
    let Some(factor) = factor else { return };
    let path = format!("{section}.safety_factor");
    c.range(&path, factor, 1.0..=100.0, "strength over largest load: parachutes have 1.5 to 3");
    if !has_strength {
        let help = format!("add `{section}.{key}`, or remove it");
        c.refuse(&path, "a safety factor without a strength has no meaning", help);
    }
}

fn neo_hookean(f: &Fabric, c: &mut Check) {
    let law = "`fabric.law = \"neo-hookean\"`";
    if f.poisson_ratio != 0.5 {
        c.refuse(
            "fabric.poisson_ratio",
            format!("`fabric.poisson_ratio` is {}", f.poisson_ratio),
            format!("{law} keeps its volume: 0.5"),
        );
    }
    if f.orthotropic.is_some() {
        c.refuse(
            "fabric.orthotropic",
            "a neo-Hookean film has no warp",
            format!("leave out this table or {law}"),
        );
    }
    if f.prestress_pa > 0.0 {
        c.refuse(
            "fabric.prestress_pa",
            "the prestress is that of a linear law",
            format!("leave out the prestress or {law}"),
        );
    }
}

fn orthotropic(o: &Orthotropic, f: &Fabric, c: &mut Check) {
    c.positive("fabric.orthotropic.youngs_modulus_2_pa", o.youngs_modulus_2_pa, 1e13, "a modulus in Pa");
    c.positive("fabric.orthotropic.shear_modulus_pa", o.shear_modulus_pa, 1e13, "a modulus in Pa");
    let bound = 0.99 * (f.youngs_modulus_pa / o.youngs_modulus_2_pa).sqrt();
    if f.poisson_ratio.abs() > bound {
        c.refuse(
            "fabric.poisson_ratio",
            format!("`fabric.poisson_ratio` is {}", f.poisson_ratio),
            format!("between these moduli a pull would give energy: at most {bound:.3} either way"),
        );
    }
    if o.direction.is_some_and(|d| d.iter().any(|x| !x.is_finite()) || d == [0.0; 3]) {
        c.refuse(
            "fabric.orthotropic.direction",
            "the direction has no length",
            "name a vector, as [1, 0, 0]",
        );
    }
}

/// Refuses a permeability in the section `at` that no fabric has.
pub(super) fn permeability(at: &str, p: &Permeability, scene: &Scene, c: &mut Check) {
    let ways = p.ways();
    if ways.len() != 1 {
        let kinds =
            ["no", "one", "two kinds of", "three kinds of", "four kinds of", "five kinds of"][ways.len()];
        let given = if ways.is_empty() { String::new() } else { format!(": {}", ways.join(", ")) };
        c.refuse(
            at,
            format!("the fabric has {kinds} permeability{given}"),
            "give one of `cloth`, `viscous_pa_s_m` with `inertial_pa_s2_m2`, `cfm_per_ft2`, `points`, `geometric_porosity`",
        );
    }
    measured(at, p, c);
    let (a, b) = p.coefficients(scene.flow.as_ref().map_or(1.0, |f| f.density_kg_m3));
    for (key, value) in [("viscous_pa_s_m", p.viscous_pa_s_m), ("inertial_pa_s2_m2", p.inertial_pa_s2_m2)] {
        // Infinity is an airtight fabric.
        if let Some(value) = value.filter(|v| v.is_nan() || *v < 0.0) {
            c.refuse(&format!("{at}.{key}"), format!("`{key}` is {value}"), "0 or more");
        }
    }
    if ways.len() == 1 && a == 0.0 && b == 0.0 {
        c.refuse(at, "a fabric without resistance is no fabric", "one coefficient must be above 0");
    }
    if scene.flow.is_none() {
        c.refuse(
            at,
            "air passes the fabric, but the scene has no flow",
            "remove it, or add a [flow] section: a pre-inflation knows its pressure without air",
        );
    }
}

/// Refuses measured values that no fabric has.
fn measured(at: &str, p: &Permeability, c: &mut Check) {
    if let Some(cfm) = p.cfm_per_ft2 {
        let why = "cubic feet a minute through a square foot; an airtight cloth has no permeability";
        c.positive(&format!("{at}.cfm_per_ft2"), cfm, 5000.0, why);
    }
    if let Some(pressure) = p.at_pressure_pa {
        let path = format!("{at}.at_pressure_pa");
        c.positive(&path, pressure, 1e5, "a pressure jump in Pa: half an inch of water is 124.5 Pa");
        if p.cfm_per_ft2.is_none() {
            c.refuse(
                &path,
                "a pressure without the air that passes at it",
                "add `cfm_per_ft2`, or remove it",
            );
        }
    }
    if let Some(porosity) = p.geometric_porosity {
        let what =
            "the share of openings in the area: a ribbon canopy has 0.15 to 0.35, a ringslot 0.1 to 0.2";
        c.range(&format!("{at}.geometric_porosity"), porosity, 1e-3..=0.9, what);
    }
    let Some(points) = p.points else { return };
    let path = format!("{at}.points");
    if points.as_flattened().iter().any(|x| !(*x > 0.0 && x.is_finite())) || points[0][1] == points[1][1] {
        c.refuse(
            &path,
            format!("two points {points:?} that do not determine a curve"),
            "give two pairs of pressure (Pa) and velocity (m/s), all above 0, at different velocities",
        );
        return;
    }
    let (a, b) = through(points);
    if a < 0.0 || b < 0.0 {
        c.refuse(
            &path,
            format!("through the points {points:?} pass a = {a:.4e} Pa s/m and b = {b:.4e} Pa s2/m2"),
            "no coefficient may be below 0: the pressure grows at least as the velocity and at most as its square; check the order [pressure_pa, \
             velocity_m_s], or give one point as `cfm_per_ft2`",
        );
    }
}

fn contact(k: &Contact, c: &mut Check) {
    c.positive(
        "fabric.contact.distance_m",
        k.distance_m,
        1.0,
        "a distance in metres, below an edge of the mesh",
    );
    c.positive("fabric.contact.stiffness", k.stiffness, 100.0, "in shares of the fabric's own");
    if let Some(friction) = k.friction {
        c.positive(
            "fabric.contact.friction",
            friction,
            2.0,
            "a coefficient of friction: woven nylon on itself has 0.2 to 0.4",
        );
    }
}
