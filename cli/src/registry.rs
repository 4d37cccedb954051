//! Policies and passes that the running program has registered.

use std::sync::OnceLock;

use diptych::passes::Declarations;
use diptych::schedule::Policy;

#[derive(Default)]
pub struct Registry {
    pub policies: Vec<NewPolicy>,
    pub passes: Declarations,
}

type Make = dyn Fn(u32, usize) -> Box<dyn Policy> + Send + Sync;

/// A policy that a program registers.
pub struct NewPolicy {
    pub name: &'static str,
    pub help: &'static str,
    /// Constructs the policy for an image height in rows and a number of devices.
    pub make: Box<Make>,
}

static REGISTERED: OnceLock<Registry> = OnceLock::new();

/// Returns the registrations of the running program.
pub fn registered() -> &'static Registry {
    REGISTERED.get_or_init(Registry::default)
}

/// Sets the registrations, unless they are set already.
pub fn register(registry: Registry) {
    let _ = REGISTERED.set(registry);
}
