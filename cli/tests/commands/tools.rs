//! The shell scripts of the Makefile.
#![cfg(target_os = "linux")]

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::process::Command;

use crate::common::{Folder, Said};

/// Runs `tools/deps.sh` with a single driver whose library contains this text; returns its messages.
fn deps_say(text: &str) -> String {
    let folder = Folder::new();
    folder.write("libvulkan_lvp.so", [b"\x7fELF\0\xff", text.as_bytes(), b"\0more"].concat());
    let driver = folder.write("lvp_icd.json", r#"{"ICD": {"library_path": "./libvulkan_lvp.so"}}"#);
    let mut script = Command::new("sh");
    script.arg(concat!(env!("CARGO_MANIFEST_DIR"), "/../tools/deps.sh")).env("VK_DRIVER_FILES", driver);
    // Compilers need not be installed where tests run.
    Said::new(script.env("CARGO", "sh").env("CXX", "sh").output().unwrap()).success(text).errors
}

#[test]
fn deps_warns_of_an_old_software_driver() {
    for (text, old) in
        [("Mesa 22.3.6", true), ("Mesa 24.2.8-1~bpo12+1", true), ("Mesa 25.0.7-2", false), ("none", false)]
    {
        let said = deps_say(text);
        assert_eq!(said.contains("as fast with Mesa 25"), old, "{text}: {said}");
        assert!(!old || said.contains(&format!("of {}", text.split('-').next().unwrap())), "{said}");
    }
}

/// A folder with `tools/release-check.sh` and stubs of its commands: `make` with a target prints the file `TARGET`, and
/// fails if `TARGET.fails` exists.
struct Release(Folder);

impl Release {
    fn new() -> Self {
        let release = Self(Folder::new());
        fs::create_dir_all(release.0.path("docs/results")).unwrap();
        release.0.write("tools/release-check.sh", include_bytes!("../../../tools/release-check.sh"));
        release.0.write("Cargo.toml", "version = \"1.2.3\"\n");
        release.0.write("commit", "abc\n");
        release.0.write("changes", "");
        release.stub("git", "case $1 in rev-parse) cat commit ;; *) cat changes ;; esac");
        release.stub("rustc", "echo rustc 1.2.3");
        release.stub("make", "[ \"$2\" = RUN= ] || echo \"$2\"; cat $1; [ ! -e $1.fails ]");
        release
    }

    fn stub(&self, name: &str, script: &str) {
        let path = self.0.write(&format!("bin/{name}"), format!("#!/bin/sh\n{script}\n"));
        fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
    }

    /// Runs these steps; returns true if they passed.
    fn check(&self, steps: &[&str], newer_mesa: &str) -> bool {
        let path = format!("{}:{}", self.0.path("bin").display(), std::env::var("PATH").unwrap());
        let mut script = Command::new("sh");
        script.arg(self.0.path("tools/release-check.sh")).args(steps).env("PATH", path).env("NEWER_MESA", newer_mesa);
        for variable in ["MAKE", "RUSTC", "CARGO", "CARGO_TARGET_DIR"] {
            script.env_remove(variable);
        }
        script.env("GOLDEN", "earlier");
        script.output().unwrap().status.success()
    }

    fn report(&self) -> String {
        fs::read_to_string(self.0.path("docs/results/release-check.md")).unwrap_or_default()
    }

    /// Returns a step's result, numbers of tests and remark.
    fn row(&self, step: &str) -> String {
        let report = self.report();
        let row = report.lines().find(|line| line.starts_with(&format!("| {step} |"))).unwrap_or_default();
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        [&cells[2..3], &cells[6..10]].concat().join(" ").trim().to_owned()
    }
}

const TESTS: &str = "\
test one ... ok
test result: ok. 3 passed; 0 failed; 1 ignored; 0 measured; 2 filtered out; finished in 0.00s
test result: ok. 40 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out; finished in 0.00s
";

#[test]
fn release_check_runs_all_steps_if_one_fails() {
    let release = Release::new();
    release.0.write("lint", "test a::b ... FAILED\n");
    release.0.write("lint.fails", "");
    release.0.write("test", TESTS);
    assert!(!release.check(&["lint", "test", "test-newer", "golden-compare"], ""));
    for line in ["| commit | abc |", "| diptych | 1.2.3 |", "| compiler | rustc 1.2.3 |"] {
        assert!(release.report().contains(line), "{}", release.report());
    }
    assert_eq!(release.row("lint"), "**failed** – – – `a::b`");
    assert_eq!(release.row("test"), "passed 43 0 1");
    assert_eq!(release.row("test-newer"), "skipped – – – NEWER_MESA names no command");
    assert_eq!(release.row("golden-compare"), "skipped – – – there are no images of both drivers");
    assert_eq!(release.row("test-full"), "not run – – –");
}

#[test]
fn release_check_resumes_on_the_same_commit() {
    let release = Release::new();
    release.0.write("lint", "");
    release.0.write("lint.fails", "");
    release.0.write("test", TESTS);
    assert!(!release.check(&["lint", "test"], ""));
    fs::remove_file(release.0.path("lint.fails")).unwrap();
    assert!(!release.check(&["test"], ""), "the failure of another step is kept");
    assert!(release.check(&["lint"], ""));
    assert_eq!([release.row("lint"), release.row("test")], ["passed – – –", "passed 43 0 1"]);
    release.0.write("commit", "def\n");
    assert!(release.check(&["lint"], ""));
    // Results of an earlier commit stay and are marked as such.
    assert_eq!([release.row("lint"), release.row("test")], ["passed – – –", "passed 43 0 1"]);
    assert!(release.report().contains("| lint | passed | def |"), "{}", release.report());
    assert!(release.report().contains("| test | passed | abc |"), "{}", release.report());
    let before = release.report();
    release.0.write("changes", " M src/lib.rs\n");
    assert!(!release.check(&["lint"], ""), "results are those of a commit");
    release.0.write("changes", "");
    assert!(!release.check(&["nonsense"], ""));
    assert_eq!(release.report(), before);
}

#[test]
fn release_check_runs_under_a_second_driver() {
    let release = Release::new();
    fs::create_dir_all(release.0.path("target/release")).unwrap();
    let program = release.0.path("target/release/diptych");
    fs::copy(release.0.path("bin/make"), &program).unwrap();
    fs::write(program, "#!/bin/sh\necho '\"driver\": \"old\",\n\"ray_queries\": false,'\n").unwrap();
    release.stub("newer", "echo '\"driver\": \"new, with rays\",\n\"ray_queries\": true,'");
    release.stub("cargo", "");
    for target in ["test", "test-hardware-rays"] {
        release.0.write(target, TESTS);
    }
    release.stub("make", "mkdir -p out; echo 'abc  a ./left.exr' >out/golden.txt; echo \"1 $2\"; cat $1");
    release.0.write("golden", "");
    assert!(release.check(&["test-newer", "hardware-rays", "golden", "golden-newer", "golden-compare"], "newer"));
    assert_eq!(release.row("hardware-rays"), "passed 43 0 1");
    let log = |step: &str| fs::read_to_string(release.0.path(&format!("out/release-check/{step}.log"))).unwrap();
    assert!(log("hardware-rays").contains("RUN=newer"), "{}", log("hardware-rays"));
    assert!(log("test-newer").contains("RUN=newer"), "{}", log("test-newer"));
    assert!(!log("golden").contains("RUN=newer"), "{}", log("golden"));
    let report = release.report();
    assert!(report.contains("| driver | old |\n| driver of `-newer` | new, with rays |"), "{report}");
    assert_eq!(release.row("golden-compare"), "passed – – – 1 of 1 images have the same bytes under both drivers");
    // `make golden` itself compares this build's images with those of an earlier build.
    release.0.write("earlier/golden.txt", "other");
    release.stub("make", "echo \"$3\"; [ $3 != BEFORE=earlier/golden.txt ]");
    assert!(!release.check(&["golden"], ""));
    assert!(release.row("golden").starts_with("**failed**"), "{}", release.row("golden"));
}
