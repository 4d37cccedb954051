//! URIs in a glTF file. A URI contains bytes (`data:`) or is the path of a file, relative to the glTF file's folder.

use std::borrow::Cow;
use std::path::PathBuf;

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::general_purpose::GeneralPurpose;
use base64::engine::{DecodePaddingMode, GeneralPurposeConfig};
use percent_encoding::percent_decode_str;

use super::fault::{Fault, Outcome};
use crate::scene::budget::{Budget, Held};
use crate::scene::folder::{self, Access, Folder, shorten};

/// Location of the bytes behind a URI.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Target<'a> {
    /// Text after `data:`.
    Data(&'a str),
    /// Canonical path: the same for all names of a file.
    File(PathBuf),
}

impl<'a> Target<'a> {
    pub fn of(uri: &'a str, folder: &Folder) -> Outcome<Self> {
        if let Some(rest) = strip_scheme(uri, "data:") {
            return Ok(Self::Data(rest));
        }
        if has_scheme(uri) {
            return Err(Fault::Invalid(format!("the URI '{}' is not a path: download the file first", shorten(uri))));
        }
        let name = percent_decode_str(uri)
            .decode_utf8()
            .map_err(|_| Fault::Invalid(format!("the URI '{}' is not UTF-8", shorten(uri))))?;
        let path = folder.find(&name)?;
        Ok(Self::File(folder.access.one_path(path)))
    }

    pub fn read<'b>(&self, access: Access<'b>) -> Outcome<Held<'b>> {
        match self {
            Self::Data(rest) => decode_data(rest, access.budget),
            Self::File(path) => folder::read(path, access),
        }
    }
}

/// Returns true if a URI has a scheme (RFC 3986, 3.1). A single letter before the colon counts as a Windows drive, not
/// as a scheme.
fn has_scheme(uri: &str) -> bool {
    let Some((head, _)) = uri.split_once(':') else { return false };
    let within = |c: char| c.is_ascii_alphanumeric() || matches!(c, '+' | '-' | '.');
    head.len() > 1 && head.starts_with(|c: char| c.is_ascii_alphabetic()) && head.chars().all(within)
}

fn strip_scheme<'a>(uri: &'a str, scheme: &str) -> Option<&'a str> {
    let head = uri.get(..scheme.len())?;
    head.eq_ignore_ascii_case(scheme).then(|| &uri[scheme.len()..])
}

fn decode_data<'b>(rest: &str, budget: &'b Budget) -> Outcome<Held<'b>> {
    let Some((head, body)) = rest.split_once(',') else {
        return Err(Fault::Invalid("its data: URI has no comma before the data".into()));
    };
    // Base64 is decoded from the percent-decoded text, which grows during decoding.
    let mut reserved = budget.reserve(2 * body.len() as u64)?;
    let raw = percent_decode_str(body);
    let bytes = if head.to_ascii_lowercase().ends_with(";base64") {
        let lenient = GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
        GeneralPurpose::new(&STANDARD, lenient)
            .decode(Cow::from(raw))
            .map_err(|e| Fault::Invalid(format!("its data: URI is not base64: {e}")))?
    } else {
        Cow::from(raw).into_owned()
    };
    reserved.shrink_to(bytes.capacity() as u64);
    Ok(Held { bytes, reserved })
}
