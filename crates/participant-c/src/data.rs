//! The data of a stage as arrays and texts of C, which stay where they are.

use std::collections::BTreeMap;
use std::ffi::{CString, c_char};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use ripstop_participant::{Fault, Role, Run, StageData};
use serde_json::Value;

use crate::interface::{CGrid, CStructure};

/// `ripstop_data`: the stage of this process.
pub struct Data {
    pub run: Run,
    pub stage: StageData,
    fixed: Vec<[u8; 3]>,
    point_mass: Vec<f64>,
    cable_ends: Vec<[u32; 2]>,
    cable_length: Vec<f64>,
    cable_kind: Vec<*const c_char>,
    boundary: Vec<[u32; 4]>,
    patch: Vec<*const c_char>,
    texts: Texts,
    states: [Option<CString>; 3],
}

/// Texts with a zero at the end.
#[derive(Default)]
struct Texts(BTreeMap<String, CString>);

impl Texts {
    /// The address is that of the heap, so it stays the same as long as the text is kept.
    fn add(&mut self, text: &str) -> *const c_char {
        // A zero would end the text for C.
        let whole = || CString::new(text.replace('\0', "\u{fffd}")).unwrap_or_default();
        self.0.entry(text.to_owned()).or_insert_with(whole).as_ptr()
    }

    /// All texts of a scene.
    fn add_all(&mut self, value: &Value) {
        match value {
            Value::String(text) => drop(self.add(text)),
            Value::Array(list) => list.iter().for_each(|v| self.add_all(v)),
            Value::Object(table) => table.values().for_each(|v| self.add_all(v)),
            _ => {}
        }
    }

    /// Name of a kind: a word, or the first key of `{"Tape": "Hem"}`.
    fn add_kind(&mut self, kind: &Value) -> *const c_char {
        let key = || kind.as_object().and_then(|table| table.keys().next()).map(String::as_str);
        self.add(kind.as_str().or_else(key).unwrap_or_default())
    }
}

impl Data {
    /// # Errors
    /// A node of the stage's data that does not exist.
    pub fn new(run: &Run, stage: StageData) -> Result<Self, Fault> {
        let mesh = &stage.structure;
        let n = mesh.coords.len();
        let exists = |node: usize| match node < n {
            true => Ok(node),
            false => Err(Fault::new(format!("`ripstop mesh` names node {node} of {n}"))),
        };
        let mut fixed = vec![[0; 3]; n];
        for (node, held) in &mesh.fixed {
            fixed[exists(*node)?] = held.map(u8::from);
        }
        let mut point_mass = vec![0.0; n];
        for (node, kilograms) in &mesh.point_masses {
            point_mass[exists(*node)?] += kilograms;
        }
        let mut texts = Texts::default();
        texts.add_all(&stage.scene);
        let cable_kind = mesh.cables.iter().map(|cable| texts.add_kind(&cable.kind)).collect();
        let boundary = stage.grid.iter().flat_map(|grid| &grid.boundary);
        let (patch, boundary) = boundary.map(|(patch, face)| (texts.add_kind(patch), *face)).unzip();
        let file = |role: Role| match role == run.role {
            true => run.state(&stage),
            false => stage.states.get(role.name()).cloned(),
        };
        let states = Role::ALL.map(|role| file(role).as_deref().and_then(c_path));
        Ok(Self {
            run: run.clone(),
            fixed,
            point_mass,
            cable_ends: mesh.cables.iter().map(|cable| cable.nodes).collect(),
            cable_length: mesh.cables.iter().map(|cable| cable.rest_length).collect(),
            cable_kind,
            boundary,
            patch,
            texts,
            states,
            stage,
        })
    }

    /// `ripstop_structure` of this stage.
    pub fn structure(&self) -> CStructure {
        let mesh = &self.stage.structure;
        CStructure {
            nodes: mesh.coords.len(),
            coords: mesh.coords.as_ptr().cast(),
            fixed: self.fixed.as_ptr().cast(),
            point_mass: self.point_mass.as_ptr(),
            canopy_nodes: mesh.n_canopy,
            faces: mesh.faces.len(),
            corners: mesh.faces.as_ptr().cast(),
            cables: self.cable_ends.len(),
            cable_ends: self.cable_ends.as_ptr().cast(),
            cable_length: self.cable_length.as_ptr(),
            cable_kind: self.cable_kind.as_ptr(),
        }
    }

    /// `ripstop_grid` of this stage.
    ///
    /// # Errors
    /// The grid was not asked for.
    pub fn grid(&self) -> Result<CGrid, Fault> {
        let none = || {
            Fault::new("this program asked for no flow grid: set `needs_grid` of its ripstop_program to 1")
        };
        let grid = self.stage.grid.as_ref().ok_or_else(none)?;
        Ok(CGrid {
            nodes: grid.coords.len(),
            coords: grid.coords.as_ptr().cast(),
            cells: grid.cells.len(),
            corners: grid.cells.as_ptr().cast(),
            canopy_nodes: grid.canopy_nodes.as_ptr(),
            boundary_faces: self.boundary.len(),
            boundary: self.boundary.as_ptr().cast(),
            patch: self.patch.as_ptr(),
        })
    }

    /// The text at a dotted key of the scene.
    ///
    /// # Errors
    /// The scene has no text there.
    pub fn text(&self, key: &str) -> Result<*const c_char, Fault> {
        let text = self.stage.value(key).and_then(Value::as_str).and_then(|text| self.texts.0.get(text));
        text.map(|text| text.as_ptr()).ok_or_else(|| Fault::new(format!("the scene has no text `{key}`")))
    }

    /// File of the state that the program of `role` saved last; for the own role the one to start from.
    pub fn state_file(&self, role: Role) -> Option<*const c_char> {
        self.states[role as usize].as_ref().map(|file| file.as_ptr())
    }
}

/// A path as a text of C; none where it contains a zero, which no file's does.
pub fn c_path(path: &Path) -> Option<CString> {
    CString::new(path.as_os_str().as_bytes()).ok()
}
