//! Shader text: the files of `shaders/`, compiled into the binary, with their includes put in.
//!
//! `//!include a b` in a stage's file puts `shared/a.inc.wgsl` and `shared/b.inc.wgsl` there. Includes do not nest, so a
//! stage's first lines say all that it is made of.

/// How much wgpu guards shaders at run time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ShaderChecks {
    /// Everything: bounds, loops, integer division.
    Full,
    /// Bounds only. Our loops are bounded and our divisors are not zero.
    #[default]
    Fast,
}

impl ShaderChecks {
    pub fn runtime_checks(self) -> wgpu::ShaderRuntimeChecks {
        match self {
            Self::Full => wgpu::ShaderRuntimeChecks::checked(),
            Self::Fast => wgpu::ShaderRuntimeChecks { bounds_checks: true, ..wgpu::ShaderRuntimeChecks::unchecked() },
        }
    }
}

/// Names without extension, and texts, of all files in `shaders/`: made by the build script.
const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/shader_files.rs"));

fn file(name: &str) -> Option<&'static str> {
    FILES.iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}

/// The text of all files, to tell versions apart.
pub fn all_wgsl() -> String {
    FILES.iter().map(|(_, text)| *text).collect()
}

/// The whole text of a stage's shader.
///
/// # Panics
/// On a name or an include that no file has; a test goes through them all.
pub fn wgsl(name: &str) -> String {
    expand(name, file(name).unwrap_or_else(|| panic!("no shader '{name}'")))
}

/// `text` with its includes put in; `name` is for the panic.
pub(crate) fn expand(name: &str, text: &str) -> String {
    let mut out = String::with_capacity(text.len() * 8);
    for line in text.lines() {
        match line.strip_prefix("//!include ") {
            Some(names) => {
                for include in names.split_whitespace() {
                    let path = format!("{include}.inc");
                    out += file(&path).unwrap_or_else(|| panic!("shader '{name}' includes unknown '{include}'"));
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

/// Names of the override constants that a shader declares.
pub fn override_names(source: &str) -> Vec<&str> {
    source.lines().filter_map(|l| l.strip_prefix("override ")?.split(':').next()).collect()
}
