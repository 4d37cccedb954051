//! `bench` measures what it says: the error of independent samples falls as their number to the −1/2, that of Sobol'
//! samples no slower, and what it writes can be read.

mod common;

use std::path::Path;

use common::diptych;
use serde_json::Value;

fn bench(out: &Path, options: &[&str]) -> Vec<Value> {
    let args = ["bench", "builtin:cornell", "--json", "--out", out.to_str().unwrap()];
    let output = diptych(&[&args, options].concat());
    assert!(output.status.success(), "{options:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap().lines().map(|l| serde_json::from_str(l).unwrap()).collect()
}

fn event<'a>(events: &'a [Value], name: &str) -> &'a Value {
    events.iter().find(|e| e["event"] == name).unwrap()
}

/// Student's t of 11 degrees of freedom exceeds this with a probability below 1e-4.
const T: f64 = 6.0;

#[test]
fn errors_fall_as_the_square_root_of_samples() {
    let folder = tempfile::tempdir().unwrap();
    for sampler in ["pcg", "sobol"] {
        let events = bench(
            folder.path(),
            &[
                "--size",
                "96x64",
                "--reproject",
                "off",
                "--denoiser",
                "none",
                "--spp",
                "2,8,32",
                "--repeats",
                "12",
                "--warm-up",
                "0",
                "--reference-spp",
                "512",
                "--sampler",
                sampler,
            ],
        );
        let origin = event(&events, "reference")["origin"].as_str().unwrap();
        assert_eq!(origin.contains("kept from an earlier run"), sampler == "sobol", "{origin}");
        let slopes = event(&events, "result")["slopes"].as_array().unwrap();
        assert_eq!(slopes.len(), 2);
        for found in slopes {
            println!("{sampler}: {found}");
            let [slope, error] = ["slope", "standard_error"].map(|name| found[name].as_f64().unwrap());
            assert!(error < 0.01 && found["points"] == 3, "too coarse to tell: {found}");
            assert!(slope < -0.5 + T * error, "{sampler}: {found}");
            assert!(sampler == "sobol" || slope > -0.5 - T * error, "{sampler}: {found}");
        }
    }
}

#[test]
fn a_grid_has_its_rows_its_plot_and_its_reference() {
    let folder = tempfile::tempdir().unwrap();
    let (out, size) = (folder.path().join("out"), ["--size", "32x18", "--spp", "1,4", "--repeats", "1"]);
    let events = bench(&out, &[&size[..], &["--reference-spp", "64", "--virtual", "2"]].concat());
    let rows = event(&events, "result")["rows"].as_array().unwrap().clone();
    assert!(rows.len() >= 4);
    assert!(rows.iter().all(|r| r["time_ms"].as_f64().unwrap() > 0.0 && r["errors"]["right"]["rmse"].is_f64()));
    assert!(rows.iter().any(|r| r["on_front"] == true));
    let csv = std::fs::read_to_string(out.join("bench.csv")).unwrap();
    assert_eq!(csv.lines().count(), 1 + 2 * rows.len(), "{csv}");
    for column in ["denoiser", "spp", "eye", "time_ms", "rmse", "relmse", "psnr", "ssim", "mean_ratio"] {
        assert!(csv.lines().next().unwrap().split(',').any(|c| c == column), "no {column} in {csv}");
    }
    let svg = std::fs::read_to_string(out.join("bench.svg")).unwrap();
    assert!(["atrous", "none", "noise of the reference"].iter().all(|text| svg.contains(text)));

    let page = std::fs::read_to_string(out.join("bench.html")).unwrap();
    assert!(["builtin:cornell", "virtual_devices", "noise of the reference"].iter().all(|text| page.contains(text)));

    // The kept reference is an image like any other's.
    let kept = std::fs::read_dir(out.join("reference")).unwrap().next().unwrap().unwrap().path();
    let again = folder.path().join("again");
    let given = [&size[..], &["--denoiser", "none", "--reference", kept.to_str().unwrap()]].concat();
    let events = bench(&again, &given);
    assert!(event(&events, "reference")["noise"].is_null());
    let same = &event(&events, "result")["rows"][1]["errors"]["left"]["rmse"];
    let first = rows.iter().find(|r| r["denoiser"] == "none" && r["spp"] == 4).unwrap();
    assert_eq!(same, &first["errors"]["left"]["rmse"]);
}

#[test]
fn references_that_do_not_fit_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let render = ["render", "builtin:cornell", "--size", "16x8", "--out", out, "--quiet"];
    assert!(diptych(&render).status.success());
    for (reference, part) in [(out, "16x8"), ("/nowhere", "left.exr")] {
        let output = diptych(&["bench", "builtin:cornell", "--size", "32x18", "--out", out, "--reference", reference]);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && text.contains(part), "{text}");
    }
    assert!(!folder.path().join("bench.csv").exists());
}
