//! Launches, sequences, accelerates and reports the coupled run
