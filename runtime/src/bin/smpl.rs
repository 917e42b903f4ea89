//! The `smpl` command.
fn main() {}
