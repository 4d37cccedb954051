//! The text of settings' values, which flags, files and Python share.

use std::path::PathBuf;
use std::str::FromStr;

use serde_json::Value as Json;

use crate::control::ControllerKind;
use crate::frame::Disturbance;
use crate::image::Extent;
use crate::projection::LogPolar;
use crate::quality::Denoiser;
use crate::samples::Samples;
use crate::scene::budget::ByteSize;
use crate::schedule::RatioRule;

/// A word that a setting may have, with its meaning. Help leaves out words without one.
pub type Word = (&'static str, Option<&'static str>);

/// A type of settings.
pub trait Value: Sized {
    /// The text of no value.
    const NONE: &'static str = "auto";

    /// Form of the text, such as `N`.
    const FORM: &'static str;

    /// Form of a list of values.
    const LIST_FORM: &'static str = "LIST";

    /// The character between the items of a list of values.
    const SEPARATOR: char = ',';

    /// True for lists.
    const IS_LIST: bool = false;

    /// True if texts of numbers mean numbers. Names and paths may look like numbers, too.
    const IS_NUMBER: bool = false;

    /// Returns all possible texts, unless they are numbers.
    fn words() -> Vec<Word> {
        Vec::new()
    }

    /// Reads a value from its text.
    fn parse(text: &str) -> Result<Self, String>;

    /// Returns the value's text, which [`Self::parse`] reads.
    fn text(&self) -> String;

    /// Returns the value for files: numbers and lists of them as such, all others as text.
    fn json(&self) -> Json {
        if Self::IS_NUMBER { json_of(&self.text()) } else { self.text().into() }
    }
}

/// Returns the text of a value in a file or a keyword: items of a list have commas between them, and truth is `on`.
///
/// # Errors
/// A message if the value is a table or nothing.
pub fn text_of(value: &Json) -> Result<String, String> {
    match value {
        Json::String(text) => Ok(text.clone()),
        Json::Bool(is_on) => Ok(is_on.text()),
        Json::Number(number) => Ok(number.to_string()),
        Json::Array(items) => Ok(items.iter().map(text_of).collect::<Result<Vec<_>, _>>()?.join(",")),
        Json::Object(_) | Json::Null => Err("give a text, a number, a truth value or a list of them".to_owned()),
    }
}

/// Returns a text as a number or a list of numbers if it is one.
fn json_of(text: &str) -> Json {
    let number = |text: &str| -> Option<Json> {
        let whole = text.parse::<i64>().ok().map(Json::from);
        whole.or_else(|| text.parse().ok().filter(|n: &f64| n.is_finite()).map(Json::from))
    };
    let list = || text.split(',').map(number).collect::<Option<Vec<_>>>().map(Json::from);
    number(text).or_else(list).unwrap_or_else(|| text.into())
}

impl<T: Value> Value for Option<T> {
    const FORM: &'static str = T::FORM;

    const IS_NUMBER: bool = T::IS_NUMBER;

    fn words() -> Vec<Word> {
        let words = T::words();
        if words.is_empty() { words } else { words.into_iter().chain([(T::NONE, None)]).collect() }
    }

    fn parse(text: &str) -> Result<Self, String> {
        if text == T::NONE { Ok(None) } else { T::parse(text).map(Some) }
    }

    fn text(&self) -> String {
        self.as_ref().map_or(T::NONE.to_owned(), T::text)
    }

    fn json(&self) -> Json {
        self.as_ref().map_or(T::NONE.into(), T::json)
    }
}

/// Implements [`Value`] for types that have a text already. A text after `else` replaces the message of the type.
macro_rules! texts {
    ($($type:ty: $form:literal $(else $else:literal)? $(, $name:ident: $const:ty = $value:expr)*;)+) => {$(
        impl Value for $type {
            const FORM: &'static str = $form;

            $(const $name: $const = $value;)*

            fn parse(text: &str) -> Result<Self, String> {
                text.trim().parse()$(.map_err(|_| $else.to_owned()))?
            }

            fn text(&self) -> String {
                self.to_string()
            }
        }
    )+};
}

