//! Fetches the bytes behind a URI of a glTF file: a `data:` URI or a file beside it.

use std::fs;
use std::io;
use std::path::Path;

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::general_purpose::GeneralPurpose;
use base64::engine::{DecodePaddingMode, GeneralPurposeConfig};
use percent_encoding::percent_decode_str;

use super::fault::{Fault, Outcome};

/// Reads a whole regular file; pipes and devices, which may never end, are refused.
pub fn read_file(path: &Path) -> Outcome<Vec<u8>> {
    let attempt = || {
        if !fs::metadata(path)?.is_file() {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "it is not a regular file"));
        }
        fs::read(path)
    };
    attempt().map_err(|source| Fault::Read { path: path.display().to_string(), source })
}

pub fn fetch(base: &Path, uri: &str) -> Outcome<Vec<u8>> {
    if let Some(rest) = strip_scheme(uri, "data:") {
        return decode_data(rest);
    }
    if uri.contains("://") {
        return Err(Fault::Invalid(format!("'{}' is not a file beside it: download it first", shorten(uri))));
    }
    let name = percent_decode_str(uri)
        .decode_utf8()
        .map_err(|_| Fault::Invalid(format!("the URI '{}' is not UTF-8", shorten(uri))))?;
    if name.contains('\0') {
        return Err(Fault::Invalid(format!("the URI '{}' names no file", shorten(uri))));
    }
    read_file(&base.join(name.as_ref()))
}

/// The URI as it can be shown: whole, or its beginning.
pub fn shorten(uri: &str) -> String {
    const SHOWN: usize = 80;
    match uri.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}...", &uri[..end]),
        None => uri.to_owned(),
    }
}

fn strip_scheme<'a>(uri: &'a str, scheme: &str) -> Option<&'a str> {
    let head = uri.get(..scheme.len())?;
    head.eq_ignore_ascii_case(scheme).then(|| &uri[scheme.len()..])
}

fn decode_data(rest: &str) -> Outcome<Vec<u8>> {
    let Some((head, body)) = rest.split_once(',') else {
        return Err(Fault::Invalid("its data: URI has no comma before the data".into()));
    };
    let raw = percent_decode_str(body);
    if !head.to_ascii_lowercase().ends_with(";base64") {
        return Ok(raw.collect());
    }
    let lenient = GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
    GeneralPurpose::new(&STANDARD, lenient)
        .decode(raw.collect::<Vec<u8>>())
        .map_err(|e| Fault::Invalid(format!("its data: URI is not base64: {e}")))
}
