//! Load-balancing policies of `--balance`: the built-in ones and those that a [`Program`](super::Program) registers.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use super::failure::Failure;
use super::registry::registered;
use diptych::schedule::{Even, Heft, Measured, Policy, RatioRule, Static};

/// A load-balancing policy: distributes rows among devices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Balance {
    Even,
    Static,
    Measured,
    Heft,
    /// Index into the policies that the program registered.
    Registered(usize),
}

/// Built-in policies with their names and help texts.
pub const BUILT_IN: [(Balance, &str, &str); 4] = [
    (Balance::Even, "even", "The same number of rows for every device"),
    (Balance::Static, "static", "Fixed fractions from --ratios"),
    (Balance::Measured, "measured", "By measured cost of past frames"),
    (Balance::Heft, "heft", "List scheduling of row blocks at measured cost"),
];

impl Balance {
    /// Returns a value parser for policy names. The option's help lists all of them.
    pub fn value_parser() -> impl TypedValueParser<Value = Self> {
        let built_in = BUILT_IN.map(|(_, name, help)| (name, help)).into_iter();
        let all = built_in.chain(registered().policies.iter().map(|policy| (policy.name, policy.help)));
        let values: Vec<PossibleValue> = all.map(|(name, help)| PossibleValue::new(name).help(help)).collect();
        PossibleValuesParser::new(values)
            .try_map(|name| Self::from_name(&name).ok_or_else(|| format!("there is no policy {name}")))
    }

    /// Returns the policy with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        let built_in = BUILT_IN.iter().find(|(_, own, _)| *own == name).map(|(balance, ..)| *balance);
        built_in.or_else(|| registered().policies.iter().position(|p| p.name == name).map(Self::Registered))
    }

    pub fn name(self) -> &'static str {
        match self {
            Self::Even => "even",
            Self::Static => "static",
            Self::Measured => "measured",
            Self::Heft => "heft",
            Self::Registered(place) => registered().policies[place].name,
        }
    }

    /// Creates a policy of this kind for images with this number of rows.
    pub fn policy(self, rows: u32, devices: usize, ratios: &[RatioRule]) -> Result<Box<dyn Policy>, Failure> {
        Ok(match self {
            Self::Even => Box::new(Even::new(rows, devices)),
            Self::Static => Box::new(Static::new(rows, devices, ratios)?),
            Self::Measured => Box::new(Measured::new(rows, devices)),
            Self::Heft => Box::new(Heft::new(rows, devices)),
            Self::Registered(place) => (registered().policies[place].make)(rows, devices),
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
