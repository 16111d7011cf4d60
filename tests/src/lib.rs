//! Cross-program tests of Ripstop: see `tests/tests/`.
