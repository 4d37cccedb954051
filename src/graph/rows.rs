//! Arithmetic on ranges of rows: widening, rescaling, intersection and difference.

use std::ops::Range;

pub fn widen(rows: &Range<u32>, by: u32, height: u32) -> Range<u32> {
    rows.start.saturating_sub(by)..rows.end.saturating_add(by).min(height)
}

/// Rescales a range of rows from an image with `from` rows to an image with `to` rows. Adjacent ranges stay adjacent,
/// so a partition of the first image becomes a partition of the second.
pub fn share(rows: &Range<u32>, from: u32, to: u32) -> Range<u32> {
    let edge = |row: u32| (u64::from(row) * u64::from(to)).div_ceil(u64::from(from.max(1))) as u32;
    edge(rows.start)..edge(rows.end)
}

/// Rescales a range of rows from an image with `from` rows to an image with `to` rows. Rounds outwards, to all rows
/// that the range overlaps even in part, so adjacent ranges may become overlapping ones.
pub fn scale(rows: &Range<u32>, from: u32, to: u32) -> Range<u32> {
    let (from, to) = (u64::from(from.max(1)), u64::from(to));
    let begin = u64::from(rows.start) * to / from;
    let end = (u64::from(rows.end) * to).div_ceil(from);
    begin as u32..end as u32
}

pub fn overlap(a: &Range<u32>, b: &Range<u32>) -> Option<Range<u32>> {
    let both = a.start.max(b.start)..a.end.min(b.end);
    (!both.is_empty()).then_some(both)
}

pub fn subtract(from: &Range<u32>, hole: &Range<u32>) -> impl Iterator<Item = Range<u32>> + use<> {
    let above = from.start..hole.start.clamp(from.start, from.end);
    let below = hole.end.clamp(from.start, from.end)..from.end;
    let parts = if overlap(from, hole).is_some() { [above, below] } else { [from.clone(), 0..0] };
    parts.into_iter().filter(|r| !r.is_empty())
}
