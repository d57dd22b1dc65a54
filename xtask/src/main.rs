//! Checks, fixtures and studies of the workspace: `cargo xtask <command>`.

fn main() {}
