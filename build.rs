//! Generates the table of shader sources that is compiled into the binary.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::{env, fs, io};

fn main() -> io::Result<()> {
    println!("cargo::rerun-if-changed=shaders");
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR").map_err(io::Error::other)?);
    let mut files = Vec::new();
    collect(&root.join("shaders"), &mut files)?;
    files.sort();
    let mut table = String::from("&[");
    for path in &files {
        // Shaders are looked up by file name alone, so names must be unique across folders.
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        if files.iter().any(|other| other != path && other.file_name() == path.file_name()) {
            return Err(io::Error::other(format!("two shaders have the name {name}")));
        }
        // The path is relative to the checkout, so that build outputs stay valid if the checkout is moved.
        let path = path.strip_prefix(root.join("shaders")).unwrap_or(path).display().to_string();
        let text = format!("/shaders/{path}");
        let _ = write!(table, "({name:?}, {path:?}, include_str!(concat!(env!(\"CARGO_MANIFEST_DIR\"), {text:?}))),");
    }
    table.push(']');
    let out = env::var("OUT_DIR").map_err(io::Error::other)?;
    fs::write(Path::new(&out).join("shader_files.rs"), table)
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        // Skip the shaders that present images in windows and headsets: they are not compute kernels of a frame.
        if path.ends_with("present") {
            continue;
        }
        if path.is_dir() {
            collect(&path, files)?;
        } else if path.extension().is_some_and(|e| e == "wgsl") {
            files.push(path);
        }
    }
    Ok(())
}
