//! `diptych scenes`.

use diptych::scene::builtin::BUILTINS;

use super::failure::Failure;

pub fn run() -> Result<(), Failure> {
    for builtin in BUILTINS {
        say!("builtin:{:<10} {}", builtin.name, builtin.about);
    }
    Ok(())
}
