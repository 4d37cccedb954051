//! Shader sources: the host's declarations, followed by the kernel's file from `shaders/` with its includes expanded.
//! The files are compiled into the binary; [`shader_files`](super::shader_files) can read them from a folder instead.
//!
//! `//!include a b` inserts `shared/a.inc.wgsl` and `shared/b.inc.wgsl`. A file names all files whose functions or
//! variables it uses itself, and none that only these use. Each file is inserted once, after those that it includes.
//!
//! Some includes are not a single file:
//!
//! | include | inserts |
//! | --- | --- |
//! | `bindings` | the variables of group 1, which are generated from the declaration of the pass |
//! | `tables`, `changed_tables` | the file for the device's storage of the scene's tables; `tables` also has readers |
//! | `traverse` | the file for the device's traversal |
//! | `projection` | `grid_perspective`, or `grid_polar` in a polar projection |
//! | `rings` | the file of the polar projection: that of the run, or the one that the kernel includes |
//! | `cache` | `uncached` for passes that do not bind the radiance cache |

use std::borrow::Cow;
use std::path::Path;

use super::bindings::{bindings, variable};
use super::shader_files::{ShaderError, file, folder};
use super::specialization::Specialization;
use crate::device::{SceneAccess, ShaderChecks, Tables, Traversal};
use crate::graph::{Kernel, Pass, SceneUse, Use};
use crate::layout;
use crate::passes;
use crate::projection::PolarSpace;
use crate::wgsl::{declare, declare_arguments};

/// Start of a line that inserts files.
const INCLUDE: &str = "//!include ";
/// Include that declares the bindings of the pass.
const BINDINGS: &str = "bindings";
/// Includes with a file for each variant, see the documentation of the module.
const TABLES: &str = "tables";
const CHANGED_TABLES: &str = "changed_tables";
const TRAVERSE: &str = "traverse";
const PROJECTION: &str = "projection";
const RINGS: &str = "rings";
const CACHE: &str = "cache";

/// Start of the declaration of the projection's constants.
const CONSTANTS: &str = "@group(2) @binding(0) var<uniform> projection: ";

/// Selects one file of each include that has one for each variant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShaderVariant {
    pub access: SceneAccess,
    /// Polar projection of the traced images; `None` for the perspective projection.
    pub polar: Option<PolarSpace>,
}

/// Selects the perspective projection.
impl From<SceneAccess> for ShaderVariant {
    fn from(access: SceneAccess) -> Self {
        Self { access, polar: None }
    }
}

/// Complete source of a kernel's shader, and whether it is foreign (from outside the library). Only [`Self::new`]
/// constructs one, so no other code can pass foreign text off as the library's own.
pub(super) struct Shader {
    text: String,
    is_foreign: bool,
    /// Name of the projection's include; empty if the text does not depend on the projection.
    pub projection: &'static str,
}

impl Shader {
    /// Assembles the source of a kernel's shader with these bindings. Foreign text stays foreign whatever it includes,
    /// and all text from a folder is foreign.
    ///
    /// # Errors
    /// [`ShaderError`] if an include has no file, includes form a cycle, or a file cannot be read.
    pub fn new(kernel: &Kernel, uses: &[Use], variant: impl Into<ShaderVariant>) -> Result<Self, ShaderError> {
        let variant = variant.into();
        let expansion = Expansion::of(kernel, uses, variant, folder())?;
        Ok(Self {
            is_foreign: kernel.foreign_text().is_some() || folder().is_some(),
            projection: if expansion.has_projection { projection(variant.polar) } else { "" },
            text: expansion.text,
        })
    }

    pub fn text(&self) -> &str {
        &self.text
    }

    /// Returns true if the text, or a part of it, does not come with the library.
    pub fn is_foreign(&self) -> bool {
        self.is_foreign
    }

    /// Returns true if the shader reads constants of the projection, which are in group 2.
    pub fn reads_projection(&self) -> bool {
        self.text.contains(CONSTANTS)
    }

    /// Returns the run-time checks to compile with: all checks for a shader from outside the library, and `own` for the
    /// library's shaders.
    pub fn checks(&self, own: ShaderChecks) -> ShaderChecks {
        if self.is_foreign { ShaderChecks::Full } else { own }
    }

