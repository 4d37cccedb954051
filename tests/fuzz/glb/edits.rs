//! Edits of valid files.

use super::*;

/// Values as text, because `serde_json` would change some numbers that JSON allows.
pub(super) const VALUES: &str = r#"0 | -1 | 1 | 2 | 3 | 4 | 5 | 7 | 12 | 48 | 255 | 65535 | 65536 | 5120 | 5121 | 5123 | 5125 | 5126 |
    16777216 | 100000000 | 2147483647 | 4294967295 | 4294967296 | 9007199254740993 | 18446744073709551615 |
    1e300 | -1e300 | 3.5e38 | 1e38 | -1e38 | 1e-45 | 1e-30 | 0.5 | 1.5707964 | 3.2 | true | null | "" |
    "VEC2" | "SCALAR" | "MAT4" | "BLEND" | "data:application/octet-stream;base64,AAAAAAAAAAA=" |
    "/dev/zero" | [] | {}"#;

#[derive(Clone, Debug)]
pub(super) enum Edit {
    /// Replaces a leaf of the JSON by another value.
    Leaf(Index, &'static str),
    /// Replaces a leaf by the value of another.
    Swap(Index, Index),
    /// Removes a member, or renames it like another.
    Drop(Index),
    Rename(Index, Index),
    /// Repeats an element of an array.
    Again(Index),
    Binary(Damage),
    Text(Damage),
    Lengths([i32; 3]),
    Whole(Damage),
}

pub(super) fn edit() -> impl Strategy<Value = Edit> {
    let index = any::<Index>;
    let off = || prop_oneof![3 => Just(0), 1 => -8..8i32, 1 => any::<i32>()];
    prop_oneof![
        8 => (index(), select(bytes::listed(VALUES))).prop_map(|(at, v)| Edit::Leaf(at, v)),
        2 => (index(), index()).prop_map(|(at, from)| Edit::Swap(at, from)),
        2 => index().prop_map(Edit::Drop),
        1 => (index(), index()).prop_map(|(at, to)| Edit::Rename(at, to)),
        1 => index().prop_map(Edit::Again),
        5 => bytes::damage().prop_map(Edit::Binary),
        1 => bytes::damage().prop_map(Edit::Text),
        1 => [off(), off(), off()].prop_map(Edit::Lengths),
        2 => bytes::damage().prop_map(Edit::Whole),
    ]
}

/// Returns JSON pointers to all values below the root, or only to leaves.
pub(super) fn pointers(value: &Value, leaves_only: bool) -> Vec<String> {
    let mut out = Vec::new();
    let mut open = vec![(String::new(), value)];
    while let Some((at, value)) = open.pop() {
        let is_leaf = !(value.is_object() || value.is_array());
        if !at.is_empty() && (is_leaf || !leaves_only) {
            out.push(at.clone());
        }
        match value {
            Value::Object(members) => open.extend(members.iter().map(|(k, v)| (format!("{at}/{k}"), v))),
            Value::Array(elements) => open.extend(elements.iter().enumerate().map(|(i, v)| (format!("{at}/{i}"), v))),
            _ => {}
        }
    }
    out
}

pub(super) fn chosen(json: &Value, at: Index, leaves_only: bool) -> Option<String> {
    let all = pointers(json, leaves_only);
    (!all.is_empty()).then(|| at.get(&all).clone())
}

/// Returns the parent of a pointer's target, and the last step of the pointer.
pub(super) fn parent<'a>(json: &'a mut Value, pointer: &str) -> Option<(&'a mut Value, String)> {
    let (above, last) = pointer.rsplit_once('/')?;
    Some((json.pointer_mut(above)?, last.to_owned()))
}

/// Returns a placeholder for a value that is inserted as text.
pub(super) fn mark(i: usize) -> String {
    format!("@{i}@")
}

pub(super) fn edit_json(json: &mut Value, edit: &Edit, texts: &mut Vec<&'static str>) -> Option<()> {
    match *edit {
        Edit::Leaf(at, value) => {
            let pointer = chosen(json, at, true)?;
            *json.pointer_mut(&pointer)? = Value::String(mark(texts.len()));
            texts.push(value);
        }
        Edit::Swap(at, from) => {
            let value = json.pointer(&chosen(json, from, false)?)?.clone();
            let pointer = chosen(json, at, false)?;
            *json.pointer_mut(&pointer)? = value;
        }
        Edit::Drop(at) | Edit::Rename(at, _) | Edit::Again(at) => {
            let name = if let Edit::Rename(_, to) = *edit { chosen(json, to, false) } else { None };
            let pointer = chosen(json, at, false)?;
            let (above, last) = parent(json, &pointer)?;
            match above {
                Value::Object(members) => {
                    let value = members.remove(&last)?;
                    if let Some(name) = name {
                        members.insert(name.rsplit('/').next()?.to_owned(), value);
                    }
                }
                Value::Array(elements) => {
                    let at: usize = last.parse().ok()?;
                    match edit {
                        Edit::Again(_) => elements.push(elements.get(at)?.clone()),
                        _ => drop(elements.remove(at)),
                    }
                }
                _ => {}
            }
        }
        _ => {}
    }
    Some(())
}

pub(super) fn apply(seed: &Draft, edits: &[Edit]) -> Vec<u8> {
    let mut draft = seed.clone();
    let mut texts = Vec::new();
    let mut lengths = [0; 3];
    for edit in edits {
        match edit {
            Edit::Binary(damage) => bytes::apply(&mut draft.bin, std::slice::from_ref(damage)),
            Edit::Lengths(off) => lengths = *off,
            Edit::Text(_) | Edit::Whole(_) => {}
            _ => {
                let _ = edit_json(&mut draft.json, edit, &mut texts);
            }
        }
    }
    let mut json = draft.json.to_string();
    for (i, text) in texts.iter().enumerate() {
        json = json.replacen(&format!("\"{}\"", mark(i)), text, 1);
    }
    let mut json = json.into_bytes();
    for edit in edits {
        if let Edit::Text(damage) = edit {
            bytes::apply(&mut json, std::slice::from_ref(damage));
        }
    }
    let mut whole = draft.pack(String::from_utf8_lossy(&json).into_owned(), lengths);
    for edit in edits {
        if let Edit::Whole(damage) = edit {
            bytes::apply(&mut whole, std::slice::from_ref(damage));
        }
    }
    whole
}
