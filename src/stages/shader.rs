//! The text of shaders: what the host declares for them, then their files in `shaders/`, compiled into the binary, with
//! their includes put in.
//!
//! `//!include a b` in a stage's file puts `shared/a.inc.wgsl` and `shared/b.inc.wgsl` there. Includes do not nest, so a
//! stage's first lines say all that it is made of.

use super::layout;
use crate::device::Nodes;
use crate::graph::Kernel;
use crate::passes;
use crate::wgsl::declare;

/// Names without extension, and texts, of all files in `shaders/`: made by the build script.
const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shader_files.rs"));

/// The whole text of a kernel's shader: the host's structs and constants, the kernel's own constants, and its file. With
/// the scene comes how it reads the nodes of trees.
///
/// # Panics
/// On a name or an include that no file has; a test goes through them all.
pub fn shader_text(kernel: &Kernel, nodes: Nodes) -> String {
    let text = kernel.text.unwrap_or_else(|| file(kernel.name, kernel.name));
    let mut out = layout::declarations() + &declare(kernel.constants);
    for line in text.lines() {
        match line.strip_prefix("//!include ") {
            Some(names) => {
                for include in names.split_whitespace() {
                    if include == "scene" {
                        out += file(kernel.name, &format!("{}.inc", nodes.shader()));
                    }
                    out += file(kernel.name, &format!("{include}.inc"));
                    out.push('\n');
                }
            }
            None => {
                out += line;
                out.push('\n');
            }
        }
    }
    out
}

fn file(shader: &str, name: &str) -> &'static str {
    let found = FILES.iter().find(|(n, _)| *n == name);
    found.unwrap_or_else(|| panic!("shader '{shader}' is made of '{name}', which is no file")).1
}

/// [`shader_text`] of one of the renderer's own kernels.
///
/// # Panics
/// On a name that no kernel has.
pub fn shader_text_of(name: &str, nodes: Nodes) -> String {
    let kernels = passes::kernels();
    let kernel = kernels.iter().find(|k| k.name == name).unwrap_or_else(|| panic!("no shader '{name}'"));
    shader_text(kernel, nodes)
}

/// The texts of all shaders of the renderer, to tell versions apart.
pub fn all_shader_text() -> String {
    passes::kernels().iter().map(|kernel| shader_text(kernel, Nodes::default())).collect()
}

/// Names of the override constants that a shader declares.
pub fn override_names(source: &str) -> Vec<&str> {
    source.lines().filter_map(|l| l.strip_prefix("override ")?.split(':').next()).collect()
}
