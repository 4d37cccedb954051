//! How much tests do.

/// Whether `make test-long` runs: sweeps are whole then, and samples many.
pub fn is_thorough() -> bool {
    std::env::var_os("DIPTYCH_TEST_LONG").is_some()
}