    /// Creates the pipeline of the shader's `main` with [`Self::checks`]. The device's error scope receives faults.
    pub fn pipeline(
        &self,
        device: &wgpu::Device,
        label: &str,
        layout: &wgpu::PipelineLayout,
        constants: &[(&str, f64)],
        own: ShaderChecks,
    ) -> wgpu::ComputePipeline {
        let main = Specialization {
            label,
            text: &self.text,
            entry_point: "main",
            constants,
            // A foreign shader might read workgroup memory before it writes it.
            zero_workgroup_memory: self.is_foreign,
        };
        match self.checks(own) {
            ShaderChecks::Full => main.pipeline(device, layout),
            // SAFETY: only the library's own shaders come here. Their loops end, their integer divisors are not 0, they
            // use ray queries as Vulkan defines, and their bounds stay checked.
            ShaderChecks::Fast => unsafe { main.trusted_pipeline(device, layout, ShaderChecks::Fast) },
        }
    }
}

/// Returns the complete source of a kernel's shader with these bindings: the host's structs and constants, the kernel's
/// own constants, and its file.
///
/// # Panics
/// If an include has no file, includes form a cycle, or a file cannot be read. A test covers all of the library's.
pub fn shader_text(kernel: &Kernel, uses: &[Use], variant: impl Into<ShaderVariant>) -> String {
    Expansion::of(kernel, uses, variant.into(), folder()).unwrap_or_else(|e| panic!("{e}")).text
}

/// A kernel's text, while its includes are inserted.
pub(super) struct Expansion<'a> {
    kernel: &'a Kernel,
    uses: &'a [Use],
    variant: ShaderVariant,
    folder: Option<&'a Path>,
    /// Name of the file of `rings`.
    rings: &'static str,
    pub text: String,
    /// True if the text includes the run's projection.
    has_projection: bool,
    /// Names of the inserted files.
    pub done: Vec<String>,
    /// Names of the files whose includes are being inserted, outermost first.
    open: Vec<String>,
}

impl<'a> Expansion<'a> {
    pub fn of(
        kernel: &'a Kernel,
        uses: &'a [Use],
        variant: ShaderVariant,
        folder: Option<&'a Path>,
    ) -> Result<Self, ShaderError> {
        let own = kernel.foreign_text().map_or_else(|| file(kernel.name, "the renderer", folder), |t| Ok(t.into()))?;
        let polar = PolarSpace::ALL.iter().map(|space| space.method().include());
        let named = polar.into_iter().find(|&name| includes(&own).any(|include| include == name));
        let mut new = Self {
            kernel,
            uses,
            variant,
            folder,
            rings: named.unwrap_or(projection(variant.polar)),
            text: layout::declarations() + &declare_arguments(kernel.arguments) + &declare(kernel.constants),
            has_projection: false,
            done: Vec::new(),
            open: Vec::new(),
        };
        new.insert(&own)?;
        if kernel.scene == SceneUse::Read && variant.access.traversal == Traversal::Hardware {
            // Directives must precede all declarations.
            new.text.insert_str(0, "enable wgpu_ray_query;\n");
        }
        Ok(new)
    }

    /// Appends a file after the files that it includes.
    fn insert(&mut self, file: &str) -> Result<(), ShaderError> {
        includes(file).try_for_each(|include| self.include(include))?;
        for line in file.lines().filter(|line| !line.starts_with(INCLUDE)) {
            self.text += line;
            self.text.push('\n');
        }
        Ok(())
    }

    fn include(&mut self, include: &str) -> Result<(), ShaderError> {
        let name = self.file_name(include).into_owned();
        if self.open.contains(&name) {
            return Err(ShaderError::Cycle(self.open.join(" > ") + " > " + &name));
        }
        self.has_projection |= include == PROJECTION;
        if self.done.contains(&name) {
            return Ok(());
        }
        if include == BINDINGS {
            self.text += &bindings(self.uses);
        } else {
            let by = self.open.last().map_or(self.kernel.name, String::as_str);
            let file = file(&format!("{name}.inc"), by, self.folder)?;
            self.text += &constants(&name);
            self.open.push(name.clone());
            self.insert(&file)?;
            self.open.pop();
        }
        if include == TABLES {
            self.text += &layout::readers();
        }
        self.done.push(name);
        Ok(())
    }

