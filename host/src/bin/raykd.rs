//! The raykd program.
fn main() {}
