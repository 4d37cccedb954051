//! Amount of work in tests.

/// Returns true under `make test-long`: then sweeps are complete and samples many.
pub fn is_thorough() -> bool {
    std::env::var_os("DIPTYCH_TEST_LONG").is_some()
}
