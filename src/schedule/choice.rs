//! Load-balancing policies by name: the built-in ones and those that the program registers.

use std::fmt;
use std::sync::{PoisonError, RwLock};

use super::{Even, Measured, Policy, RatioRule, Static};
use crate::graph::StripesError;

/// A load-balancing policy: distributes rows among devices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Balance {
    Even,
    Static,
    Measured,
    Registered(&'static Registered),
}

/// Built-in policies with their names and help texts.
const BUILT_IN: [(Balance, &str, &str); 3] = [
    (Balance::Even, "even", "The same number of rows for every device"),
    (Balance::Static, "static", "Fixed fractions from ratios"),
    (Balance::Measured, "measured", "By measured cost of past frames"),
];

type Make = dyn Fn(u32, usize) -> Box<dyn Policy> + Send + Sync;

/// A policy that the program has registered with [`Balance::register`].
pub struct Registered {
    name: &'static str,
    help: &'static str,
    make: Box<Make>,
}

impl fmt::Debug for Registered {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name)
    }
}

/// No two policies have the same name.
impl PartialEq for Registered {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Registered {}

static REGISTERED: RwLock<Vec<&'static Registered>> = RwLock::new(Vec::new());

impl Balance {
    /// Registers a policy, so that [`Self::from_name`] finds it. `make` constructs it for the rows of an image and a
    /// number of devices.
    ///
    /// # Errors
    /// A message if the name is taken.
    pub fn register(
        name: &'static str,
        help: &'static str,
        make: impl Fn(u32, usize) -> Box<dyn Policy> + Send + Sync + 'static,
    ) -> Result<Self, String> {
        if Self::from_name(name).is_some() {
            return Err(format!("there is a policy {name} already"));
        }
        let policy: &Registered = Box::leak(Box::new(Registered { name, help, make: Box::new(make) }));
        REGISTERED.write().unwrap_or_else(PoisonError::into_inner).push(policy);
        Ok(Self::Registered(policy))
    }

    /// Returns all policies with their names and help texts: the built-in ones, then the registered ones.
    pub fn all() -> Vec<(Self, &'static str, &'static str)> {
        let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
        let registered = registered.iter().map(|policy| (Self::Registered(policy), policy.name, policy.help));
        BUILT_IN.into_iter().chain(registered).collect()
    }

    /// Returns the policy with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::all().into_iter().find(|(_, own, _)| *own == name).map(|(balance, ..)| balance)
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Registered(policy) => policy.name,
            _ => BUILT_IN.iter().find(|(balance, ..)| *balance == self).map_or("", |(_, name, _)| name),
        }
    }

    /// Creates a policy of this kind for images with this number of rows.
    ///
    /// # Errors
    /// [`StripesError`] if `static` has no stripes for these ratios.
    pub fn policy(self, rows: u32, devices: usize, ratios: &[RatioRule]) -> Result<Box<dyn Policy>, StripesError> {
        Ok(match self {
            Self::Even => Box::new(Even::new(rows, devices)),
            Self::Static => Box::new(Static::new(rows, devices, ratios)?),
            Self::Measured => Box::new(Measured::new(rows, devices)),
            Self::Registered(policy) => (policy.make)(rows, devices),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policy_names_round_trip() {
        for (balance, name, _) in BUILT_IN {
            assert_eq!((balance.name(), Balance::from_name(name)), (name, Some(balance)));
            if balance != Balance::Static {
                assert_eq!(balance.policy(8, 2, &[]).ok().map(|policy| policy.name()), Some(name));
            }
        }
        assert_eq!(Balance::from_name("fair"), None);
    }

    #[test]
    fn registered_policies_are_found_by_their_names() {
        let make = |rows, devices| -> Box<dyn Policy> { Box::new(Even::new(rows, devices)) };
        let halves = Balance::register("halves", "", make).unwrap();
        assert_eq!((halves.name(), Balance::from_name("halves")), ("halves", Some(halves)));
        assert!(halves != Balance::Even && halves.policy(8, 2, &[]).is_ok());
        assert!(["even", "halves"].into_iter().all(|name| Balance::register(name, "", make).is_err()));
    }
}
