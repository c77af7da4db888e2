//! `ilns`: the table of subcommands.
fn main() {}
