//! The shell scripts that the Makefile runs.
#![cfg(target_os = "linux")]

use std::fs;
use std::process::Command;

/// What `tools/deps.sh` says where the only driver is one whose library holds this text.
fn deps_say(text: &str) -> String {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("libvulkan_lvp.so"), [b"\x7fELF\0\xff", text.as_bytes(), b"\0more"].concat()).unwrap();
    fs::write(path("lvp_icd.json"), r#"{"ICD": {"library_path": "./libvulkan_lvp.so"}}"#).unwrap();
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tools/deps.sh");
    let output = Command::new("sh").arg(script).env("VK_DRIVER_FILES", path("lvp_icd.json")).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    said
}

#[test]
fn dependencies_say_that_a_software_driver_is_old() {
    for (text, old) in
        [("Mesa 22.3.6", true), ("Mesa 24.2.8-1~bpo12+1", true), ("Mesa 25.0.7-2", false), ("none", false)]
    {
        let said = deps_say(text);
        assert_eq!(said.contains("as fast with Mesa 25"), old, "{text}: {said}");
        assert!(!old || said.contains(&format!("of {}", text.split('-').next().unwrap())), "{said}");
    }
}
