//! Damages bytes without knowledge of the format.

use proptest::prelude::*;
use proptest::sample::Index;

#[derive(Clone, Debug)]
pub enum Damage {
    Flip(Index, u8),
    /// Overwrites four bytes, at a multiple of four if the flag is set.
    Word(Index, bool, u32),
    Cut(Index),
    Remove(Index, u8),
    Repeat(Index, u8),
}

/// Values that often break readers, hexadecimal: lengths, counts, and floats that are not finite.
const WORDS: &str = "0 | 1 | 3 | 7f | ff | ffff | 10000 | 7fffffff | 80000000 | fffffffe | ffffffff | 7f800000 | \
    7fc00000 | 7f7fffff";

/// Returns the entries of a list in one text.
pub fn listed(text: &str) -> Vec<&str> {
    text.split('|').map(str::trim).collect()
}

fn word() -> impl Strategy<Value = u32> {
    let hex = |word| u32::from_str_radix(word, 16).expect("it is hexadecimal");
    prop_oneof![proptest::sample::select(listed(WORDS)).prop_map(hex), any::<u32>()]
}

pub fn damage() -> impl Strategy<Value = Damage> {
    prop_oneof![
        4 => (any::<Index>(), any::<u8>()).prop_map(|(at, bits)| Damage::Flip(at, bits)),
        4 => (any::<Index>(), any::<bool>(), word()).prop_map(|(at, aligned, w)| Damage::Word(at, aligned, w)),
        1 => any::<Index>().prop_map(Damage::Cut),
        1 => (any::<Index>(), any::<u8>()).prop_map(|(at, n)| Damage::Remove(at, n)),
        1 => (any::<Index>(), any::<u8>()).prop_map(|(at, n)| Damage::Repeat(at, n)),
    ]
}

pub fn several() -> impl Strategy<Value = Vec<Damage>> {
    prop::collection::vec(damage(), 1..6)
}

pub fn apply(bytes: &mut Vec<u8>, damages: &[Damage]) {
    for damage in damages {
        if bytes.is_empty() {
            return;
        }
        let length = bytes.len();
        match *damage {
            Damage::Flip(at, bits) => bytes[at.index(length)] ^= bits,
            Damage::Word(at, aligned, word) => {
                let at = if aligned { at.index(length) & !3 } else { at.index(length) };
                for (byte, new) in bytes[at..].iter_mut().zip(word.to_le_bytes()) {
                    *byte = new;
                }
            }
            Damage::Cut(at) => bytes.truncate(at.index(length)),
            Damage::Remove(at, n) => {
                let at = at.index(length);
                bytes.drain(at..(at + usize::from(n)).min(length));
            }
            Damage::Repeat(at, n) => {
                let at = at.index(length);
                let part = bytes[at..(at + usize::from(n)).min(length)].to_vec();
                bytes.splice(at..at, part);
            }
        }
    }
}

/// Encodes a picture.
pub fn picture(image: impl Into<image::DynamicImage>, format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.into().write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}
