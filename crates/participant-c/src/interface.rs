//! The types of `include/ripstop.h`, field by field; a test compares the sizes and offsets with those of the C compiler.

use std::ffi::{c_char, c_int, c_void};

use ripstop_participant::Window;

use crate::data::Data;

/// `ripstop_input`.
#[repr(C)]
pub struct CInput {
    pub canopy: *const f64,
    pub canopy_length: usize,
    pub grid: *const f64,
    pub grid_rows: usize,
}

/// `ripstop_structure`.
#[repr(C)]
pub struct CStructure {
    pub nodes: usize,
    pub coords: *const f64,
    pub fixed: *const u8,
    pub point_mass: *const f64,
    pub canopy_nodes: usize,
    pub faces: usize,
    pub corners: *const u32,
    pub cables: usize,
    pub cable_ends: *const u32,
    pub cable_length: *const f64,
    pub cable_kind: *const *const c_char,
}

/// `ripstop_grid`.
#[repr(C)]
pub struct CGrid {
    pub nodes: usize,
    pub coords: *const f64,
    pub cells: usize,
    pub corners: *const u32,
    pub canopy_nodes: *const u64,
    pub boundary_faces: usize,
    pub boundary: *const u32,
    pub patch: *const *const c_char,
}

pub type Start = extern "C-unwind" fn(*mut c_void, &Data) -> c_int;
pub type Rows = extern "C-unwind" fn(*mut c_void, &mut usize) -> *const u64;
pub type Advance = extern "C-unwind" fn(*mut c_void, &Window, &CInput, *mut f64, usize, *mut f64) -> c_int;
pub type Accept = extern "C-unwind" fn(*mut c_void, &Window) -> c_int;
pub type WithPath = extern "C-unwind" fn(*mut c_void, *const c_char) -> c_int;
pub type Snapshot = extern "C-unwind" fn(*mut c_void, f64, *const c_char) -> c_int;

/// `ripstop_program`. A C++ exception that leaves a function ends the process with a message.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct CProgram {
    pub size: usize,
    pub role: i32,
    pub needs_grid: i32,
    pub name: *const c_char,
    pub effects: *const c_char,
    pub user: *mut c_void,
    pub start: Option<Start>,
    pub output_rows: Option<Rows>,
    pub grid_rows: Option<Rows>,
    pub advance: Option<Advance>,
    pub accept: Option<Accept>,
    pub save: Option<WithPath>,
    pub restore: Option<WithPath>,
    pub snapshot: Option<Snapshot>,
}
