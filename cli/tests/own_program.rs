//! Programs that extend the commands of `diptych`, like two of the examples. A registered policy appears in the table
//! of `scale`, in `render` and in help, and changes no byte. A registered denoiser gives the bytes of one device. This
//! test is a program of its own, because the examples parse its command line.

#[path = "../examples/own_denoiser.rs"]
mod own_denoiser;
#[path = "../examples/own_policy.rs"]
mod own_policy;

use std::path::Path;
use std::process::{Command, ExitCode, Output};

/// Environment variable that names the example to run as.
const AS_EXAMPLE: &str = "DIPTYCH_TEST_AS_EXAMPLE";

fn main() -> ExitCode {
    match std::env::var(AS_EXAMPLE).as_deref() {
        Ok("own_policy") => return own_policy::main(),
        Ok("own_denoiser") => return own_denoiser::main(),
        _ => {}
    }
    let folder = tempfile::tempdir().expect("a folder can be made");
    scale_compares_policies(folder.path());
    a_policy_changes_no_byte(folder.path());
    a_denoiser_has_the_bytes_of_one_device(folder.path());
    help_lists_what_is_registered();
    println!("test result: ok. 4 passed; 0 failed; 0 ignored; 0 measured; 0 filtered out");
    ExitCode::SUCCESS
}

fn run(example: &str, args: &[&str]) -> Output {
    let program = std::env::current_exe().expect("this program has a path");
    let output = Command::new(program).args(args).env(AS_EXAMPLE, example).output().expect("it can be started");
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

fn scale_compares_policies(folder: &Path) {
    let out = folder.join("scale");
    let common = ["scale", "builtin:cornell", "--size", "32x18", "--frames", "1", "--warm-up", "1"];
    let policies = ["--counts", "1,3", "--balance", "even,halving", "--simulate", "4", "--out", out.to_str().unwrap()];
    let output = run("own_policy", &[&common[..], &policies].concat());
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("policy") && said.contains("halving"), "{said}");
    for (file, rows) in [("scale.csv", 3), ("simulate.csv", 6)] {
        let text = std::fs::read_to_string(out.join(file)).expect("scale writes it");
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        let column = lines[0].iter().position(|name| *name == "policy").expect("there is a column of policies");
        assert_eq!((lines.len(), lines[rows][column]), (rows + 1, "halving"), "{text}");
    }
}

/// Renders on this many devices; returns the right eye's file and the rows of each device.
fn render(example: &str, out: &Path, devices: &str, options: &[&str]) -> (Vec<u8>, serde_json::Value) {
    let args = ["render", "builtin:cornell", "--size", "32x18", "--warm-up", "1", "--quiet", "--virtual", devices];
    run(example, &[&args[..], options, &["--out", out.to_str().unwrap()]].concat());
    let text = std::fs::read_to_string(out.join("run.json")).expect("render writes it");
    let report: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
    (std::fs::read(out.join("right.exr")).expect("render writes it"), report["frames"][0]["stripes"].clone())
}

fn a_policy_changes_no_byte(folder: &Path) {
    let [own, even] = [("halving", [9, 5, 4]), ("even", [6, 6, 6])].map(|(policy, expected)| {
        let (image, stripes) = render("own_policy", &folder.join(policy), "3", &["--balance", policy]);
        assert_eq!(stripes, serde_json::json!(expected), "{policy}");
        image
    });
    assert!(own == even, "the policy changes bytes");
}

fn a_denoiser_has_the_bytes_of_one_device(folder: &Path) {
    let image = |devices: &str, denoiser: &str| {
        let options = ["--balance", "even", "--denoiser", denoiser];
        render("own_denoiser", &folder.join(denoiser), devices, &options).0
    };
    let one = image("1", "mean");
    assert!(one == image("2", "mean"), "two devices give other bytes");
    assert!(one != image("1", "none"), "the denoiser does nothing");
}

fn help_lists_what_is_registered() {
    for (example, parts) in [("own_policy", ["halving", "Half of the rows"]), ("own_denoiser", ["mean", "same normal"])]
    {
        let help = String::from_utf8(run(example, &["render", "--help"]).stdout).expect("help is text");
        assert!(parts.iter().all(|part| help.contains(part)), "{help}");
    }
}
