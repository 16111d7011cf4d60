//! Input of the checks before a run: scene, canopy, flow-grid sizes, machine.

use std::path::Path;

use case::{Canopy, Role, Scene, Stage, StageKind};
use coupling::interface::CanopyInterface;
use effects::numbers::Numbers;
use mesh::{CableKind, GridSizes, MeshError, StructureMesh};

use super::finding::Severity;

/// Resources of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Machine {
    /// Hardware threads that this process may use.
    pub cores: usize,
    /// Main memory, bytes; `None` if unknown.
    pub memory: Option<f64>,
    /// Free disk space in the folder of the results, bytes; `None` if unknown.
    pub disk: Option<f64>,
    /// `mpirun` has options: ranks may run on other hosts.
    pub hosts: bool,
}

impl Machine {
    /// The machine of this process, with results in `out`.
    pub fn here(out: &Path, hosts: bool) -> Self {
        let machine = results::machine::Machine::here();
        let existing = out.ancestors().find(|p| p.exists());
        Self {
            cores: machine.threads,
            memory: Some(machine.memory_gib * 1024f64.powi(3)).filter(|m| *m > 0.0),
            disk: existing.and_then(results::machine::free_in).map(|bytes| bytes as f64),
            hosts,
        }
    }
}

/// Quantities of a scene before its run.
pub struct Facts<'a> {
    /// The scene, or its view by one of its flow methods ([`Scene::views`]).
    pub scene: &'a Scene,
    /// Sizes, speeds, loads and masses.
    pub numbers: Numbers<'a>,
    /// Structure mesh (fabric, lines, payload) in the unstressed shape.
    pub mesh: StructureMesh,
    /// Sizes of the flow grid; `None` without a flow.
    pub grid: Option<Result<GridSizes, MeshError>>,
    /// The machine.
    pub machine: Machine,
    /// First stage to run, from 0.
    pub first: usize,
    /// Former names in the file of the scene and in the options of the command line.
    pub former_names: Vec<FormerName>,
}

/// A former name of a key or value in a scene.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FormerName {
    /// Current dotted key.
    pub key: String,
    /// Former and current name, a sentence without full stop.
    pub text: String,
}

impl<'a> Facts<'a> {
    /// The quantities of a scene whose stages from `first` on run on `machine`.
    ///
    /// # Errors
    /// Parameters from which no canopy mesh can be built.
    pub fn new(
        scene: &'a Scene,
        interface: &CanopyInterface,
        machine: Machine,
        first: usize,
    ) -> Result<Self, MeshError> {
        let mesh = mesh::structure_mesh(scene)?;
        let numbers = Numbers::new(scene, interface, &mesh);
        let flows = scene.stages.iter().skip(first).any(|s| s.kind.roles().contains(&Role::Flow));
        let immersed = scene.flow.as_ref().and_then(|f| f.immersed.as_ref());
        let grid = (flows && scene.flow.is_some()).then(|| match immersed {
            Some(g) => Ok(immersed_sizes(g, &mesh)),
            None => mesh::grid_sizes(scene, &mesh),
        });
        Ok(Self { scene, numbers, mesh, grid, machine, first, former_names: Vec::new() })
    }

    /// Stages to run by the flow method of the scene or without flow, with their number from 0.
    pub fn stages(&self) -> impl Iterator<Item = (usize, &'a Stage)> {
        let scene = self.scene;
        scene.stages.iter().enumerate().skip(self.first).filter(|(_, s)| scene.is_of_view(s))
    }

    /// Stages to run of a kind.
    pub fn stages_of(&self, kind: StageKind) -> impl Iterator<Item = (usize, &'a Stage)> {
        self.stages().filter(move |(_, s)| s.kind == kind)
    }

    /// Whether a stage of this kind is to run.
    pub fn has(&self, kind: StageKind) -> bool {
        self.stages_of(kind).next().is_some()
    }

    /// Whether the canopy has suspension lines. Ranges of real parachutes do not apply to panels, air bags and
    /// fixed sheets.
    pub fn is_parachute(&self) -> bool {
        if !self.scene.has_fabric() {
            return false;
        }
        match &self.scene.canopy {
            Canopy::Atps(_) => true,
            Canopy::Square(f) | Canopy::Circular(f) => f.line_count > 0,
            Canopy::Gored(_) | Canopy::Cross(_) => true,
            Canopy::Gmsh(_) | Canopy::Pattern(_) => {
                self.mesh.cables.iter().any(|c| c.kind == CableKind::SuspensionLine)
            }
            Canopy::AirBag(_) | Canopy::Panel(_) | Canopy::None => false,
        }
    }

