//! The interface as C sees it: null pointers, wrong sizes, errors of the program, layouts.

mod layout;

use std::ffi::{CString, c_char, c_int, c_void};
use std::ptr;
use std::sync::{Mutex, MutexGuard, PoisonError};

use ripstop_participant::{Fault, Grid, Input, Participant, ProgramArgs, Role, Run, StageData, Window};

use crate::data::Data;
use crate::exports::*;
use crate::interface::{CInput, CProgram, CStructure};
use crate::message::{FAULT, guard, kept};
use crate::program::{Program, role_of};

/// The message of the last error is one for the process: one test at a time.
fn alone() -> MutexGuard<'static, ()> {
    static LOCK: Mutex<()> = Mutex::new(());
    LOCK.lock().unwrap_or_else(PoisonError::into_inner)
}

fn run(role: Role) -> Run {
    let words = "my-program --scene s --stage 0 --session x --out o --ranks 1".split(' ');
    Run { role, args: ProgramArgs::from_words(words).expect("arguments"), rank: 0 }
}

fn stage() -> StageData {
    let text = r#"{"scene": {"name": "square", "fabric": {"thickness_m": 4e-5, "wrinkling": true}, "flow": {"wind_m_s": [0, 0, 2.5]},
        "stage": [{"kind": "coupled", "window_s": 5e-3}]}, "stage": 0, "structure": {"coords": [[0,0,0],[1,0,0],[0,1,0],[0,0,-2]],
        "n_canopy": 3, "faces": [[0,1,2,2]], "cables": [{"nodes": [0, 3], "rest_length": 2.4, "kind": {"Tape": "Hem"}}],
        "point_masses": [[3, 5.0]], "fixed": [[3, [true, false, true]]]}, "states": {"structure": "/a/structure.bin"},
        "clocks": {"stage": 0.0, "run": 0.5}}"#;
    serde_json::from_str(text).expect("data of a stage")
}

fn data() -> Data {
    Data::new(&run(Role::Structure), stage()).expect("data")
}

fn c(text: &str) -> CString {
    CString::new(text).expect("no zero")
}

extern "C-unwind" fn start(_: *mut c_void, data: &Data) -> c_int {
    ripstop_is_coupled(Some(data)) - 1
}

extern "C-unwind" fn advance(
    user: *mut c_void,
    window: &Window,
    input: &CInput,
    output: *mut f64,
    length: usize,
    _: *mut f64,
) -> c_int {
    assert!(window.index != 7, "a seam tore");
    if input.canopy_length != 8 || length != 9 || !user.is_null() {
        return 3;
    }
    let output = crate::pointers::slice_mut(output, length, "output").expect("an array");
    output.fill(window.dt);
    if window.index == 8 { ripstop_fault(c"the line tore".as_ptr()) } else { 0 }
}

extern "C-unwind" fn rows(_: *mut c_void, count: &mut usize) -> *const u64 {
    static ROWS: [u64; 2] = [0, 17];
    *count = 2;
    ROWS.as_ptr()
}

fn program() -> CProgram {
    CProgram {
        size: size_of::<CProgram>(),
        role: 1,
        needs_grid: 0,
        name: c"net".as_ptr(),
        effects: c"lines  resume".as_ptr(),
        user: ptr::null_mut(),
        start: Some(start),
        output_rows: None,
        grid_rows: None,
        advance: Some(advance),
        accept: None,
        save: None,
        restore: None,
        snapshot: None,
    }
}

fn started(program: CProgram) -> Result<Program, Fault> {
    Program::start(&run(Role::Structure), program, stage())
}

fn refused(program: CProgram) -> String {
    started(program).err().expect("refused").message
}

