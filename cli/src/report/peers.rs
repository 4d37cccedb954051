//! Reads times and errors of other renderers from a file, for comparison with measurements made here.

use std::path::Path;

use anyhow::{Context, Error, ensure};
use serde::Deserialize;

use super::bench::SettingRow;
use super::plot::Series;
use super::{Table, once};

/// Measurement of another renderer with one setting.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Peer {
    /// Name of the renderer or of a series of settings. In charts, a line joins the peers of the same name.
    pub name: String,
    /// Time of a stereo frame, that is, of both eyes.
    pub time_ms: f64,
    /// FLIP, above 0 and at most 1.
    pub flip: f64,
    /// Description of the setting, for tables.
    #[serde(default)]
    pub note: String,
}

/// Contents of a peers file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Peers {
    /// Exposure in stops at which FLIP compared the pictures.
    #[serde(default)]
    exposure_ev: f64,
    #[serde(default)]
    peer: Vec<Peer>,
}

impl Peers {
    /// Parses the text of a peers file.
    ///
    /// # Errors
    /// Names the first peer whose numbers are out of range, or what else is wrong.
    fn parse(text: &str) -> Result<Self, Error> {
        let peers: Self = toml::from_str(text).map_err(|error| {
            let what = format!("not a valid peers file: {error}");
            Error::from(error).context(what)
        })?;
        ensure!(peers.exposure_ev.is_finite(), "exposure_ev is {}: give a number of stops", peers.exposure_ev);
        for (number, Peer { name, time_ms, flip, .. }) in (1..).zip(&peers.peer) {
            ensure!(!name.trim().is_empty(), "peer {number} ({name}): its name is empty");
            let is_time = *time_ms > 0.0 && time_ms.is_finite();
            ensure!(is_time, "peer {number} ({name}): time_ms {time_ms} is not a time above 0");
            let is_flip = *flip > 0.0 && *flip <= 1.0;
            ensure!(is_flip, "peer {number} ({name}): flip {flip} is not above 0 and at most 1");
        }
        ensure!(!peers.peer.is_empty(), "no [[peer]] in the file");
        Ok(peers)
    }

    /// Reads the peers file `path`.
    ///
    /// # Errors
    /// Says why the file cannot be read or is invalid.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text =
            std::fs::read_to_string(path).with_context(|| format!("cannot read the peers file {}", path.display()))?;
        let path = path.display();
        Self::parse(&text).with_context(|| {
            format!(
                "{path} is not a valid peers file: write [[peer]] with name, time_ms, flip and optionally note (see \
                 docs/results/peers)"
            )
        })
    }

    /// Returns the peers, for comparison with pictures of a shot with the exposure `shot_ev`.
    ///
    /// # Errors
    /// An error if the peers were measured at another exposure, on which FLIP depends.
    pub fn at(self, shot_ev: f64) -> Result<Vec<Peer>, Error> {
        let peers_ev = self.exposure_ev;
        ensure!(
            peers_ev == shot_ev,
            "the peers' FLIP was measured at {peers_ev} EV, the shot's at {shot_ev} EV, so they cannot be compared: \
             measure the peers at the shot's exposure and state it in their file (exposure_ev = {shot_ev}), or set the \
             shot's exposure to theirs ([exposure] ev = {peers_ev})"
        );
        Ok(self.peer)
    }
}

/// Returns a chart series of FLIP over time for each name, in the order of first occurrence.
pub fn series(peers: &[Peer]) -> Vec<Series> {
    let points = |name: &str| peers.iter().filter(|p| p.name == name).map(|p| (p.time_ms, p.flip)).collect();
    let line = |name: &str| Series { name: name.to_owned(), points: points(name), ..Series::default() };
    once(peers.iter().map(|p| p.name.as_str())).into_iter().map(line).collect()
}

/// The caption of [`table`].
pub const NOTE: &str = "Ours: the fastest measured setting whose FLIP (mean of both eyes, against this page's \
    reference) is at most the peer's; times as fast: the peer's time over ours. The peers' numbers come from their \
    file. They are comparable only if its machine, size and reference match those of this page; the exposure is the \
    same.";

/// Returns a table that lists, for each peer, the fastest of `rows` whose FLIP is at most the peer's.
pub fn table(peers: &[Peer], rows: &[SettingRow]) -> Table {
    let headers = vec!["peer", "note", "FLIP", "ms", "ours, ms", "FLIP", "setting", "times as fast"];
    let ours = |flip: f64| {
        let reaching = rows.iter().map(|r| (r, &r.measured)).filter(|(_, m)| m.error("flip") <= flip);
        reaching.min_by(|a, b| a.1.time_ms.total_cmp(&b.1.time_ms))
    };
    let cells = |peer: &Peer| {
        let Peer { name, time_ms, flip, note } = peer;
        let mut cells = vec![name.clone(), note.clone(), format!("{flip:.3}"), format!("{time_ms:.1}")];
        cells.extend(match ours(*flip) {
            Some((row, measured)) => [
                format!("{:.1}", measured.time_ms),
                format!("{:.3}", measured.error("flip")),
                row.quality.to_string(),
                format!("{:.2}", time_ms / measured.time_ms),
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
    fn rejects_invalid_peer_files_with_the_place() {
        for (text, reason) in [
            ("", "no [[peer]]"),
            ("[[peer]]\nname = 'a'\nflip = 0.1", "time_ms"),
            ("[[peer]]\nname = 'a'\nflip = 0.1\ntime_ms = 1.0\nspp = 4", "spp"),
            ("[[peer]]\nname = 'a'\nflip = 0.1\ntime_ms = 0.0", "peer 1 (a): time_ms 0"),
            ("[[peer]]\nname = 'a'\nflip = nan\ntime_ms = 1.0", "flip NaN"),
            ("[[peer]]\nname = 'a'\nflip = 1.5\ntime_ms = 1.0", "flip 1.5"),
            ("[[peer]]\nname = ' '\nflip = 0.5\ntime_ms = 1.0", "name is empty"),
            ("exposure_ev = inf\n[[peer]]\nname = 'a'\nflip = 0.5\ntime_ms = 1.0", "exposure_ev is inf"),
        ] {
            let error = Peers::parse(text).unwrap_err().to_string();
            assert!(error.contains(reason), "{text}: {error}");
        }
    }

    #[test]
    fn published_peer_files_are_read() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/results/peers");
        let files = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
        let files: Vec<_> = files.filter(|path| path.extension().is_some_and(|e| e == "toml")).collect();
        assert!(!files.is_empty(), "{}", folder.display());
        for path in files {
            let peers = Peers::read(&path).unwrap().peer;
            // The settings are no denoiser and two denoisers, each at 1, 4 and 16 samples per pixel, and both denoisers
            // with a history at 1 and 4.
            let lines = series(&peers);
            assert_eq!((peers.len(), lines.len(), lines[1].points.len()), (13, 5, 3), "{}", path.display());
        }
    }

    #[test]
    fn rejects_peers_of_another_exposure() {
        let peers = |ev: &str| Peers::parse(&format!("{ev}\n[[peer]]\nname = 'a'\nflip = 0.1\ntime_ms = 1.0")).unwrap();
        assert_eq!(peers("exposure_ev = -0.9").at(-0.9).unwrap().len(), 1);
        for (peers, said) in [(peers(""), "at 0 EV, the shot's at -0.9 EV"), (peers("exposure_ev = 2"), "at 2 EV")] {
            let error = peers.at(-0.9).unwrap_err().to_string();
            assert!(error.contains(said) && error.contains("exposure_ev = -0.9"), "{error}");
        }
    }
}
