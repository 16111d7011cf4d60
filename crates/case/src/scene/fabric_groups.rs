//! `[[canopy.fabric]]`: kinds of cloth in a mesh file, by its physical groups.

use std::borrow::Cow;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fabric;
use crate::check::Check;
use crate::{Canopy, Fabric, FabricMaterial, Law, Permeability, Scene};

/// Fabric of a physical group of surfaces of the mesh file, with a cloth of its own. A key that is left out is that of `[fabric]`, and so is all that has no
/// key here: law, wrinkling, prestress, bending, damping, hysteresis, contact. Surfaces of a group that is not listed are `[fabric]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FabricGroup {
    /// Name of the physical group.
    pub group: String,
    /// Fabric of the library: it gives the keys of this table that the scene leaves out; where the library has no strength or permeability of it, the group has
    /// none, and weft and bias follow from its own modulus and ratio. Absent: those of `[fabric]`.
    pub material: Option<FabricMaterial>,
    /// Thickness, m. Absent: `fabric.thickness_m`.
    pub thickness_m: Option<f64>,
    /// Density, kg/m3. Absent: `fabric.density_kg_m3`.
    pub density_kg_m3: Option<f64>,
    /// Young's modulus, Pa; of an orthotropic fabric that along the warp. Absent: `fabric.youngs_modulus_pa`.
    pub youngs_modulus_pa: Option<f64>,
    /// Poisson's ratio. Absent: `fabric.poisson_ratio`.
    pub poisson_ratio: Option<f64>,
    /// Young's modulus along the weft, Pa, in a scene with `[fabric.orthotropic]`. Absent: that of this section.
    pub youngs_modulus_2_pa: Option<f64>,
    /// Shear modulus, Pa, in a scene with `[fabric.orthotropic]`. Absent: that of this section.
    pub shear_modulus_pa: Option<f64>,
    /// Breaking force for each width, N/m. Absent: that of `material`, else `fabric.strength_n_m`.
    pub strength_n_m: Option<f64>,
    /// Air that passes through. Absent: that of `material`, else `[fabric.permeability]`. A group that is airtight where `[fabric]` is not has `viscous_pa_s_m = inf`.
    pub permeability: Option<Permeability>,
}

impl FabricGroup {
    /// `fabric` with the keys of the group.
    fn of(&self, fabric: &Fabric) -> Fabric {
        let mut own = fabric.clone();
        own.thickness_m = self.thickness_m.unwrap_or(own.thickness_m);
        own.density_kg_m3 = self.density_kg_m3.unwrap_or(own.density_kg_m3);
        own.youngs_modulus_pa = self.youngs_modulus_pa.unwrap_or(own.youngs_modulus_pa);
        own.poisson_ratio = self.poisson_ratio.unwrap_or(own.poisson_ratio);
        if self.material.is_some() {
            // What the library does not know of this cloth is not that of another one.
            (own.strength_n_m, own.permeability) = (None, None);
            if let Some(o) = &mut own.orthotropic {
                o.youngs_modulus_2_pa = own.youngs_modulus_pa;
                o.shear_modulus_pa = 0.5 * own.youngs_modulus_pa / (1.0 + own.poisson_ratio);
            }
        }
        if let Some(o) = &mut own.orthotropic {
            o.youngs_modulus_2_pa = self.youngs_modulus_2_pa.unwrap_or(o.youngs_modulus_2_pa);
            o.shear_modulus_pa = self.shear_modulus_pa.unwrap_or(o.shear_modulus_pa);
        }
        own.strength_n_m = self.strength_n_m.or(own.strength_n_m);
        own.permeability = self.permeability.clone().or(own.permeability);
        own
    }
}

impl Scene {
    /// Kinds of cloth that the scene names for groups of a mesh file.
    pub fn fabric_groups(&self) -> &[FabricGroup] {
        match &self.canopy {
            Canopy::Gmsh(g) => &g.fabrics,
            _ => &[],
        }
    }

    /// Whether air passes through any fabric.
    pub fn has_permeable_fabric(&self) -> bool {
        self.fabric.permeability.is_some() || self.has_permeable_groups()
    }

    /// Whether groups of a mesh file have another permeability than `[fabric]`.
    pub fn has_permeable_groups(&self) -> bool {
        self.fabric_groups().iter().any(|g| g.of(&self.fabric).permeability != self.fabric.permeability)
    }

