//! JSON that people can read and that stays small. It has lines and indents down to a depth, and is compact below.

use std::io::{self, Write};

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

#[cfg(test)]
mod tests {
    use serde::Serialize;
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
}
