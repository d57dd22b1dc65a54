//! The program as its users meet it: run folders, bad input, accuracy on the bundled clips.
#![allow(clippy::print_stdout, reason = "a test says what it skipped and what it measured")]

mod accuracy;
mod bad_input;
mod measure;
mod shape;
mod stage;
mod support;
mod track;
