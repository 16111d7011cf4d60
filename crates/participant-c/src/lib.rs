//! The C interface of `ripstop-participant`: solver programs in C, C++ and Fortran.
//!
//! The interface is the header `include/ripstop.h`; C++ has classes for it in `include/ripstop.hpp`, Fortran a module in
//! `fortran/ripstop.f90`. Nothing here is for programs in Rust. A program of functions becomes a participant in `program`; the exported
//! functions take references, which C passes as pointers, so that unsafe code is needed in `pointers` alone.

// An error ends the program: its size does not affect performance.
#![allow(clippy::result_large_err)]

mod data;
mod exports;
mod interface;
mod message;
mod pointers;
mod program;

#[cfg(test)]
mod tests;
