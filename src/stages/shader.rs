//! The text of shaders: what the host declares for them, then their files in `shaders/`, compiled into the binary, with
//! their includes put in.
//!
//! `//!include a b` in a stage's file puts `shared/a.inc.wgsl` and `shared/b.inc.wgsl` there. Includes do not nest, so a
//! stage's first lines say all that it is made of. `traverse` and `changed_tables` have several files, of which the device
//! decides.

use super::layout;
use crate::device::{SceneAccess, ShaderChecks, Traversal};
use crate::graph::{Kernel, SceneUse};
use crate::passes;
use crate::wgsl::declare;

/// Names without extension, and texts, of all files in `shaders/`: made by the build script.
const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shader_files.rs"));

/// The include by which shaders trace rays: `traverse_compute` or `traverse_hardware`.
const TRAVERSE: &str = "traverse";
/// The include by which shaders change rows of the scene's tables: `changed_tables_buffer` or `changed_tables_texture`.
const CHANGED_TABLES: &str = "changed_tables";

/// The whole text of a kernel's shader and the run-time checks that it needs. Only [`Self::new`] makes one, so nothing
/// else can call foreign text the library's own.
pub(super) struct Shader {
    text: String,
    is_foreign: bool,
}

impl Shader {
    /// Puts the text of a kernel's shader together. Foreign text stays foreign whatever it includes.
    ///
    /// # Panics
    /// On a name or an include that no file has; a test goes through them all.
    pub fn new(kernel: &Kernel, access: SceneAccess) -> Self {
        Self { text: shader_text(kernel, access), is_foreign: kernel.foreign_text().is_some() }
    }

    pub fn text(&self) -> &str {
        &self.text
    }

    /// Returns the checks that it runs with where the library's own shaders run with `own`.
    pub fn checks(&self, own: ShaderChecks) -> ShaderChecks {
        if self.is_foreign { ShaderChecks::Full } else { own }
    }

    /// Compiles it with [`Self::checks`].
    pub fn module(&self, device: &wgpu::Device, label: &str, own: ShaderChecks) -> wgpu::ShaderModule {
        let source = wgpu::ShaderSource::Wgsl(self.text.as_str().into());
        let descriptor = wgpu::ShaderModuleDescriptor { label: Some(label), source };
        match self.checks(own) {
            ShaderChecks::Full => device.create_shader_module(descriptor),
            // SAFETY: the library's own shaders alone come here. Their loops end, their integer divisors are not 0, they
            // use ray queries as Vulkan defines, and their bounds stay checked.
            ShaderChecks::Fast => unsafe {
                device.create_shader_module_trusted(descriptor, ShaderChecks::Fast.runtime_checks())
            },
        }
    }
}

/// Returns the whole text of a kernel's shader: the host's structs and constants, the kernel's own constants, and its
/// file. With the scene comes how it reads the tables.
///
/// # Panics
/// On a name or an include that no file has; a test goes through them all.
pub fn shader_text(kernel: &Kernel, SceneAccess { tables, traversal }: SceneAccess) -> String {
    let text = kernel.foreign_text().unwrap_or_else(|| file(kernel.name, kernel.name));
    let mut out = String::new();
    if kernel.scene == SceneUse::Read && traversal == Traversal::Hardware {
        // Before all declarations.
        out += "enable wgpu_ray_query;\n";
    }
    out += &layout::declarations();
    out += &declare(kernel.constants);
    for line in text.lines() {
        match line.strip_prefix("//!include ") {
            Some(names) => {
                for include in names.split_whitespace() {
                    if include == "scene" {
                        out += file(kernel.name, &format!("tables_{}.inc", tables.name()));
                        out += &layout::readers();
                    }
                    let include = match include {
                        TRAVERSE => format!("{TRAVERSE}_{}", traversal.name()),
                        CHANGED_TABLES => format!("{CHANGED_TABLES}_{}", tables.name()),
                        _ => include.to_owned(),
                    };
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
pub fn shader_text_of(name: &str, access: SceneAccess) -> String {
    let kernels = passes::kernels();
    let kernel = kernels.iter().find(|k| k.name == name).unwrap_or_else(|| panic!("no shader '{name}'"));
    shader_text(kernel, access)
}

/// The texts of all shaders of the renderer, to tell versions apart.
pub fn all_shader_text(access: SceneAccess) -> String {
    passes::kernels().iter().map(|kernel| shader_text(kernel, access)).collect()
}

/// Names of the override constants that a shader declares.
pub fn override_names(source: &str) -> Vec<&str> {
    source.lines().filter_map(|l| l.strip_prefix("override ")?.split(':').next()).collect()
}