texts! {
    u16: "N" else "not a whole number from 0 to 65535", IS_NUMBER: bool = true;
    u32: "N" else "not a whole number from 0 to 4294967295", IS_NUMBER: bool = true;
    usize: "N" else "not a whole number", IS_NUMBER: bool = true;
    f32: "V" else "not a number", IS_NUMBER: bool = true;
    f64: "V" else "not a number", IS_NUMBER: bool = true;
    String: "NAME" else "not a text";
    ByteSize: "SIZE" else "not a size, such as 4GiB";
    Extent: "WxH" else "not a size, such as 640x360, of at least 1 and at most 16384 pixels a side";
    RatioRule: "A,B,…", LIST_FORM: &'static str = "A,B,…", SEPARATOR: char = ';';
    Disturbance: "WHAT@WHEN", LIST_FORM: &'static str = "WHAT@WHEN";
    ControllerKind: "NAME", LIST_FORM: &'static str = "NAME";
}

/// Returns the numbers of a list with commas.
pub(super) fn numbers<T: FromStr>(text: &str) -> Option<Vec<T>> {
    text.split(',').map(|number| number.trim().parse().ok()).collect()
}

impl Value for Samples {
    const FORM: &'static str = "N";

    const IS_NUMBER: bool = true;

    fn parse(text: &str) -> Result<Self, String> {
        text.parse()
    }

    fn text(&self) -> String {
        self.mean().to_string()
    }
}

impl Value for [u32; 3] {
    const FORM: &'static str = "M[,N,P]";

    const IS_NUMBER: bool = true;

    fn parse(text: &str) -> Result<Self, String> {
        match numbers(text).as_deref() {
            Some(&[all]) => Ok([all; 3]),
            Some(&[inner, middle, outer]) => Ok([inner, middle, outer]),
            _ => Err("neither one nor three whole numbers".to_owned()),
        }
    }

    fn text(&self) -> String {
        let [inner, middle, outer] = self;
        if inner == middle && middle == outer { inner.to_string() } else { format!("{inner},{middle},{outer}") }
    }
}

impl Value for LogPolar {
    const FORM: &'static str = "MODE";

    const IS_NUMBER: bool = true;

    fn parse(text: &str) -> Result<Self, String> {
        text.parse()
    }

    fn text(&self) -> String {
        let preset = Self::PRESETS.iter().find(|(_, preset)| preset == self);
        preset.map_or_else(|| self.to_string(), |(name, _)| (*name).to_owned())
    }
}

impl Value for Denoiser {
    const NONE: &'static str = "none";

    const FORM: &'static str = "NAME";

    fn words() -> Vec<Word> {
        let all = Self::choices().into_iter().flatten();
        all.map(|denoiser| (Self::name_of(Some(denoiser)), denoiser.method().help())).collect()
    }

    fn parse(text: &str) -> Result<Self, String> {
        Self::from_name(text)?.ok_or_else(|| "no denoiser".to_owned())
    }

    fn text(&self) -> String {
        Self::name_of(Some(*self)).to_owned()
    }
}

impl<T: Value> Value for Vec<T> {
    const FORM: &'static str = if T::IS_NUMBER { "N,N,…" } else { T::LIST_FORM };

    const SEPARATOR: char = T::SEPARATOR;

    const IS_LIST: bool = true;

    fn words() -> Vec<Word> {
        T::words()
    }

    fn parse(text: &str) -> Result<Self, String> {
        if text.is_empty() {
            return Ok(Self::new());
        }
        text.split(T::SEPARATOR).map(|item| T::parse(item.trim())).collect()
    }

    fn text(&self) -> String {
        self.iter().map(T::text).collect::<Vec<_>>().join(T::SEPARATOR.encode_utf8(&mut [0; 4]))
    }

    fn json(&self) -> Json {
        self.iter().map(T::json).collect()
    }
}

impl Value for PathBuf {
    const FORM: &'static str = "PATH";

    fn parse(text: &str) -> Result<Self, String> {
        Ok(text.into())
    }

    fn text(&self) -> String {
        self.display().to_string()
    }
}
