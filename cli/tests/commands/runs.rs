//! Runs of every kind that writes numbers. Each runs once for all tests of its files.

use std::path::PathBuf;
use std::sync::{LazyLock, OnceLock};

use serde_json::Value;

use crate::common::{Folder, is_thorough};

/// Names and command lines of the runs.
const RUNS: &str = "\
render: render builtin:cornell --size 40x24 --frames 3 --virtual 2 --aov depth,albedo --also details
reference: render builtin:cornell --size 40x24 --reference --spp 16 --frames 2
play: play builtin:cornell --size 40x24 --frames 8 --budget-ms 0.01..30000 --fps 1000
scale: scale builtin:checker --size 48x32 --counts 1,2 --threads-per-device 1 --simulate 1,2,4 --report
in flight: scale builtin:checker --size 48x32 --counts 1,2 --threads-per-device 1 --set frames_in_flight=2 --report
bench: bench builtin:cornell --size 40x24 --quick --spp 1,2 --bounces 2 --denoiser none,atrous --repeats 2 \
    --reference-spp 16
seams: study seams builtin:checker --size 64x40 --counts 1,2 --warm-up 1 --repeats 2 --reference-spp 32 --report
leria: study leria builtin:cornell --size 40x24 --fraction 0.03 --virtual 2 --threads-per-device 1 --simulate 4,4,2 \
    --report
leria-lightfield: study leria-lightfield builtin:cornell --size 40x24 --views 5 --fraction 0.1 --virtual 2 \
    --threads-per-device 1 --report
bmfr: study bmfr builtin:checker --size 32x20 --warm-up 0 --repeats 2 --reference-spp 16 --conditions published,each
koskela: study koskela builtin:checker --size 64x40 --warm-up 0 --repeats 2 --reference-spp 16 --report
andersson: study andersson builtin:cornell --size 64x40 --fraction 0.1 --repeats 2 --reference-spp 16 --report
peres: study peres builtin:cornell --fraction 0.04 --repeats 1 --reference-spp 16 --report";

/// Runs of which quick tests have one each: every command, but no study.
const QUICK: usize = 6;

fn runs() -> impl Iterator<Item = (&'static str, &'static str)> {
    RUNS.lines().map(|line| line.split_once(": ").unwrap())
}

/// Returns the names of the runs: of all under `make test-full`.
pub fn names() -> impl Iterator<Item = &'static str> {
    runs().take(if is_thorough() { usize::MAX } else { QUICK }).map(|(name, _)| name)
}

/// True if tests look at the files of this run.
pub fn is_looked_at(run: &str) -> bool {
    names().any(|name| name == run)
}

/// Files and results of a run.
pub struct Run {
    name: &'static str,
    folder: Folder,
    /// Result event at its end.
    pub result: Value,
}

/// Returns the run of this name. The first caller executes it.
pub fn run(name: &str) -> &'static Run {
    static MADE: LazyLock<Vec<OnceLock<Run>>> = LazyLock::new(|| runs().map(|_| OnceLock::new()).collect());
    let which = runs().position(|(known, _)| known == name).unwrap_or_else(|| panic!("there is no run {name}"));
    MADE[which].get_or_init(|| Run::make(runs().nth(which).unwrap()))
}

impl Run {
    fn make((name, options): (&'static str, &str)) -> Self {
        let folder = Folder::new();
        let result = folder.run(&format!("{options} --json --out ./")).json();
        Self { name, folder, result }
    }

    #[track_caller]
    pub fn rows(&self) -> &[Value] {
        self.result["rows"].as_array().unwrap_or_else(|| panic!("{} has no rows", self.name))
    }

    pub fn folder(&self) -> PathBuf {
        self.folder.path("")
    }

    #[track_caller]
    pub fn text(&self, file: &str) -> String {
        self.folder.text(file)
    }

    #[track_caller]
    pub fn json(&self) -> Value {
        self.folder.json("run.json")
    }

    /// Parses a CSV file into names of columns and lines. Fails if a line has a different length.
    #[track_caller]
    pub fn csv(&self, file: &str) -> (Vec<String>, Vec<Vec<String>>) {
        let text = self.text(file);
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let columns = reader.headers().unwrap().iter().map(str::to_owned).collect();
        let lines = reader.records().map(|r| r.unwrap_or_else(|e| panic!("{}/{file}: {e}", self.name)));
        (columns, lines.map(|line| line.iter().map(str::to_owned).collect()).collect())
    }
}
