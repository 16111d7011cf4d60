//! The header compiles as C99 and C++, without a warning, and its types have the layout of ours.

use std::fmt::Write as _;
use std::mem::offset_of;
use std::path::Path;
use std::process::Command;

use ripstop_participant::{
    CONTRACT_VERSION, Role, STATS, Window, flow_stats, mesh_stats, role_code, structure_stats,
};

use crate::interface::{CGrid, CInput, CProgram, CStructure};

const STRICT: [&str; 4] = ["-Wall", "-Wextra", "-pedantic", "-Werror"];

/// Compiles `text` in `folder`; the program.
fn compile(folder: &Path, compiler: &str, standard: &str, name: &str, text: &str) -> std::path::PathBuf {
    let (source, program) = (folder.join(name), folder.join(format!("{name}.out")));
    std::fs::write(&source, text).expect("written");
    let mut command = Command::new(compiler);
    command.arg(standard).args(STRICT).arg("-I").arg(concat!(env!("CARGO_MANIFEST_DIR"), "/include"));
    let output = command.arg(&source).arg("-o").arg(&program).output().expect("the compiler of the build");
    assert!(output.status.success(), "{command:?}\n{}", String::from_utf8_lossy(&output.stderr));
    program
}

#[test]
fn header_is_c99_and_cpp_and_has_the_layout_of_the_library() {
    macro_rules! layouts {
        ($($c:literal $of:ident { $($field:ident),* })*) => {
            [$(($c, size_of::<$of>(), vec![$((stringify!($field), offset_of!($of, $field))),*])),*]
        };
    }
    let layouts = layouts! {
        "ripstop_window" Window { index, iteration, substeps, time, dt, frame_velocity, frame_acceleration }
        "ripstop_input" CInput { canopy, canopy_length, grid, grid_rows }
        "ripstop_structure" CStructure { nodes, coords, fixed, point_mass, canopy_nodes, faces, corners, cables, cable_ends, cable_length,
            cable_kind }
        "ripstop_grid" CGrid { nodes, coords, cells, corners, canopy_nodes, boundary_faces, boundary, patch }
        "ripstop_program" CProgram { size, role, needs_grid, name, effects, user, start, output_rows, grid_rows, advance, accept, save,
            restore, snapshot }
    };
    let constants = [
        ("CONTRACT", CONTRACT_VERSION as usize),
        ("STATS", STATS),
        ("FAULT", crate::message::FAULT as usize),
        ("ROLE_MESH", role_code(Role::Mesh) as usize),
        ("STRUCTURE_AIR_FORCE", structure_stats::AIR_FORCE),
        ("FLOW_NO_ANSWER", flow_stats::NO_ANSWER),
        ("MESH_RESIDUAL_TARGET", mesh_stats::RESIDUAL_TARGET),
    ];
    let mut text = String::from("#include \"ripstop.h\"\n#include <stdio.h>\nint main(void) {\n");
    let mut expected = String::new();
    let mut row = |name: String, c: String, ours: usize| {
        let _ = writeln!(text, "    printf(\"{name} %d\\n\", (int)({c}));");
        let _ = writeln!(expected, "{name} {ours}");
    };
    for (name, size, fields) in layouts {
        row(name.into(), format!("sizeof({name})"), size);
        for (field, offset) in fields {
            row(format!("{name}.{field}"), format!("offsetof({name}, {field})"), offset);
        }
    }
    for (name, value) in constants {
        row(name.into(), format!("RIPSTOP_{name}"), value);
    }
    text += "    return 0;\n}\n";
    let folder = tempfile::tempdir().expect("a folder");
    for (compiler, standard, name) in [("gcc", "-std=c99", "layout.c"), ("g++", "-std=c++11", "layout.cpp")] {
        let program = compile(folder.path(), compiler, standard, name, &text);
        let output = Command::new(program).output().expect("it runs");
        assert_eq!(String::from_utf8_lossy(&output.stdout), expected, "{compiler}");
    }
}