    /// Whether the scene has what the check `id` is about: a canopy, or a length of the body for numbers of the flow.
    pub fn has_subject(&self, id: &str) -> bool {
        let of_fabric = id.starts_with("fabric.") || id == "stage.canopy-mode";
        let of_a_canopy = id.starts_with("lines.") || id.starts_with("tapes.") || id == "flow.courant";
        let of_a_length = ["flow.reynolds", "stage.development", "stage.shedding"].contains(&id);
        (self.scene.has_canopy() || !of_a_canopy)
            && (self.scene.has_fabric() || !of_fabric)
            && (self.numbers.width > 0.0 || !of_a_length)
    }

    /// Weight of payload, fabric and lines, N; 0 without descent.
    pub fn weight(&self) -> f64 {
        self.numbers.falling_mass * self.numbers.gravity
    }

    /// The largest pressure jump of the scene, Pa, with its name: the pressure of a
    /// pre-inflation, the dynamic pressure, or the weight over the fabric area $`S_0`$.
    pub fn load_pressure(&self) -> (f64, &'static str) {
        let n = &self.numbers;
        let area = n.fabric_area.max(f64::MIN_POSITIVE);
        let given = self.stages().filter_map(|(_, s)| s.pressure_pa).map(f64::abs).fold(0.0, f64::max);
        [
            (given, "the pressure of the pre-inflation"),
            (n.peak_pressure(), "the dynamic pressure"),
            (self.weight() / area, "the weight over the fabric area"),
        ]
        .into_iter()
        .fold((0.0, "no load"), |most, next| if next.0 > most.0 { next } else { most })
    }

    /// Nominal area $`S_0`$, m2: of gores with vent and gaps, else of the fabric.
    pub fn nominal_area(&self) -> f64 {
        match &self.scene.canopy {
            Canopy::Gored(g) => g.nominal_area(),
            _ => self.numbers.fabric_area,
        }
    }

    /// Diameter of a circle of the nominal area, $`D_0 = \sqrt{4 S_0 / \pi}`$, m.
    pub fn nominal_diameter(&self) -> f64 {
        (4.0 * self.nominal_area() / std::f64::consts::PI).sqrt()
    }

    /// `Warning`, or `Note` for a canopy that opens from a gathered skirt, far from the balance of weight and drag.
    pub fn off_balance(&self) -> Severity {
        if self.scene.opens_gathered() { Severity::Note } else { Severity::Warning }
    }

    /// Nodes of the flow grid, 0 if there is none.
    pub fn grid_nodes(&self) -> f64 {
        self.grid.as_ref().and_then(|g| g.as_ref().ok()).map_or(0.0, |g| g.nodes as f64)
    }

    /// Cells of the flow grid, 0 if there is none.
    pub fn cells(&self) -> f64 {
        self.grid.as_ref().and_then(|g| g.as_ref().ok()).map_or(0.0, |g| g.cells as f64)
    }
}

/// Sizes of the Cartesian grid around the unstressed canopy in a stream from below.
pub fn immersed_sizes(g: &case::Immersed, mesh: &StructureMesh) -> GridSizes {
    let points: Vec<_> = mesh.coords[..mesh.n_canopy].iter().map(|x| (*x).into()).collect();
    let placement = immersed::placement::Placement {
        spacing: g.spacing_m,
        room: g.room,
        wake: g.wake,
        far_field: g.far_field,
        far_wake: g.far_wake,
        growth: g.growth,
    };
    let [x, y, z] = placement.grid(&immersed::placement::bounds(&points), nalgebra::Vector3::z()).cells();
    GridSizes { cells: (x * y * z) as u64, nodes: ((x + 1) * (y + 1) * (z + 1)) as u64 }
}

/// Three significant digits.
pub fn digits(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        "0".into()
    } else if !(1e-3..1e5).contains(&size) {
        format!("{value:.2e}")
    } else {
        let places = (2 - size.log10().floor() as i32).max(0) as usize;
        format!("{value:.places$}")
    }
}

/// A ratio in per cent, three significant digits.
pub fn percent(share: f64) -> String {
    format!("{} %", digits(100.0 * share))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_significant_digits() {
        for (value, text) in [
            (0.0, "0"),
            (0.0373, "0.0373"),
            (14.5672, "14.6"),
            (1045.5, "1046"),
            (-2.0, "-2.00"),
            (4.9e307, "4.90e307"),
        ] {
            assert_eq!(digits(value), text);
        }
        assert_eq!(percent(0.1607), "16.1 %");
    }
}
