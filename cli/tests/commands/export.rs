//! An exported shot renders the same.

use std::path::Path;

use crate::common::diptych;

fn eyes(shot: &str, out: &Path) -> [Vec<u8>; 2] {
    let out_text = out.to_str().unwrap();
    let options = ["--size", "48x32", "--spp", "2", "--quiet", "--out", out_text];
    let output = diptych(&[&["render", shot], &options[..]].concat());
    assert!(output.status.success(), "{shot}: {}", String::from_utf8_lossy(&output.stderr));
    ["left.exr", "right.exr"].map(|name| std::fs::read(out.join(name)).unwrap())
}

#[test]
fn same_bytes_from_an_exported_shot() {
    // It has spheres, whose normals lie along no axes.
    let shot = "builtin:gallery";
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let output = diptych(&["export", shot, "--out", path("files").to_str().unwrap()]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let exported = String::from_utf8(output.stdout).unwrap();
    assert!(eyes(exported.trim(), &path("exported")) == eyes(shot, &path("own")));
}

#[test]
fn rejects_unknown_scenes_and_invalid_folders() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    for (shot, out, status, part) in
        [("builtin:sponza", out, 2, "sponza"), ("builtin:cornell", file.to_str().unwrap(), 1, "choose another --out")]
    {
        let output = diptych(&["export", shot, "--out", out]);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(status) && said.contains(part), "{shot}: {said}");
    }
}

#[test]
fn rejects_settings_that_are_not_of_the_scene() {
    for (line, part) in [
        (&["info", "builtin:cornell", "--set", "clamp=nan"][..], "clamp has no effect in info"),
        (&["info", "builtin:cornell", "--set", "time=nan"], "time cannot be NaN"),
        (&["info", "--set", "environment=sky"], "environment has no effect in info without a shot"),
        (&["export", "builtin:cornell", "-o", "a.png", "--set", "spp=64"], "spp has no effect in a contact sheet"),
        (&["export", "builtin:cornell", "-o", "a.toml", "--set", "spp=64"], "spp has no effect in export"),
    ] {
        let output = diptych(line);
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && said.contains(part), "{line:?}: {said}");
    }
}
