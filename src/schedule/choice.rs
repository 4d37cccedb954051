//! Load-balancing policies by name: the built-in ones and those that the program registers.

use std::sync::{Arc, PoisonError, RwLock};

use super::{Even, Heft, Measured, Policy, RatioRule, Static};
use crate::graph::StripesError;

/// A load-balancing policy: distributes rows among devices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Balance {
    Even,
    Static,
    Measured,
    Heft,
    /// A policy that the program has registered under this name.
    Registered(&'static str),
}

/// Built-in policies with their names and help texts.
const BUILT_IN: [(Balance, &str, &str); 4] = [
    (Balance::Even, "even", "The same number of rows for every device"),
    (Balance::Static, "static", "Fixed fractions from ratios"),
    (Balance::Measured, "measured", "By measured cost of past frames"),
    (Balance::Heft, "heft", "List scheduling of row blocks at measured cost"),
];

type Make = dyn Fn(u32, usize) -> Box<dyn Policy> + Send + Sync;

/// A policy that the program has registered.
#[derive(Clone)]
struct Registered {
    name: &'static str,
    help: &'static str,
    make: Arc<Make>,
}

static REGISTERED: RwLock<Vec<Registered>> = RwLock::new(Vec::new());

fn registered() -> Vec<Registered> {
    REGISTERED.read().unwrap_or_else(PoisonError::into_inner).clone()
}

impl Balance {
    /// Registers a policy, so that [`Self::from_name`] finds it. `make` constructs it for the rows of an image and a number
    /// of devices.
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
        let make: Arc<Make> = Arc::new(make);
        REGISTERED.write().unwrap_or_else(PoisonError::into_inner).push(Registered { name, help, make });
        Ok(Self::Registered(name))
    }

    /// Returns all names of policies with their help texts.
    pub fn names() -> Vec<(&'static str, &'static str)> {
        let built_in = BUILT_IN.map(|(_, name, help)| (name, help)).into_iter();
        built_in.chain(registered().into_iter().map(|policy| (policy.name, policy.help))).collect()
    }

    /// Returns the policy with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        let built_in = BUILT_IN.iter().find(|(_, own, _)| *own == name).map(|(balance, ..)| *balance);
        built_in.or_else(|| registered().iter().find(|p| p.name == name).map(|p| Self::Registered(p.name)))
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Even => "even",
            Self::Static => "static",
            Self::Measured => "measured",
            Self::Heft => "heft",
            Self::Registered(name) => name,
        }
    }

    /// Creates a policy of this kind for images with this number of rows.
    ///
    /// # Errors
    /// [`StripesError`] if `static` has no stripes for these ratios.
    pub fn policy(self, rows: u32, devices: usize, ratios: &[RatioRule]) -> Result<Box<dyn Policy>, StripesError> {
        let make = |name| registered().into_iter().find(|policy| policy.name == name).map(|policy| policy.make);
        Ok(match self {
            Self::Even => Box::new(Even::new(rows, devices)),
            Self::Static => Box::new(Static::new(rows, devices, ratios)?),
            Self::Measured => Box::new(Measured::new(rows, devices)),
            Self::Heft => Box::new(Heft::new(rows, devices)),
            Self::Registered(name) => make(name).expect("policies are never removed")(rows, devices),
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
}