#[test]
fn values_of_a_stage_are_read() {
    let _alone = alone();
    let data = data();
    let (mut number, mut flag, mut text) = (0.0, 0, ptr::null());
    assert_eq!(ripstop_number(Some(&data), c"flow.wind_m_s.2".as_ptr(), Some(&mut number)), 0);
    assert_eq!(ripstop_flag(Some(&data), c"fabric.wrinkling".as_ptr(), Some(&mut flag)), 0);
    assert_eq!(ripstop_text(Some(&data), c"stage.0.kind".as_ptr(), Some(&mut text)), 0);
    assert_eq!((number, flag, crate::pointers::text(text, "value")), (2.5, 1, Ok("coupled")));
    assert_eq!(ripstop_clock(Some(&data), c"run".as_ptr(), Some(&mut number)), 0);
    assert_eq!(number, 0.5);
    let file = ripstop_state_file(Some(&data), 1);
    assert_eq!(crate::pointers::text(file, "file"), Ok("/a/structure.bin"));
    assert!(ripstop_state_file(Some(&data), 2).is_null());
    let mesh = data.structure();
    let slice = |pointer, n| crate::pointers::slice(pointer, n, "array").expect("an array");
    assert_eq!((mesh.nodes, mesh.canopy_nodes, mesh.faces, mesh.cables), (4, 3, 1, 1));
    assert_eq!(slice(mesh.point_mass, 4), [0.0, 0.0, 0.0, 5.0]);
    let fixed = crate::pointers::slice(mesh.fixed, 12, "fixed").expect("an array");
    assert_eq!(fixed, [0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 1]);
    let kinds = crate::pointers::slice(mesh.cable_kind, 1, "kinds").expect("an array");
    assert_eq!(crate::pointers::text(kinds[0], "kind"), Ok("Tape"));
}

#[test]
fn null_pointers_are_errors_that_name_the_argument() {
    let _alone = alone();
    let (data, key, mut number) = (data(), c"fabric.thickness_m".as_ptr(), 0.0);
    let mut structure = CStructure { nodes: 9, ..data.structure() };
    let calls: [(&str, &dyn Fn() -> c_int); 7] = [
        ("value", &|| ripstop_number(Some(&data), key, None)),
        ("structure", &|| ripstop_get_structure(Some(&data), None)),
        ("folder", &|| ripstop_write_shape(ptr::null(), [0.0; 3].as_ptr(), 1)),
        ("positions", &|| ripstop_write_shape(c"/tmp".as_ptr(), ptr::null(), 1)),
        ("values", &|| ripstop_save_numbers(Some(&data), c"/tmp".as_ptr(), ptr::null(), 4)),
        ("file", &|| ripstop_load_numbers(ptr::null(), ptr::null_mut(), 0)),
        ("c", &|| ripstop_bdf2(1.0, None)),
    ];
    for (name, call) in calls {
        assert_eq!(call(), FAULT, "{name}");
        assert!(kept().contains(&format!("`{name}` is a null pointer")), "{name}: {}", kept());
    }
    assert_eq!(ripstop_number(Some(&data), ptr::null(), Some(&mut number)), FAULT);
    assert!(kept().contains("`key`"), "{}", kept());
    assert_eq!(ripstop_number(None, key, Some(&mut number)), FAULT);
    assert_eq!(ripstop_get_structure(None, Some(&mut structure)), FAULT);
    assert!(kept().contains("`data`") && structure.nodes == 9, "{}", kept());
    assert_eq!((ripstop_rank(None), ripstop_ranks(None), ripstop_is_coupled(None)), (0, 0, 0));
    assert_eq!(ripstop_fault(ptr::null()), FAULT);
    assert!(kept().contains("without a message"), "{}", kept());
}

#[test]
fn what_a_scene_lacks_leaves_the_value() {
    let _alone = alone();
    let (data, mut number, mut text) = (data(), 7.0, ptr::null());
    assert_eq!(ripstop_number(Some(&data), c"fabric.density".as_ptr(), Some(&mut number)), FAULT);
    assert!(number == 7.0 && kept().contains("`fabric.density`"), "{}", kept());
    assert_eq!(ripstop_text(Some(&data), c"fabric".as_ptr(), Some(&mut text)), FAULT);
    assert_eq!(ripstop_clock(Some(&data), c"release".as_ptr(), Some(&mut number)), FAULT);
    assert!(text.is_null() && kept().contains("run, stage"), "{}", kept());
    assert!(data.grid().err().expect("no grid").message.contains("needs_grid"));
}

#[test]
fn wrong_lengths_are_errors() {
    let _alone = alone();
    let folder = tempfile::tempdir().expect("a folder");
    let path = c(folder.path().to_str().expect("UTF-8"));
    let (data, values) = (data(), [1.5, -2.0, 3.25]);
    assert_eq!(ripstop_save_numbers(Some(&data), path.as_ptr(), values.as_ptr(), 3), 0);
    let file = c(folder.path().join("structure.bin").to_str().expect("UTF-8"));
    let mut read = [0.0; 4];
    assert_eq!(ripstop_load_numbers(file.as_ptr(), read.as_mut_ptr(), 3), 0);
    assert_eq!(read, [1.5, -2.0, 3.25, 0.0]);
    assert_eq!(ripstop_load_numbers(file.as_ptr(), read.as_mut_ptr(), 4), FAULT);
    assert!(kept().contains("has 3 numbers, this program reads 4"), "{}", kept());
    for count in [usize::MAX, usize::MAX / 4] {
        assert_eq!(ripstop_write_shape(path.as_ptr(), values.as_ptr(), count), FAULT);
        assert!(kept().contains("more than memory can hold"), "{}", kept());
    }
    let odd = values.as_ptr().wrapping_byte_add(1);
    assert_eq!(ripstop_save_numbers(Some(&data), path.as_ptr(), odd, 1), FAULT);
    assert!(kept().contains("multiple of 8"), "{}", kept());
}

