//! What a pointer of C points to. The header states what a caller must pass; null pointers are errors.

use std::ffi::{CStr, OsStr, c_char};
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use ripstop_participant::Fault;

fn null(name: &str) -> Fault {
    Fault::new(format!("`{name}` is a null pointer: pass a pointer to what ripstop.h describes"))
}

/// The value at `pointer`, or an error that names it.
pub fn value<T: Copy>(pointer: *const T, name: &str) -> Result<T, Fault> {
    if pointer.is_null() {
        return Err(null(name));
    }
    // SAFETY: not null; ripstop.h requires a value of this type there. It is copied.
    Ok(unsafe { pointer.read() })
}

/// The bytes of a text that ends with a zero.
fn bytes<'a>(pointer: *const c_char, name: &str) -> Result<&'a [u8], Fault> {
    if pointer.is_null() {
        return Err(null(name));
    }
    // SAFETY: not null; ripstop.h requires a text that ends with a zero, unchanged during the call.
    Ok(unsafe { CStr::from_ptr(pointer) }.to_bytes())
}

/// A text, valid during the call in which it was passed.
pub fn text<'a>(pointer: *const c_char, name: &str) -> Result<&'a str, Fault> {
    std::str::from_utf8(bytes(pointer, name)?)
        .map_err(|e| Fault::new(format!("`{name}` is no text in UTF-8 ({e})")))
}

/// A path, valid during the call in which it was passed.
pub fn path<'a>(pointer: *const c_char, name: &str) -> Result<&'a Path, Fault> {
    bytes(pointer, name).map(|bytes| Path::new(OsStr::from_bytes(bytes)))
}

/// An array of `length` values, valid during the call in which it was passed. An empty one may be null.
pub fn slice<'a, T>(pointer: *const T, length: usize, name: &str) -> Result<&'a [T], Fault> {
    check(pointer, length, name)?;
    if length == 0 {
        return Ok(&[]);
    }
    // SAFETY: not null, aligned, and not longer than memory can be; ripstop.h requires `length` values there.
    Ok(unsafe { std::slice::from_raw_parts(pointer, length) })
}

/// An array that the call fills, as [`slice`].
pub fn slice_mut<'a, T>(pointer: *mut T, length: usize, name: &str) -> Result<&'a mut [T], Fault> {
    check(pointer, length, name)?;
    if length == 0 {
        return Ok(&mut []);
    }
    // SAFETY: as in `slice`; ripstop.h requires that nothing else uses the array during the call.
    Ok(unsafe { std::slice::from_raw_parts_mut(pointer, length) })
}

fn check<T>(pointer: *const T, length: usize, name: &str) -> Result<(), Fault> {
    if length == 0 {
        return Ok(());
    }
    if pointer.is_null() {
        return Err(null(name));
    }
    if length > isize::MAX as usize / size_of::<T>() {
        return Err(Fault::new(format!(
            "`{name}` has {length} values, more than memory can hold: was the number computed below 0?"
        )));
    }
    if !pointer.is_aligned() {
        return Err(Fault::new(format!(
            "`{name}` is at an address that is no multiple of {}: pass an array of the type in ripstop.h",
            align_of::<T>()
        )));
    }
    Ok(())
}