    /// Returns the name of the file that an include stands for.
    fn file_name<'b>(&self, include: &'b str) -> Cow<'b, str> {
        let ShaderVariant { access: SceneAccess { tables, traversal }, polar } = self.variant;
        match include {
            TABLES | CHANGED_TABLES => format!("{include}_{}", tables.name()).into(),
            TRAVERSE => format!("{include}_{}", traversal.name()).into(),
            PROJECTION if polar.is_some() => "grid_polar".into(),
            PROJECTION => projection(polar).into(),
            RINGS => self.rings.into(),
            CACHE if !self.uses.iter().any(|used| variable(used) == "last_cache") => "uncached".into(),
            _ => include.into(),
        }
    }
}

/// Returns the names that a file includes.
fn includes(file: &str) -> impl Iterator<Item = &str> {
    file.lines().filter_map(|line| line.strip_prefix(INCLUDE)).flat_map(str::split_whitespace)
}

/// Returns the declarations of the constants that a projection's include reads; empty for other includes.
fn constants(include: &str) -> String {
    let space = PolarSpace::ALL.iter().find(|space| space.method().include() == include);
    let declaration = space.and_then(|space| space.method().declaration());
    declaration.map_or_else(String::new, |of| format!("{of}{CONSTANTS}{};\n", of.name))
}

/// Returns the name of a projection's include.
fn projection(polar: Option<PolarSpace>) -> &'static str {
    polar.map_or("grid_perspective", |space| space.method().include())
}

/// Returns the [`shader_text`] of a pass.
pub fn pass_text(pass: &Pass, variant: impl Into<ShaderVariant>) -> String {
    shader_text(&pass.kernel, &pass.uses, variant)
}

/// Returns the [`shader_text`] of one of the renderer's own kernels.
///
/// # Panics
/// If no kernel has this name.
pub fn shader_text_of(name: &str, variant: impl Into<ShaderVariant>) -> String {
    let passes = passes::pass_of_each_kernel();
    let pass = passes.iter().find(|pass| pass.kernel.name == name).unwrap_or_else(|| panic!("no shader '{name}'"));
    pass_text(pass, variant)
}

/// Checks that all shaders can be read, if they come from a folder.
///
/// # Errors
/// [`ShaderError`] of a file that cannot be read, or of includes that form a cycle.
pub fn check_shaders() -> Result<(), ShaderError> {
    let passes = folder().map(|_| passes::pass_of_each_kernel()).unwrap_or_default();
    let accesses = [(Tables::Buffer, Traversal::Compute), (Tables::Texture, Traversal::Hardware)];
    let polar = || std::iter::once(None).chain(PolarSpace::ALL.iter().copied().map(Some));
    let variants = accesses.into_iter().flat_map(|(tables, traversal)| {
        polar().map(move |polar| ShaderVariant { access: SceneAccess { tables, traversal }, polar })
    });
    let mut all = variants.flat_map(|variant| passes.iter().map(move |pass| (pass, variant)));
    all.try_for_each(|(pass, variant)| Shader::new(&pass.kernel, &pass.uses, variant).map(|_| ()))
}

/// Returns the sources of all the renderer's shaders with the includes of all projections, to tell versions apart.
pub fn all_shader_text(access: SceneAccess) -> String {
    let own = passes::pass_of_each_kernel().iter().map(|pass| pass_text(pass, access)).collect::<String>();
    let polar = PolarSpace::ALL.iter().map(|space| space.method().include());
    let text = |name: &str| constants(name) + &file(&format!("{name}.inc"), PROJECTION, folder()).unwrap_or_default();
    own + &polar.chain(["grid_polar"]).map(text).collect::<String>()
}

/// Returns the names of a shader's override constants.
pub fn override_names(source: &str) -> Vec<&str> {
    source.lines().filter_map(|l| l.strip_prefix("override ")?.split(':').next()).collect()
}
