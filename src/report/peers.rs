//! What other renderers take and how wrong they are, from a file, to stand beside what was measured here.

use std::io;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::bench::Row;
use super::plot::Series;
use super::table::Table;

#[derive(Debug, thiserror::Error)]
pub enum PeersError {
    #[error("cannot read the peers {path}")]
    Read { path: PathBuf, source: io::Error },
    #[error("{path} names no peers: write [[peer]] with name, time_ms, flip and perhaps note, as in docs/peers")]
    File { path: PathBuf, source: Box<PeersError> },
    #[error("it does not have the form of peers: {0}")]
    Form(#[from] Box<toml::de::Error>),
    #[error("it has no [[peer]]")]
    Empty,
    #[error("peer {number} ({name}): {what}")]
    Peer { number: usize, name: String, what: String },
}

/// A renderer with some settings.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Peer {
    /// Those of one name are joined by a line.
    pub name: String,
    /// Of a stereo frame.
    pub time_ms: f64,
    /// Above 0, at most 1.
    pub flip: f64,
    /// Its settings.
    #[serde(default)]
    pub note: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    peer: Vec<Peer>,
}

/// From the text of a file.
///
/// # Errors
/// [`PeersError::Form`], [`PeersError::Empty`], and [`PeersError::Peer`] for the first whose numbers are out of range.
pub fn parse(text: &str) -> Result<Vec<Peer>, PeersError> {
    let File { peer: peers } = toml::from_str(text).map_err(Box::new)?;
    for (i, peer) in peers.iter().enumerate() {
        let refuse = |what: String| Err(PeersError::Peer { number: i + 1, name: peer.name.clone(), what });
        if peer.name.trim().is_empty() {
            return refuse("its name is empty".to_owned());
        }
        if !(peer.time_ms > 0.0 && peer.time_ms.is_finite()) {
            return refuse(format!("time_ms {} is not a time above 0", peer.time_ms));
        }
        if !(peer.flip > 0.0 && peer.flip <= 1.0) {
            return refuse(format!("flip {} is not above 0 and at most 1", peer.flip));
        }
    }
    if peers.is_empty() { Err(PeersError::Empty) } else { Ok(peers) }
}

/// # Errors
/// [`PeersError::Read`], [`PeersError::File`].
pub fn read(path: &Path) -> Result<Vec<Peer>, PeersError> {
    let text = std::fs::read_to_string(path).map_err(|source| PeersError::Read { path: path.to_owned(), source })?;
    parse(&text).map_err(|source| PeersError::File { path: path.to_owned(), source: Box::new(source) })
}

/// Time against FLIP, a line per name, in the order in which names come first.
pub fn series(peers: &[Peer]) -> Vec<Series> {
    let mut lines: Vec<Series> = Vec::new();
    for Peer { name, time_ms, flip, .. } in peers {
        match lines.iter_mut().find(|line| line.name == *name) {
            Some(line) => line.points.push((*time_ms, *flip)),
            None => lines.push(Series { name: name.clone(), points: vec![(*time_ms, *flip)], ..Series::default() }),
        }
    }
    lines
}

/// What [`table`] says.
pub const NOTE: &str = "Ours: the fastest measured setting whose FLIP, the mean of both eyes against this page's \
    reference, is at most the peer's, and the peer's time over ours. Peers' numbers are their file's, so its machine, \
    size and reference are to be like those of this page.";

/// Of each peer the fastest setting here whose FLIP is at most the peer's.
pub fn table(peers: &[Peer], rows: &[Row]) -> Table {
    let headers = vec!["peer", "note", "FLIP", "ms", "ours, ms", "FLIP", "setting", "times as fast"];
    let ours = |flip: f64| {
        let reaching = rows.iter().map(|r| (r, r.rung())).filter(|(_, rung)| rung.flip <= flip);
        reaching.min_by(|a, b| a.1.time_ms.total_cmp(&b.1.time_ms))
    };
    let cells = |peer: &Peer| {
        let Peer { name, time_ms, flip, note } = peer;
        let mut cells = vec![name.clone(), note.clone(), format!("{flip:.3}"), format!("{time_ms:.1}")];
        cells.extend(match ours(*flip) {
            Some((row, rung)) => [
                format!("{:.1}", rung.time_ms),
                format!("{:.3}", rung.flip),
                row.name(),
                format!("{:.2}", time_ms / rung.time_ms),
            ],
            None => ["none", "-", "-", "-"].map(str::to_owned),
        });
        cells
    };
    Table { headers, rows: peers.iter().map(cells).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_are_wrong_say_where() {
        for (text, reason) in [
            ("", "no [[peer]]"),
            ("[[peer]]\nname = 'a'\nflip = 0.1", "time_ms"),
            ("[[peer]]\nname = 'a'\nflip = 0.1\ntime_ms = 1.0\nspp = 4", "spp"),
            ("[[peer]]\nname = 'a'\nflip = 0.1\ntime_ms = 0.0", "peer 1 (a): time_ms 0"),
            ("[[peer]]\nname = 'a'\nflip = nan\ntime_ms = 1.0", "flip NaN"),
            ("[[peer]]\nname = 'a'\nflip = 1.5\ntime_ms = 1.0", "flip 1.5"),
            ("[[peer]]\nname = ' '\nflip = 0.5\ntime_ms = 1.0", "name is empty"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains(reason), "{text}: {error}");
        }
    }

    #[test]
    fn the_files_of_the_documentation_are_read() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/peers");
        let files = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
        let files: Vec<_> = files.filter(|path| path.extension().is_some_and(|e| e == "toml")).collect();
        assert!(!files.is_empty(), "{}", folder.display());
        for path in files {
            let peers = read(&path).unwrap();
            // Not denoised, and by either of two denoisers, at four counts of samples.
            let lines = series(&peers);
            assert_eq!((peers.len(), lines.len(), lines[1].points.len()), (12, 3, 4), "{}", path.display());
        }
    }
}
