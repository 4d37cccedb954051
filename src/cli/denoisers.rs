//! The choice of a denoiser on the command line.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use crate::quality::Denoiser;

/// A denoiser or none. clap takes an `Option` by that name for an option that may be left out.
pub type DenoiserChoice = Option<Denoiser>;

/// Returns the parser of a denoiser's name, for an option. Its help lists all names.
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
