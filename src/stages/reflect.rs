//! Verifies by shader reflection that a shader uses its bindings as its pass declares.

use wgpu::naga::front::wgsl::parse_str;
use wgpu::naga::valid::{Capabilities, GlobalUse, ValidationFlags, Validator};
use wgpu::naga::{GlobalVariable, Handle, Module, Type, TypeInner};

use super::shader::{pass_text, shader_text};
use crate::device::{SceneAccess, Traversal};
use crate::graph::{Access, Format, Pass, SceneUse, Use};

/// Difference between a shader and the declaration of its pass.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Mismatch {
    #[error("the shader is not valid: {0}")]
    Invalid(String),
    #[error("the shader has no entry point named main")]
    NoMain,
    #[error("the shader declares bindings of group 1 itself, but the include `bindings` generates them")]
    OwnBindings,
    #[error("{0} is declared, but the shader never uses it")]
    Unused(&'static str),
    #[error("{0} is declared as written, but the shader never writes it")]
    Unwritten(&'static str),
    #[error("{0} is declared as write-only, but the shader reads it")]
    Read(&'static str),
    #[error("{0} is declared as read-write, but the shader never reads it")]
    Unread(&'static str),
    #[error("{0} is declared with elements of {1} bytes, but the shader's have {2}")]
    Format(&'static str, u32, u32),
    #[error("the workgroup size is declared as {0:?}, but the shader's is {1:?}")]
    Workgroup([u32; 3], [u32; 3]),
    #[error("scene access is declared as {0:?}, but the shader's is {1:?}")]
    Scene(SceneUse, SceneUse),
}

/// Checks a pass against its shader, for every kind of ray traversal.
///
/// # Errors
/// [`Mismatch`]: the first difference that is found.
pub fn verify(pass: &Pass) -> Result<(), Mismatch> {
    let access = |traversal| SceneAccess { traversal, ..Default::default() };
    Traversal::ALL.into_iter().try_for_each(|traversal| verify_for(pass, access(traversal)))
}

fn verify_for(pass: &Pass, access: SceneAccess) -> Result<(), Mismatch> {
    if shader_text(&pass.kernel, &[], access).contains("@group(1)") {
        return Err(Mismatch::OwnBindings);
    }
    let source = pass_text(pass, access);
    let module = parse_str(&source).map_err(|e| Mismatch::Invalid(e.emit_to_string(&source)))?;
    let info = Validator::new(ValidationFlags::all(), Capabilities::all())
        .validate(&module)
        .map_err(|e| Mismatch::Invalid(e.emit_to_string(&source)))?;
    let main = module.entry_points.iter().position(|e| e.name == "main").ok_or(Mismatch::NoMain)?;
    let workgroup = module.entry_points[main].workgroup_size;
    if workgroup != pass.kernel.workgroup {
        return Err(Mismatch::Workgroup(pass.kernel.workgroup, workgroup));
    }
    let flags = |handle: Handle<GlobalVariable>| info.get_entry_point(main)[handle];
    let of_group = |group| {
        let of = module.global_variables.iter().filter_map(move |(h, v)| Some((h, v, v.binding?)));
        of.filter(move |(.., b)| b.group == group).map(|(h, v, b)| (b.binding, v.ty, flags(h)))
    };
    let of_scene: Vec<_> = of_group(0).filter(|(binding, ..)| *binding > 0).map(|(.., flags)| flags).collect();
    let scene = match of_scene.iter().any(|flags| flags.contains(GlobalUse::WRITE)) {
        true => SceneUse::Write,
        false if of_scene.iter().any(|flags| !flags.is_empty()) => SceneUse::Read,
        false => SceneUse::No,
    };
    if scene != pass.kernel.scene {
        return Err(Mismatch::Scene(pass.kernel.scene, scene));
    }
    (0..).zip(&pass.uses).try_for_each(|(number, used)| {
        let bound = of_group(1).find(|(binding, ..)| *binding == number);
        let (_, ty, flags) = bound.ok_or(Mismatch::Unused(used.image.resource.name))?;
        check_access(used, flags)?;
        check_size(used, &module, ty)
    })
}

fn check_access(used: &Use, flags: GlobalUse) -> Result<(), Mismatch> {
    let name = used.image.resource.name;
    let touched = flags - GlobalUse::QUERY;
    if touched.is_empty() {
        return Err(Mismatch::Unused(name));
    }
    let is_atomic = touched.contains(GlobalUse::ATOMIC);
    let (reads, writes) =
        (is_atomic || touched.contains(GlobalUse::READ), is_atomic || touched.contains(GlobalUse::WRITE));
    match used.access {
        Access::Read => Ok(()),
        _ if !writes => Err(Mismatch::Unwritten(name)),
        Access::Write if reads => Err(Mismatch::Read(name)),
        // An update may write some texels without reading any.
        Access::Write | Access::Update => Ok(()),
        _ if !reads => Err(Mismatch::Unread(name)),
        _ => Ok(()),
    }
}

/// Checks the size in bytes of a uniform's struct or of an image's elements. The declared size can differ from the
/// shader's: a uniform states its size as a number, and [`Use::viewed_as`] changes the type of an image's elements.
fn check_size(used: &Use, module: &Module, ty: Handle<Type>) -> Result<(), Mismatch> {
    let (declared, found, fits) = match (used.image.resource.format, &module.types[ty].inner) {
        // A texel may span several array elements.
        (Format::Texels { bytes, .. }, TypeInner::Array { stride, .. }) => {
            (bytes, *stride, bytes.is_multiple_of(*stride))
        }
        (Format::Uniform { bytes, .. }, TypeInner::Struct { span, .. }) => (bytes, *span, bytes == *span),
        _ => return Ok(()),
    };
    if fits { Ok(()) } else { Err(Mismatch::Format(used.image.resource.name, declared, found)) }
}

#[cfg(test)]
mod tests;
