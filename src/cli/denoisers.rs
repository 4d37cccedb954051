//! The choice of a denoiser on the command line.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use crate::quality::Denoiser;

/// A denoiser or none. The alias hides the `Option` from clap, which would make the argument optional.
pub type DenoiserChoice = Option<Denoiser>;

/// Returns a value parser for denoiser names. The option's help hides denoisers that have no help text.
pub fn denoiser_parser() -> impl TypedValueParser<Value = DenoiserChoice> {
    let value = |choice: DenoiserChoice| {
        let value = PossibleValue::new(Denoiser::name_of(choice));
        match choice.map(|denoiser| denoiser.method().help()) {
            None => value,
            Some(Some(help)) => value.help(help),
            Some(None) => value.hide(true),
        }
    };
    let values: Vec<PossibleValue> = Denoiser::choices().into_iter().map(value).collect();
    PossibleValuesParser::new(values).try_map(|name| Denoiser::from_name(&name))
}
