//! The functions of `include/ripstop.h`. A reference that may be absent is a pointer that may be null.

use std::ffi::{OsString, c_char, c_int};

use clap::Parser;
use ripstop_participant::{Fault, ProgramArgs, bdf2, load_state, save_state, serve, write_shape};
use serde_json::Value;

use crate::data::Data;
use crate::interface::{CGrid, CProgram, CStructure};
use crate::message::{guard, keep, kept};
use crate::pointers::{path, slice, slice_mut, text, value};
use crate::program::{Program, role_of};

fn some<T>(reference: Option<T>, name: &str) -> Result<T, Fault> {
    reference.ok_or_else(|| {
        Fault::new(format!("`{name}` is a null pointer: pass a pointer to what ripstop.h describes"))
    })
}

/// Writes the value of `read` to `target`.
fn fill<T>(target: Option<&mut T>, name: &str, read: impl FnOnce() -> Result<T, Fault>) -> c_int {
    guard(|| {
        let target = some(target, name)?;
        *target = read()?;
        Ok(())
    })
}

/// The program that `program` points to: its `size` is read before anything else.
fn program_at(program: *const CProgram) -> Result<CProgram, Fault> {
    let size = value(program.cast::<usize>(), "program")?;
    if size != size_of::<CProgram>() {
        return Err(Fault::new(format!(
            "`size` of the ripstop_program is {size}, expected {}: set it to sizeof(ripstop_program), and compile the program with the \
             ripstop.h of this library",
            size_of::<CProgram>()
        )));
    }
    value(program, "program")
}

/// The arguments as given, or those of this process.
fn words(argc: c_int, argv: *const *const c_char) -> Result<Vec<OsString>, Fault> {
    if argv.is_null() {
        return Ok(std::env::args_os().collect());
    }
    let argc = usize::try_from(argc).map_err(|_| Fault::new(format!("`argc` is {argc}, below 0")))?;
    let pointers = slice(argv, argc, "argv")?;
    pointers.iter().map(|word| path(*word, "argv").map(|word| word.as_os_str().to_owned())).collect()
}

