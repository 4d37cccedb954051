//! `compare` measures how much the errors of the two eyes differ.

use std::path::Path;

use serde_json::Value;

use crate::common::diptych;

fn render(out: &Path, options: &[&str]) {
    let common = ["render", "builtin:cornell", "--size", "64x36", "--bounces", "3", "--out", out.to_str().unwrap()];
    let output = diptych(&[&common, options].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn compare(reference: &Path, image: &Path, options: &[&str]) -> String {
    let output = diptych(&[&["compare", reference.to_str().unwrap(), image.to_str().unwrap()], options].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn json(reference: &Path, image: &Path) -> Value {
    serde_json::from_str(&compare(reference, image, &["--json"])).unwrap()
}

#[test]
fn reprojection_reduces_rivalry() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    render(&path("reference"), &["--reference", "--spp", "512"]);
    let aovs = ["--aov", "position,normal"];
    let seen = |name: &str, options: &[&str]| {
        render(&path(name), &[&aovs, options].concat());
        let found = json(&path("reference"), &path(name));
        for measure in ["rivalry", "rivalry_seen", "rivalry_mean", "rivalry_p99"] {
            assert!(found[measure].as_f64().is_some_and(|value| value > 0.0 && value < 0.2), "{measure}: {found}");
        }
        assert!(found["unmatched"].as_f64().unwrap() < 0.2, "{found}");
        // The box is matte: nothing that it shows lies off its surfaces.
        assert!(found["features"].as_u64() <= Some(2), "{found}");
        found["rivalry_seen"].as_f64().unwrap()
    };
    let [once, apart] = [seen("once", &[]), seen("apart", &["--reproject", "off"])];
    println!("seen rivalry {once}, of eyes that were rendered apart {apart}");
    assert!(once < 0.8 * apart, "{once} is not below {apart}");

    let maps = path("maps");
    let text = compare(&path("reference"), &path("once"), &["--maps", maps.to_str().unwrap()]);
    assert!(text.contains("\nrivalry_seen ") && maps.join("rivalry.png").is_file(), "{text}");
}

#[test]
fn rivalry_needs_positions_and_normals() {
    let folder = tempfile::tempdir().unwrap();
    let image = folder.path().join("image");
    render(&image, &["--denoiser", "none"]);
    let text = compare(&image, &image, &[]);
    assert!(text.contains("render with --aov position,normal"), "{text}");
    assert!(json(&image, &image)["rivalry"].is_null());
}

#[test]
fn sequences_report_flickering_rivalry() {
    let folder = tempfile::tempdir().unwrap();
    let [reference, image] = ["reference", "image"].map(|name| folder.path().join(name));
    let frames = ["--frames", "3", "--fps", "24"];
    render(&reference, &[&frames[..], &["--reference", "--spp", "64"]].concat());
    render(&image, &[&frames[..], &["--aov", "motion,position,normal"]].concat());
    let found = json(&reference, &image);
    for measure in ["rivalry", "rivalry_seen", "rivalry_flicker"] {
        assert!(found[measure].as_f64().is_some_and(|value| value > 0.0), "{measure}: {found}");
    }
    assert!(found["left"]["flicker"].is_number(), "{found}");
    let text = compare(&reference, &image, &[]);
    assert!(text.contains("rivalry_flicker") && text.contains("ghosting"), "{text}");
}

/// A mirror ball shows its surroundings at another depth than its own, also in frames whose right eye is reprojected. The
/// eyes' errors there agree where both show the same surface, not where both show the same point of the mirror.
#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn reflections_lie_where_the_reference_has_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let render = |name: &str, options: &[&str]| {
        let common = ["render", "builtin:gallery", "--size", "160x90", "--time", "0.5", "--bounces", "4", "--out"];
        let output = diptych(&[&common[..], &[path(name).to_str().unwrap()], options].concat());
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    render("reference", &["--denoiser", "none", "--spp", "128", "--seed", "3"]);
    render("followed", &["--aov", "position,normal,shown_position,shown_normal,virtual_position"]);
    let off = || {
        let found = json(&path("reference"), &path("followed"));
        assert!(found["features"].as_u64() > Some(20), "{found}");
        found["disparity_off"].as_f64().unwrap()
    };
    let followed = off();
    let eye = |name: &str| path("followed").join(name);
    let rivalry = || json(&path("reference"), &path("followed"))["rivalry"].as_f64().unwrap();
    let of_shown = rivalry();
    std::fs::remove_file(eye("left.virtual_position.exr")).unwrap();
    let of_mirrors = rivalry();
    println!("rivalry {of_shown}, {of_mirrors} if mirrors are matched");
    // It is 0.978 of it for two seeds, with and without a radiance cache. A mirror fills only a fifth of the picture.
    assert!(of_shown < 0.98 * of_mirrors, "{of_shown}, {of_mirrors}");
    std::fs::copy(eye("left.exr"), eye("right.exr")).unwrap();
    let flat = off();
    println!("{followed} px, {flat} px if both eyes have one picture");
    assert!(followed < 0.25 && flat > 0.5, "{followed} px, {flat} px if both eyes have one picture");
}
