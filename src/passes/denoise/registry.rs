//! Registry of denoisers: the built-in ones and those that the program registers, looked up by name.

use std::sync::{PoisonError, RwLock};

use serde::{Deserialize, Deserializer, de::Error};

use super::denoiser::Denoiser;
use super::method::Denoise;
use super::{atrous, bmfr, svgf};

/// The library's denoisers. A new one needs a module with its passes and a line here.
const BUILT_IN: [&dyn Denoise; 4] = [&atrous::Atrous, &svgf::Svgf, &bmfr::Bmfr::DROPPING, &bmfr::Bmfr::NOISY];

/// The denoisers that the program has registered.
static REGISTERED: RwLock<Vec<&'static dyn Denoise>> = RwLock::new(Vec::new());

/// Returns the library's denoisers, then the registered ones.
fn all() -> Vec<&'static dyn Denoise> {
    let registered = REGISTERED.read().unwrap_or_else(PoisonError::into_inner);
    BUILT_IN.into_iter().chain(registered.iter().copied()).collect()
}

impl Denoiser {
    /// Registers a denoiser, so that [`Self::from_name`] finds it. In a run with several ranks, all ranks must register
    /// the same denoisers.
    ///
    /// # Errors
    /// A message if the name is taken or is `none`.
    pub fn register(method: &'static dyn Denoise) -> Result<Self, String> {
        if Self::from_name(method.name()).is_ok() {
            return Err(format!("a denoiser named {} already exists", method.name()));
        }
        REGISTERED.write().unwrap_or_else(PoisonError::into_inner).push(method);
        Ok(Self(method.name()))
    }

    /// Returns all choices: no denoiser, then each denoiser.
    pub fn choices() -> Vec<Option<Self>> {
        std::iter::once(None).chain(all().into_iter().map(|method| Some(Self(method.name())))).collect()
    }

    /// Returns the denoiser with this name, or `None` for the name `none`.
    ///
    /// # Errors
    /// A message that lists all names, if the name is unknown.
    pub fn from_name(name: &str) -> Result<Option<Self>, String> {
        let choices = Self::choices();
        let choice = choices.iter().find(|choice| Self::name_of(**choice) == name).copied();
        choice.ok_or_else(|| {
            let names: Vec<&str> = choices.into_iter().map(Self::name_of).collect();
            format!("the denoiser {name:?} is unknown: choose one of {}", names.join(", "))
        })
    }

    /// Returns true if the denoiser reuses the results of previous frames (history).
    pub fn keeps_history(self) -> bool {
        self.method().keeps_history()
    }

    /// Returns the maximum number of iterations of this denoiser.
    pub fn most_iterations(self) -> u32 {
        self.method().most_iterations()
    }

    /// Returns the implementation: its properties and passes.
    pub fn method(self) -> &'static dyn Denoise {
        let is_named = |method: &&dyn Denoise| method.name() == self.0;
        let built_in = BUILT_IN.into_iter().find(is_named);
        let method = built_in.or_else(|| all().into_iter().find(is_named));
        method.expect("handles are of built-in or registered denoisers")
    }
}

/// Deserializes a denoiser from its name; `none` gives `None`.
///
/// # Errors
/// Errors of the deserializer, and unknown names.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Denoiser>, D::Error> {
    Denoiser::from_name(&String::deserialize(deserializer)?).map_err(D::Error::custom)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn denoiser_names_round_trip() {
        for choice in Denoiser::choices() {
            let name = Denoiser::name_of(choice);
            assert_eq!(Denoiser::from_name(name).unwrap(), choice);
            assert!(choice.is_none_or(|denoiser| (1..=Denoiser::MAX_ITERATIONS).contains(&denoiser.most_iterations())));
        }
    }

    #[test]
    fn constants_name_the_built_in_denoisers() {
        let constants = [Denoiser::ATROUS, Denoiser::SVGF, Denoiser::BMFR, Denoiser::BMFR_NOISE];
        assert_eq!(constants.map(|denoiser| denoiser.0), BUILT_IN.map(|method| method.name()));
    }

    #[test]
    fn no_two_denoisers_have_the_same_name() {
        struct Second;
        impl Denoise for Second {
            fn name(&self) -> &'static str {
                "svgf"
            }

            fn help(&self) -> Option<&'static str> {
                None
            }
        }
        assert!(Denoiser::register(&Second).unwrap_err().contains("svgf"));
        assert_eq!(Denoiser::choices().len(), 1 + BUILT_IN.len());
    }
}
