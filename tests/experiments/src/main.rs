//! The tables of the README and of the notes, each one command.
fn main() {}
