//! Workgroups of a dispatch over rows of a grid.

use std::ops::Range;

use crate::graph::{Dispatch, Resource};

#[derive(Clone, Debug, PartialEq)]
pub enum Groups {
    Direct([u32; 3]),
    /// Indirect dispatch, with the workgroup counts in the header of this list.
    Listed(Resource),
}

/// Returns the workgroups of a dispatch over `rows` of a grid that has `width` columns. Tiles that are several rows
/// high begin at multiples of their height.
pub fn groups(dispatch: Dispatch, workgroup: [u32; 3], width: u32, rows: &Range<u32>) -> Groups {
    let tiles = |[columns, height]: [u32; 2]| {
        let (columns, height) = (columns.max(1), height.max(1));
        [width.div_ceil(columns), (rows.end.div_ceil(height) - rows.start / height).max(1)]
    };
    match dispatch {
        Dispatch::Invocations(tile) => {
            let [x, y] = tiles(tile);
            Groups::Direct([x.div_ceil(workgroup[0]), y.div_ceil(workgroup[1]), 1])
        }
        Dispatch::Workgroups(tile) => {
            let [x, y] = tiles(tile);
            Groups::Direct([x, y, 1])
        }
        Dispatch::Displaced(tile) => {
            // Maximum number of displaced tiles that overlap a span of this length.
            let most = |length: u32, tile: u32| (length + 2 * (tile.max(1) - 1)) / tile.max(1);
            Groups::Direct([most(width, tile[0]).max(1), most(rows.end - rows.start, tile[1]).max(1), 1])
        }
        Dispatch::Once(groups) => Groups::Direct(groups),
        // Without rows (during warm-up), no pass has filled the list, so dispatch one workgroup directly.
        Dispatch::List(_) if rows.is_empty() => Groups::Direct([1, 1, 1]),
        Dispatch::List(list) => Groups::Listed(list),
    }
}
