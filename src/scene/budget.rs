//! Memory budget for reading a scene and building its tables. Memory is reserved before it is allocated. Dropping a
//! temporary reservation returns its bytes to the budget.

use std::cell::Cell;
use std::fmt;
use std::mem;
use std::ops::Deref;
use std::str::FromStr;

/// Number of bytes. Command-line options and messages write it with a unit, such as `4GiB`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ByteSize(pub u64);

impl fmt::Display for ByteSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let units = ["KiB", "MiB", "GiB", "TiB", "PiB", "EiB"];
        let power = self.0.max(1).ilog2() as usize / 10;
        match power.checked_sub(1) {
            None => write!(f, "{} bytes", self.0),
            Some(unit) => write!(f, "{:.1} {}", self.0 as f64 / 1024f64.powi(power as i32), units[unit]),
        }
    }
}

impl FromStr for ByteSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let digits = text.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(text.len());
        let (number, unit) = text.split_at(digits);
        let scale = match unit.trim().to_ascii_lowercase().as_str() {
            "" | "b" => Some(1),
            "kb" => Some(1000),
            "mb" => Some(1000u64.pow(2)),
            "gb" => Some(1000u64.pow(3)),
            "tb" => Some(1000u64.pow(4)),
            "kib" => Some(1 << 10),
            "mib" => Some(1 << 20),
            "gib" => Some(1 << 30),
            "tib" => Some(1 << 40),
            _ => None,
        };
        let bytes = scale.and_then(|scale| Some(number.parse::<f64>().ok()? * scale as f64));
        bytes.filter(|bytes| (1.0..u64::MAX as f64).contains(bytes)).map(|bytes| Self(bytes as u64)).ok_or_else(|| {
            format!("'{text}' is not a size: give a number and B, kB, MB, GB, TB, KiB, MiB, GiB or TiB, such as 4GiB")
        })
    }
}

/// A request for more memory than the budget has left.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "it needs {needed}, but only {left} are left of the scene's memory limit of {limit}: raise the limit if you trust it"
)]
pub struct Exceeded {
    pub needed: ByteSize,
    pub left: ByteSize,
    pub limit: ByteSize,
}

/// Host memory that one scene may still allocate.
#[derive(Debug)]
pub struct Budget {
    limit: ByteSize,
    left: Cell<u64>,
}

impl Default for Budget {
    /// Returns a budget of 8 GiB.
    fn default() -> Self {
        Self::new(ByteSize(8 << 30))
    }
}

impl Budget {
    pub fn new(limit: ByteSize) -> Self {
        Self { limit, left: Cell::new(limit.0) }
    }

    pub fn unlimited() -> Self {
        Self::new(ByteSize(u64::MAX))
    }

    /// Returns the number of bytes left.
    pub fn left(&self) -> u64 {
        self.left.get()
    }

    /// Reserves `bytes` bytes. Dropping the result returns them to the budget.
    ///
    /// # Errors
    /// [`Exceeded`] if fewer than `bytes` bytes are left. In this case, nothing is reserved.
    pub fn reserve(&self, bytes: u64) -> Result<Reserved<'_>, Exceeded> {
        let left = self.left();
        let rest = left.checked_sub(bytes).ok_or(Exceeded {
            needed: ByteSize(bytes),
            left: ByteSize(left),
            limit: self.limit,
        })?;
        self.left.set(rest);
        Ok(Reserved { budget: self, bytes })
    }
}

/// A reserved part of a budget, which is returned on drop.
#[derive(Debug)]
#[must_use]
pub struct Reserved<'a> {
    budget: &'a Budget,
    bytes: u64,
}

impl Reserved<'_> {
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Shrinks the reservation to `bytes` bytes and returns the rest to the budget. Does nothing if the reservation is
    /// not larger than that.
    pub fn shrink_to(&mut self, bytes: u64) {
        let freed = self.bytes.saturating_sub(bytes);
        self.bytes -= freed;
        self.budget.left.set(self.budget.left() + freed);
    }

    /// Keeps the bytes reserved for good, for data that becomes part of the scene.
    pub fn keep(self) {
        mem::forget(self);
    }
}

impl Drop for Reserved<'_> {
    fn drop(&mut self) {
        self.shrink_to(0);
    }
}

/// Data in memory, together with the reservation of that memory.
#[derive(Debug)]
pub struct Held<'a> {
    pub bytes: Vec<u8>,
    pub reserved: Reserved<'a>,
}

impl Deref for Held<'_> {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn byte_sizes_parse_and_print() {
        for (text, bytes) in [("4GiB", 4 << 30), ("800MB", 800_000_000), ("1.5 kib", 1536), ("7", 7), ("12B", 12)] {
            assert_eq!(text.parse(), Ok(ByteSize(bytes)), "{text}");
        }
        for text in ["", "GiB", "0", "0.1", "-1", "1e3", "4G", "4 GiB x", "1.2.3MB", "999999999TiB", "nan", "inf"] {
            let error = text.parse::<ByteSize>().unwrap_err();
            assert!(error.contains(&format!("'{text}'")) && error.contains("GiB"), "{error}");
        }
        for (bytes, text) in [(0, "0 bytes"), (1023, "1023 bytes"), (1024, "1.0 KiB"), (3 << 29, "1.5 GiB")] {
            assert_eq!(ByteSize(bytes).to_string(), text);
        }
        assert_eq!(ByteSize(u64::MAX).to_string(), "16.0 EiB");
    }

    #[test]
    fn reservations_return_to_the_budget_unless_kept() {
        let budget = Budget::new(ByteSize(100));
        let first = budget.reserve(60).unwrap();
        let exceeded = budget.reserve(41).unwrap_err();
        assert_eq!(exceeded, Exceeded { needed: ByteSize(41), left: ByteSize(40), limit: ByteSize(100) });
        let mut second = budget.reserve(40).unwrap();
        second.shrink_to(10);
        second.shrink_to(20);
        assert_eq!(budget.left(), 30);
        drop(first);
        assert_eq!(budget.left(), 90);
        second.keep();
        assert_eq!(budget.left(), 90);
    }
}
