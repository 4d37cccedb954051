//! FNV-1a, 64 bits (Fowler, Noll & Vo; RFC 9923): identical on every machine and with every compiler. It tells contents
//! apart, but does not resist forgery.

use std::fmt;

pub struct Fnv(u64);

impl Fnv {
    pub fn new() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }

    pub fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    /// Returns the hash as 16 hexadecimal digits.
    pub fn hex(&self) -> String {
        format!("{:016x}", self.0)
    }
}

impl fmt::Write for Fnv {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        self.bytes(text.as_bytes());
        Ok(())
    }
}

/// Returns the hash of these bytes as 16 hexadecimal digits.
pub fn hash_of(bytes: &[u8]) -> String {
    let mut fnv = Fnv::new();
    fnv.bytes(bytes);
    fnv.hex()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values are the RFC's test vectors.
    #[test]
    fn hashes_equal_published_test_vectors() {
        for (text, hash) in [("", "cbf29ce484222325"), ("a", "af63dc4c8601ec8c"), ("foobar", "85944171f73967e8")] {
            assert_eq!(hash_of(text.as_bytes()), hash, "{text}");
        }
    }
}
