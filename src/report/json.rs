//! JSON that people can read and that stays small. It has lines and indents down to a depth, and is compact below.

use std::cell::Cell;
use std::fmt;
use std::io::{self, Write};

use serde::de::{self, DeserializeSeed, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::ser::{Error as _, Serialize, SerializeMap, SerializeSeq, Serializer};
use serde_json::ser::Formatter;

/// Members of values nested at most this deep have a line each. Deeper values stand on the line of their parent.
pub struct Lines {
    most: usize,
    depth: usize,
    /// Whether the object or list that was opened last has no member yet.
    is_empty: bool,
}

impl Lines {
    pub fn new(most: usize) -> Self {
        Self { most, depth: 0, is_empty: true }
    }

    fn open<W: ?Sized + Write>(&mut self, to: &mut W, bracket: &[u8]) -> io::Result<()> {
        self.depth += 1;
        self.is_empty = true;
        to.write_all(bracket)
    }

    fn member<W: ?Sized + Write>(&mut self, to: &mut W, is_first: bool) -> io::Result<()> {
        self.is_empty = false;
        if !is_first {
            to.write_all(b",")?;
        }
        if self.depth <= self.most { self.line(to) } else { Ok(()) }
    }

    fn close<W: ?Sized + Write>(&mut self, to: &mut W, bracket: &[u8]) -> io::Result<()> {
        let (is_empty, depth) = (std::mem::take(&mut self.is_empty), self.depth);
        self.depth -= 1;
        if !is_empty && depth <= self.most {
            self.line(to)?;
        }
        to.write_all(bracket)
    }

    fn line<W: ?Sized + Write>(&self, to: &mut W) -> io::Result<()> {
        to.write_all(b"\n")?;
        (0..self.depth).try_for_each(|_| to.write_all(b"  "))
    }
}

impl Formatter for Lines {
    fn begin_array<W: ?Sized + Write>(&mut self, to: &mut W) -> io::Result<()> {
        self.open(to, b"[")
    }

    fn end_array<W: ?Sized + Write>(&mut self, to: &mut W) -> io::Result<()> {
        self.close(to, b"]")
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, to: &mut W, is_first: bool) -> io::Result<()> {
        self.member(to, is_first)
    }

    fn begin_object<W: ?Sized + Write>(&mut self, to: &mut W) -> io::Result<()> {
        self.open(to, b"{")
    }

    fn end_object<W: ?Sized + Write>(&mut self, to: &mut W) -> io::Result<()> {
        self.close(to, b"}")
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, to: &mut W, is_first: bool) -> io::Result<()> {
        self.member(to, is_first)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, to: &mut W) -> io::Result<()> {
        to.write_all(if self.depth <= self.most { b": " } else { b":" })
    }
}

/// JSON text as the value that it says, with members in their order. Serializing it holds one number or string at a time.
pub struct Text<'a>(pub &'a [u8]);

impl Serialize for Text<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Source::new(&mut serde_json::Deserializer::from_slice(self.0)).serialize(serializer)
    }
}

/// A value that is read while it is serialized, once.
struct Source<D>(Cell<Option<D>>);

impl<D> Source<D> {
    fn new(deserializer: D) -> Self {
        Self(Cell::new(Some(deserializer)))
    }
}

impl<'de, D: Deserializer<'de>> Serialize for Source<D> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let deserializer = self.0.take().ok_or_else(|| S::Error::custom("a value was read twice"))?;
        deserializer.deserialize_any(Relay(serializer)).map_err(S::Error::custom)
    }
}

/// Hands a value of JSON to a serializer.
struct Relay<S>(S);

impl<'de, S: Serializer> Visitor<'de> for Relay<S> {
    type Value = S::Ok;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value of JSON")
    }

    fn visit_unit<E: de::Error>(self) -> Result<S::Ok, E> {
        self.0.serialize_unit().map_err(E::custom)
    }

    fn visit_bool<E: de::Error>(self, value: bool) -> Result<S::Ok, E> {
        self.0.serialize_bool(value).map_err(E::custom)
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<S::Ok, E> {
        self.0.serialize_u64(value).map_err(E::custom)
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<S::Ok, E> {
        self.0.serialize_i64(value).map_err(E::custom)
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<S::Ok, E> {
        self.0.serialize_f64(value).map_err(E::custom)
    }

    fn visit_str<E: de::Error>(self, value: &str) -> Result<S::Ok, E> {
        self.0.serialize_str(value).map_err(E::custom)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<S::Ok, A::Error> {
        let mut list = self.0.serialize_seq(None).map_err(de::Error::custom)?;
        while items.next_element_seed(Item(&mut list))?.is_some() {}
        list.end().map_err(de::Error::custom)
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<S::Ok, A::Error> {
        let mut map = self.0.serialize_map(None).map_err(de::Error::custom)?;
        while let Some(name) = members.next_key::<String>()? {
            map.serialize_key(&name).map_err(de::Error::custom)?;
            members.next_value_seed(Member(&mut map))?;
        }
        map.end().map_err(de::Error::custom)
    }
}

/// Hands an item of a list on, or the value of a member.
struct Item<'a, S>(&'a mut S);
struct Member<'a, S>(&'a mut S);

impl<'de, S: SerializeSeq> DeserializeSeed<'de> for Item<'_, S> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        self.0.serialize_element(&Source::new(deserializer)).map_err(de::Error::custom)
    }
}

impl<'de, S: SerializeMap> DeserializeSeed<'de> for Member<'_, S> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        self.0.serialize_value(&Source::new(deserializer)).map_err(de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::{Serializer, Value, json};

    use super::*;

    #[test]
    fn what_is_deep_stands_on_one_line_and_all_of_it_is_read_again() {
        let value = json!({ "a": [], "b": [{ "c": [1, {}] }, { "d": "e" }], "f": {} });
        let mut text = Vec::new();
        value.serialize(&mut Serializer::with_formatter(&mut text, Lines::new(2))).unwrap();
        let text = String::from_utf8(text).unwrap();
        let lines =
            ["{", "  \"a\": [],", "  \"b\": [", "    {\"c\":[1,{}]},", "    {\"d\":\"e\"}", "  ],", "  \"f\": {}", "}"];
        assert_eq!(text.lines().collect::<Vec<_>>(), lines);
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), value);
    }

    #[test]
    fn text_is_the_value_that_it_says_in_its_order() {
        let text = r#"{"z":[1,-2,0.1,1e+300,16777216.0,true,null],"a":{"é\n\"":"\u0000 </"},"empty":[{},[]]}"#;
        assert_eq!(serde_json::to_string(&Text(text.as_bytes())).unwrap(), text);
        for damaged in ["", "{", "[1,", r#"{"a":}"#, "nul"] {
            assert!(serde_json::to_string(&Text(damaged.as_bytes())).is_err(), "{damaged}");
        }
    }
}
