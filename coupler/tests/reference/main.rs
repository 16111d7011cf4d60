//! The pages of `docs/reference` that are generated from the code: scene keys, materials, results, command line, messages.
//!
//! After a change: `RIPSTOP_WRITE_DOCS=1 cargo test --release -p coupler --test reference`.

mod canopy_types;
mod command_line;
mod environment;
mod markdown;
mod materials;
mod messages;
mod results_page;
mod scene;
mod schema;
mod source;
mod units;
