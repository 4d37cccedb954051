//! Containers: splits a `.gltf` or `.glb` into its parsed JSON and its binary chunk.

use std::borrow::Cow;

use ::gltf::json::{Material, Root};
use serde::Deserialize;
use serde::de::IgnoredAny;
use serde_json::{Value, json};

use super::animations::Animations;
use super::fault::{Fault, Outcome};
use crate::scene::budget::{Budget, Reserved};

const MAGIC: &[u8] = b"glTF";
const CHUNK_JSON: u32 = u32::from_le_bytes(*b"JSON");
const CHUNK_BIN: u32 = u32::from_le_bytes(*b"BIN\0");

/// Upper bounds on the bytes that the parser allocates per object and per element of the JSON, including the spare
/// capacity of growing lists, and on the bytes that it allocates in addition per material.
const OBJECT_BYTES: u64 = 1024;
const ELEMENT_BYTES: u64 = 96;
const MATERIAL_BYTES: u64 = 3 * size_of::<Material>() as u64;

pub struct Container<'a, 'b> {
    pub root: Root,
    pub animations: Animations,
    pub bin: Option<&'a [u8]>,
    _reserved: Reserved<'b>,
}

pub fn parse<'a, 'b>(bytes: &'a [u8], budget: &'b Budget) -> Outcome<Container<'a, 'b>> {
    if bytes.is_empty() {
        return Err(Fault::Invalid("it is empty".into()));
    }
    let (json, bin) = if bytes.starts_with(MAGIC) { split_chunks(bytes)? } else { (bytes, None) };
    let json = json.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(json);
    let reserved = budget.reserve(parsing_bytes(json))?;
    let json = &*with_whole_numbers(json);
    let root: Root = Root::from_slice(json).or_else(|error| {
        let invalid = |error: String| Fault::Invalid(format!("its JSON is not valid glTF 2.0: {error}"));
        // The plain JSON values take memory in addition to the parsed structure.
        let _values = budget.reserve(parsing_bytes(json))?;
        let value = serde_json::from_slice(json).map_err(|_| invalid(error.to_string()))?;
        // The first error knows its line, but may be about a part that is completed.
        serde_json::from_value(complete(value)).map_err(|second| {
            let is_same = error.to_string().starts_with(&second.to_string());
            invalid(if is_same { error.to_string() } else { second.to_string() })
        })
    })?;
    check_version(&root)?;
    let animations = if root.animations.is_empty() { Ok(Animations::default()) } else { serde_json::from_slice(json) };
    let animations = animations.map_err(|error| Fault::Invalid(format!("its JSON is not valid glTF 2.0: {error}")))?;
    Ok(Container { root, animations, bin, _reserved: reserved })
}

/// Returns an upper bound on the bytes of the parsed JSON, which may be hundreds of times the length of its text.
fn parsing_bytes(json: &[u8]) -> u64 {
    #[derive(Default, Deserialize)]
    struct Lists {
        #[serde(default)]
        materials: Vec<IgnoredAny>,
    }
    let (mut objects, mut elements, mut in_string, mut escaped) = (0, 0, false, false);
    for &byte in json {
        match byte {
            _ if escaped => escaped = false,
            b'\\' => escaped = in_string,
            b'"' => in_string = !in_string,
            b'{' if !in_string => objects += 1,
            b',' | b'[' if !in_string => elements += 1,
            _ => {}
        }
    }
    let materials = serde_json::from_slice::<Lists>(json).unwrap_or_default().materials.len() as u64;
    3 * json.len() as u64 + objects * OBJECT_BYTES + elements * ELEMENT_BYTES + materials * MATERIAL_BYTES
}

/// Replaces fractions of zeros by spaces: some programs write whole numbers with a fraction, as in `"count": 3.0`, which the
/// parser does not take for an index or a count. The text keeps its length, so that errors name the right column.
fn with_whole_numbers(json: &[u8]) -> Cow<'_, [u8]> {
    let mut text = Cow::Borrowed(json);
    let (mut at, mut in_string) = (0, false);
    while at < json.len() {
        match json[at] {
            b'\\' if in_string => at += 1,
            b'"' => in_string = !in_string,
            b'.' if !in_string && at > 0 && json[at - 1].is_ascii_digit() => {
                let zeros = json[at + 1..].iter().take_while(|byte| **byte == b'0').count();
                let end = at + 1 + zeros;
                let goes_on = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'e' | b'E');
                if zeros > 0 && !json.get(end).is_some_and(goes_on) {
                    text.to_mut()[at..end].fill(b' ');
                }
            }
            _ => {}
        }
        at += 1;
    }
    text
}

/// Changes the JSON so that the parser accepts it. Adds an empty list of nodes to scenes without one, which glTF allows
/// but the parser does not. Replaces all animations by a single empty one: animations are read separately, and those
/// with extensions may lack parts that the parser requires.
fn complete(mut json: Value) -> Value {
    for scene in json.get_mut("scenes").and_then(Value::as_array_mut).into_iter().flatten() {
        if let Some(scene) = scene.as_object_mut() {
            scene.entry("nodes").or_insert_with(|| json!([]));
        }
    }
    if let Some(animations) = json.get_mut("animations") {
        *animations = json!([{"channels": [], "samplers": []}]);
    }
    json
}

fn check_version(root: &Root) -> Outcome<()> {
    let asset = &root.asset;
    let newer = asset.min_version.as_deref().is_some_and(|v| v != "2.0");
    if !asset.version.starts_with("2.") || newer {
        let version = asset.min_version.as_ref().filter(|_| newer).unwrap_or(&asset.version);
        return Err(Fault::Invalid(format!("it asks for glTF version {version}, diptych reads 2.0")));
    }
    Ok(())
}

/// Returns the JSON and binary chunks of a GLB. Ignores chunks of other types.
fn split_chunks(bytes: &[u8]) -> Outcome<(&[u8], Option<&[u8]>)> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(Fault::Invalid("its GLB header is cut short".into()));
    };
    if version != 2 {
        return Err(Fault::Invalid(format!("its GLB container has version {version}, diptych reads 2")));
    }
    let length = length as usize;
    if length > bytes.len() {
        return Err(Fault::Invalid(format!("it is cut short: {} of {length} bytes are there", bytes.len())));
    }
    let (mut json, mut bin) = (None, None);
    let mut at = 12;
    while at + 8 <= length {
        let (Some(size), Some(kind)) = (word(at), word(at + 4)) else { break };
        let start = at + 8;
        let end = start.saturating_add(size as usize);
        if end > length {
            return Err(Fault::Invalid(format!("its GLB chunk at byte {at} runs past the end of the file")));
        }
        match kind {
            CHUNK_JSON if json.is_none() => json = Some(&bytes[start..end]),
            CHUNK_BIN if bin.is_none() => bin = Some(&bytes[start..end]),
            _ => {}
        }
        at = end;
    }
    let json = json.ok_or_else(|| Fault::Invalid("its GLB container holds no JSON chunk".into()))?;
    Ok((json, bin))
}
