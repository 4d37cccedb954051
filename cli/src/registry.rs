//! Passes that the running program has registered.

use std::sync::OnceLock;

use diptych::passes::Declarations;

static REGISTERED: OnceLock<Declarations> = OnceLock::new();

/// Returns the passes of the running program.
pub fn registered() -> &'static Declarations {
    REGISTERED.get_or_init(Declarations::default)
}

/// Sets the passes, unless they are set already.
pub fn register(passes: Declarations) {
    let _ = REGISTERED.set(passes);
}