#[test]
fn incomplete_programs_are_refused() {
    let _alone = alone();
    let mut other = program();
    other.size -= 8;
    assert_eq!(
        ripstop_participant_main(0, ptr::null(), &other),
        2,
        "the arguments of a test are no program's"
    );
    let words = "p --scene s --stage 0 --session x --out o --ranks 1".split(' ').map(c).collect::<Vec<_>>();
    let words: Vec<*const c_char> = words.iter().map(|word| word.as_ptr()).collect();
    let main = |program: *const CProgram| ripstop_participant_main(10, words[..].as_ptr(), program);
    assert_eq!(words.len(), 11);
    assert_eq!(main(&other), 2, "a word is missing");
    let main = |program: *const CProgram| ripstop_participant_main(11, words.as_ptr(), program);
    assert_eq!(main(ptr::null()), 1);
    assert!(kept().contains("`program` is a null pointer"), "{}", kept());
    assert_eq!(main(&other), 1);
    assert!(kept().contains("sizeof(ripstop_program)"), "{}", kept());
    assert_eq!(main(&CProgram { role: 0, ..program() }), 1);
    assert!(kept().contains("`role`") && kept().contains("ROLE_FLOW"), "{}", kept());
    assert_eq!(role_of(2).map(Role::name), Ok("flow"));
    for (what, program) in [
        ("`start`", CProgram { start: None, ..program() }),
        ("`advance`", CProgram { advance: None, ..program() }),
        ("`name`", CProgram { name: ptr::null(), ..program() }),
        ("row 17, but there are 3 canopy nodes", CProgram { output_rows: Some(rows), ..program() }),
    ] {
        let message = refused(program);
        assert!(message.contains(what), "{what}: {message}");
    }
    extern "C-unwind" fn save(_: *mut c_void, _: *const c_char) -> c_int {
        0
    }
    let message = refused(CProgram { save: Some(save), ..program() });
    assert!(message.contains("accept (missing), save (given)"), "{message}");
}

#[test]
fn errors_and_panics_of_a_program_are_faults() {
    let _alone = alone();
    let mut net = started(program()).expect("started");
    let announced = net.announce();
    assert_eq!((announced.role.as_str(), announced.output_width, announced.grid_nodes), ("structure", 3, 0));
    assert_eq!(
        (announced.effects, net.output_rows()),
        (vec!["lines".into(), "resume".into()], vec![0, 1, 2])
    );
    let mut call = |index: u64, load: &[f64]| {
        let mut output = [0.0; 9];
        let input = Input { canopy: load, grid: Grid::default() };
        let window = Window { index, dt: 0.25, ..Window::default() };
        net.advance(&window, &input, &mut output).map(|_| output[8])
    };
    assert_eq!(call(0, &[0.0; 8]), Ok(0.25));
    let without = call(0, &[]).expect_err("3").message;
    assert!(without.contains("`advance` of the program returned 3 without a message"), "{without}");
    assert_eq!(call(8, &[0.0; 8]).expect_err("an error").message, "the line tore");
    // A panic crosses the function of C; the server of the rank reports it.
    let mut call = || guard(|| call(7, &[0.0; 8]).map(drop));
    assert_eq!(call(), FAULT);
    assert!(kept().contains("a seam tore"), "{}", kept());
}

#[test]
fn messages_are_cut_between_characters() {
    let _alone = alone();
    assert_eq!(ripstop_fault(c"zu groß".as_ptr()), FAULT);
    let mut text = [1u8; 8];
    assert_eq!(ripstop_message(text.as_mut_ptr().cast(), 8), 8);
    assert_eq!(&text, b"zu gro\0\x01");
    assert_eq!((ripstop_message(ptr::null_mut(), 0), kept()), (8, "zu groß".into()));
}
