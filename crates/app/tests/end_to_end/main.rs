//! The program as its users meet it: run folders, bad input, accuracy on the bundled clips.

mod accuracy;
mod bad_input;
mod support;
mod track;