    /// Makes all fabric airtight.
    pub fn make_airtight(&mut self) {
        self.fabric.permeability = None;
        if let Canopy::Gmsh(canopy) = &mut self.canopy {
            canopy.fabrics.iter_mut().for_each(|g| g.permeability = None);
        }
    }

    /// Whether groups of a mesh file have another strength than `[fabric]`, or none where it has one.
    pub fn has_strengths_by_group(&self) -> bool {
        self.fabric_groups().iter().any(|g| g.of(&self.fabric).strength_n_m != self.fabric.strength_n_m)
    }

    /// Fabric of the group at place `group` among [`Scene::fabric_groups`]; `[fabric]` without one.
    pub fn fabric_of(&self, group: Option<u16>) -> Cow<'_, Fabric> {
        match group.and_then(|k| self.fabric_groups().get(usize::from(k))) {
            Some(g) => Cow::Owned(g.of(&self.fabric)),
            None => Cow::Borrowed(&self.fabric),
        }
    }
}

/// Refuses cloth that no fabric is, and groups that are listed twice.
pub(super) fn check(groups: &[FabricGroup], scene: &Scene, c: &mut Check) {
    for (k, g) in groups.iter().enumerate() {
        let key = |name: &str| format!("canopy.fabric[{k}].{name}");
        if g.group.is_empty() || groups[..k].iter().any(|other| other.group == g.group) {
            c.refuse(
                &key("group"),
                format!("the physical group \"{}\" has no name, or is listed twice", g.group),
                "name each group of surfaces once",
            );
        }
        let thin = "a fabric is thinner than 0.1 m: is the value in metres?";
        for (name, value, most, why) in [
            ("thickness_m", g.thickness_m, 0.1, thin),
            ("density_kg_m3", g.density_kg_m3, 30_000.0, "a density in kg/m3"),
            ("youngs_modulus_pa", g.youngs_modulus_pa, 1e13, "a modulus in Pa"),
            ("youngs_modulus_2_pa", g.youngs_modulus_2_pa, 1e13, "a modulus in Pa"),
            ("shear_modulus_pa", g.shear_modulus_pa, 1e13, "a modulus in Pa"),
        ] {
            value.iter().for_each(|v| c.positive(&key(name), *v, most, why));
        }
        if let Some(strength) = g.strength_n_m {
            c.positive(&key("strength_n_m"), strength, 1e7, fabric::STRENGTH);
        }
        if let Some(p) = &g.permeability {
            fabric::permeability(&key("permeability"), p, scene, c);
        }
        ratio(g, scene, &key("poisson_ratio"), c);
        if scene.fabric.orthotropic.is_none()
            && (g.youngs_modulus_2_pa.is_some() || g.shear_modulus_pa.is_some())
        {
            c.refuse(
                &key(if g.youngs_modulus_2_pa.is_some() {
                    "youngs_modulus_2_pa"
                } else {
                    "shear_modulus_pa"
                }),
                "the fabric has no warp and weft",
                "remove it, or add [fabric.orthotropic]",
            );
        }
        let softest = g.of(&scene.fabric).softest_modulus_pa();
        if scene.fabric.prestress_pa > 0.5 * softest {
            c.refuse(
                &key("youngs_modulus_pa"),
                format!(
                    "the prestress of {} Pa is more than half the modulus of {softest} Pa",
                    scene.fabric.prestress_pa
                ),
                "lower fabric.prestress_pa, which all groups have, or give a stiffer cloth",
            );
        }
    }
}

/// Refuses a Poisson's ratio with which the cloth of the group would give energy.
fn ratio(g: &FabricGroup, scene: &Scene, key: &str, c: &mut Check) {
    let own = g.of(&scene.fabric);
    if let Some(ratio) = g.poisson_ratio {
        c.above(
            key,
            ratio,
            -1.0..=0.5,
            "an isotropic solid has at most 0.5, where plane stress is still regular",
        );
        if own.law == Law::NeoHookean && ratio != 0.5 {
            let help = "leave it out: `fabric.law = \"neo-hookean\"` keeps its volume";
            c.refuse(key, format!("`{key}` is {ratio}"), help);
        }
    }
    let Some(o) = &own.orthotropic else { return };
    let bound = 0.99 * (own.youngs_modulus_pa / o.youngs_modulus_2_pa).sqrt();
    if own.poisson_ratio.abs() > bound {
        c.refuse(
            key,
            format!("Poisson's ratio is {}", own.poisson_ratio),
            format!(
                "between the moduli of the group a pull would give energy: at most {bound:.3} either way"
            ),
        );
    }
}
