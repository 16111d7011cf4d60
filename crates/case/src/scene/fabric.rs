//! `[fabric]`: its material, what passes through it, and its contact with itself.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::Scene;
use crate::check::Check;

/// Material of the fabric, in plane stress.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fabric {
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
    /// Tension field (taut, wrinkled, slack) after Lu, Accorsi and Leonard
    /// (2001). Off: the fabric carries compression.
    #[serde(default)]
    pub wrinkling: bool,
    /// Stress of the fabric in its cut shape, Pa, the same along all directions.
    #[serde(default)]
    pub prestress_pa: f64,
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
/// `v` relative to the fabric. Either a cloth by name or both coefficients.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Permeability {
    /// A common cloth.
    pub cloth: Option<Cloth>,
    /// Viscous coefficient `a`, Pa s/m.
    pub viscous_pa_s_m: Option<f64>,
    /// Inertial coefficient `b`, Pa s2/m2.
    pub inertial_pa_s2_m2: Option<f64>,
}

/// Cloths of parachutes with their permeability at sea level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Cloth {
    /// MIL-C-7020 type III, nylon rip-stop of 1.1 oz/yd2: a = 254 Pa s/m, b = 37.6 Pa s2/m2,
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
    /// Viscous (Pa s/m) and inertial (Pa s2/m2) coefficients; default 0.
    pub fn coefficients(&self) -> (f64, f64) {
        match self.cloth {
            Some(Cloth::MilC7020Type3) => (254.0, 37.6),
            Some(Cloth::MilC44378) => (8170.0, 0.0),
            None => (self.viscous_pa_s_m.unwrap_or(0.0), self.inertial_pa_s2_m2.unwrap_or(0.0)),
        }
    }
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
            law: Law::default(),
            youngs_modulus_pa: 0.0,
            poisson_ratio: 0.0,
            thickness_m: 0.0,
            density_kg_m3: 0.0,
            wrinkling: false,
            prestress_pa: 0.0,
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
        if scene.has_canopy() {
            c.refuse(
                "fabric",
                "the canopy has no material: the section [fabric] is missing",
                "add [fabric] with youngs_modulus_pa, poisson_ratio, thickness_m and density_kg_m3",
            );
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
    if f.law == Law::NeoHookean {
        neo_hookean(f, c);
    }
    if let Some(o) = &f.orthotropic {
        orthotropic(o, f, c);
    }
    if let Some(p) = &f.permeability {
        permeability(p, scene, c);
    }
    if let Some(k) = &f.contact {
        contact(k, c);
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

fn permeability(p: &Permeability, scene: &Scene, c: &mut Check) {
    let at = "fabric.permeability";
    let given = p.viscous_pa_s_m.is_some() || p.inertial_pa_s2_m2.is_some();
    if given == p.cloth.is_some() {
        c.refuse(
            at,
            format!("the fabric has {} permeability", if given { "two kinds of" } else { "no" }),
            "give either `cloth` or `viscous_pa_s_m` and `inertial_pa_s2_m2`",
        );
    }
    let (a, b) = p.coefficients();
    for (key, value) in [("viscous_pa_s_m", a), ("inertial_pa_s2_m2", b)] {
        // Infinity is an airtight fabric.
        if value.is_nan() || value < 0.0 {
            c.refuse(&format!("{at}.{key}"), format!("`{key}` is {value}"), "0 or more");
        }
    }
    if given && a == 0.0 && b == 0.0 {
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
