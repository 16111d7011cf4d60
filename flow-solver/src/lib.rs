//! Unsteady low-Mach flow on moving grids: finite volumes under MPI
