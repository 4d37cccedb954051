//! Amount of work in tests.

#![allow(dead_code)] // Each test binary uses a part.

/// Returns true under `make test-full`: then sweeps are complete and samples many.
pub fn is_thorough() -> bool {
    std::env::var_os("DIPTYCH_TEST_FULL").is_some()
}

/// Returns every row of a table under `make test-full`, and otherwise one in `step`.
pub fn sampled<T>(all: impl IntoIterator<Item = T>, step: usize) -> impl Iterator<Item = T> {
    all.into_iter().step_by(if is_thorough() { 1 } else { step })
}