/// Serves a program; its exit code.
fn run(argc: c_int, argv: *const *const c_char, program: *const CProgram) -> Result<c_int, Fault> {
    let args = match ProgramArgs::try_parse_from(words(argc, argv)?) {
        Ok(args) => args,
        Err(e) => {
            // Help, the version or a wrong argument.
            let _ = e.print();
            return Ok(e.exit_code());
        }
    };
    let program = program_at(program)?;
    let role = role_of(program.role)?;
    args.watch_coupler();
    serve(role, args, |run| Program::new(run, program)).map_err(Fault::new)?;
    Ok(0)
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_participant_main(
    argc: c_int,
    argv: *const *const c_char,
    program: *const CProgram,
) -> c_int {
    let mut code = 1;
    let failed = guard(|| {
        code = run(argc, argv, program)?;
        Ok(())
    });
    if failed != 0 {
        eprintln!("{}", kept());
    }
    code
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_fault(message: *const c_char) -> c_int {
    guard(|| match path(message, "message") {
        // A message in another encoding is better than none.
        Ok(words) => Err(Fault::new(words.display())),
        Err(_) => Err(Fault::new("ripstop_fault was called without a message (a null pointer)")),
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_message(target: *mut c_char, size: usize) -> usize {
    let message = kept();
    let mut end = message.len().min(size.saturating_sub(1));
    while !message.is_char_boundary(end) {
        end -= 1;
    }
    match slice_mut(target.cast::<u8>(), size, "text") {
        Ok([]) => {}
        Ok(target) => {
            target[..end].copy_from_slice(&message.as_bytes()[..end]);
            target[end] = 0;
        }
        Err(fault) => drop(keep(&fault.message)),
    }
    message.len()
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_rank(data: Option<&Data>) -> usize {
    data.map_or(0, |data| data.run.rank)
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_ranks(data: Option<&Data>) -> usize {
    data.map_or(0, |data| data.run.ranks())
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_share(
    data: Option<&Data>,
    rows: usize,
    begin: Option<&mut usize>,
    end: Option<&mut usize>,
) -> c_int {
    guard(|| {
        let (begin, end) = (some(begin, "begin")?, some(end, "end")?);
        let share = some(data, "data")?.run.share(rows);
        (*begin, *end) = (share.start, share.end);
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_is_coupled(data: Option<&Data>) -> c_int {
    data.map_or(0, |data| c_int::from(data.stage.is_coupled()))
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_get_structure(data: Option<&Data>, structure: Option<&mut CStructure>) -> c_int {
    fill(structure, "structure", || Ok(some(data, "data")?.structure()))
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_get_grid(data: Option<&Data>, grid: Option<&mut CGrid>) -> c_int {
    fill(grid, "grid", || some(data, "data")?.grid())
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_number(data: Option<&Data>, key: *const c_char, number: Option<&mut f64>) -> c_int {
    fill(number, "value", || some(data, "data")?.stage.number(text(key, "key")?))
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_flag(data: Option<&Data>, key: *const c_char, flag: Option<&mut c_int>) -> c_int {
    fill(flag, "value", || {
        let key = text(key, "key")?;
        let flag = some(data, "data")?.stage.value(key).and_then(Value::as_bool);
        flag.map(c_int::from).ok_or_else(|| Fault::new(format!("the scene has no true or false at `{key}`")))
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_text(
    data: Option<&Data>,
    key: *const c_char,
    found: Option<&mut *const c_char>,
) -> c_int {
    fill(found, "value", || some(data, "data")?.text(text(key, "key")?))
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_stage_number(
    data: Option<&Data>,
    key: *const c_char,
    number: Option<&mut f64>,
) -> c_int {
    fill(number, "value", || some(data, "data")?.stage.stage_number(text(key, "key")?))
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_clock(data: Option<&Data>, name: *const c_char, time: Option<&mut f64>) -> c_int {
    fill(time, "value", || {
        let (clocks, name) = (&some(data, "data")?.stage.clocks, text(name, "name")?);
        clocks.get(name).copied().ok_or_else(|| {
            let known: Vec<&str> = clocks.keys().map(String::as_str).collect();
            Fault::new(format!(
                "there is no clock `{name}`: the clocks of this stage are {}",
                known.join(", ")
            ))
        })
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_state_file(data: Option<&Data>, role: i32) -> *const c_char {
    let mut file = std::ptr::null();
    guard(|| {
        file = some(data, "data")?.state_file(role_of(role)?).unwrap_or(std::ptr::null());
        Ok(())
    });
    file
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_save_numbers(
    data: Option<&Data>,
    folder: *const c_char,
    values: *const f64,
    count: usize,
) -> c_int {
    guard(|| {
        let values = slice(values, count, "values")?;
        save_state(path(folder, "folder")?, some(data, "data")?.run.role, &values)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_load_numbers(file: *const c_char, values: *mut f64, count: usize) -> c_int {
    guard(|| {
        let values = slice_mut(values, count, "values")?;
        let file = path(file, "file")?;
        let found: Vec<f64> = load_state(file)?;
        if found.len() != count {
            return Err(Fault::new(format!(
                "{} has {} numbers, this program reads {count}: run the earlier stage with this program too",
                file.display(),
                found.len()
            )));
        }
        values.copy_from_slice(&found);
        Ok(())
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_write_shape(folder: *const c_char, positions: *const f64, nodes: usize) -> c_int {
    guard(|| {
        let count = nodes.saturating_mul(3);
        let positions = slice(positions, count, "positions")?;
        write_shape(path(folder, "folder")?, positions.as_chunks::<3>().0)
    })
}

#[unsafe(no_mangle)]
pub extern "C" fn ripstop_bdf2(ratio: f64, coefficients: Option<&mut [f64; 3]>) -> c_int {
    fill(coefficients, "c", || Ok(bdf2(ratio).unwrap_or([1.0, -1.0, 0.0])))
}
