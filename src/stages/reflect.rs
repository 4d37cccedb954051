//! Verifies by shader reflection that a shader's bindings match the declaration of its pass.

use wgpu::naga::front::wgsl::parse_str;
use wgpu::naga::valid::{Capabilities, GlobalUse, ValidationFlags, Validator};
use wgpu::naga::{AddressSpace, GlobalVariable, Handle, Module, StorageAccess, TypeInner};

use super::shader::shader_text;
use crate::device::{SceneAccess, Traversal};
use crate::graph::{Access, Format, Pass, SceneUse, Use};

/// Difference between a shader and the declaration of its pass.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Mismatch {
    #[error("the shader is not valid: {0}")]
    Invalid(String),
    #[error("the shader has no entry point named main")]
    NoMain,
    #[error("the shader uses binding {0}, which the pass does not declare")]
    Undeclared(u32),
    #[error("{0} is declared, but the shader never uses it")]
    Unused(&'static str),
    #[error("{0} is declared as read-only, but the shader writes it")]
    Written(&'static str),
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
/// The first [`Mismatch`].
pub fn verify(pass: &Pass) -> Result<(), Mismatch> {
    let access = |traversal| SceneAccess { traversal, ..Default::default() };
    Traversal::ALL.into_iter().try_for_each(|traversal| verify_for(pass, access(traversal)))
}

fn verify_for(pass: &Pass, access: SceneAccess) -> Result<(), Mismatch> {
    let source = shader_text(&pass.kernel, access);
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
    let bound = |group, binding| {
        let is = |v: &GlobalVariable| v.binding.is_some_and(|b| (b.group, b.binding) == (group, binding));
        module.global_variables.iter().find(move |(_, v)| is(v))
    };
    let of_group = |group| {
        let of = module.global_variables.iter().filter_map(move |(h, v)| Some((h, v.binding?)));
        of.filter(move |(_, b)| b.group == group).map(|(h, b)| (h, b.binding))
    };
    let of_scene: Vec<_> = of_group(0).filter(|(_, binding)| *binding > 0).map(|(handle, _)| flags(handle)).collect();
    let scene = match of_scene.iter().any(|flags| flags.contains(GlobalUse::WRITE)) {
        true => SceneUse::Write,
        false if of_scene.iter().any(|flags| !flags.is_empty()) => SceneUse::Read,
        false => SceneUse::No,
    };
    if scene != pass.kernel.scene {
        return Err(Mismatch::Scene(pass.kernel.scene, scene));
    }
    if let Some((_, binding)) = of_group(1).find(|(_, binding)| *binding as usize >= pass.uses.len()) {
        return Err(Mismatch::Undeclared(binding));
    }
    for (binding, used) in pass.uses.iter().enumerate() {
        let name = used.image.resource.name;
        let (handle, variable) = bound(1, binding as u32).ok_or(Mismatch::Unused(name))?;
        check_access(used, variable, flags(handle))?;
        check_format(used, &module, variable)?;
    }
    Ok(())
}

fn check_access(used: &Use, variable: &GlobalVariable, flags: GlobalUse) -> Result<(), Mismatch> {
    let name = used.image.resource.name;
    let touched = flags - GlobalUse::QUERY;
    if touched.is_empty() {
        return Err(Mismatch::Unused(name));
    }
    let is_atomic = touched.contains(GlobalUse::ATOMIC);
    let (reads, writes) =
        (is_atomic || touched.contains(GlobalUse::READ), is_atomic || touched.contains(GlobalUse::WRITE));
    let may_write = match variable.space {
        AddressSpace::Storage { access } => access.contains(StorageAccess::STORE),
        _ => false,
    };
    match used.access {
        Access::Read if writes || may_write => Err(Mismatch::Written(name)),
        Access::Read => Ok(()),
        _ if !writes => Err(Mismatch::Unwritten(name)),
        Access::Write if reads => Err(Mismatch::Read(name)),
        Access::Write => Ok(()),
        _ if !reads => Err(Mismatch::Unread(name)),
        _ => Ok(()),
    }
}

fn check_format(used: &Use, module: &Module, variable: &GlobalVariable) -> Result<(), Mismatch> {
    let declared = match used.image.resource.format {
        Format::Texels(bytes) | Format::Uniform(bytes) => bytes,
        Format::List => 4,
    };
    let found = match (&module.types[variable.ty].inner, used.image.resource.format) {
        (TypeInner::Array { stride, .. }, Format::Texels(_) | Format::List) => *stride,
        (TypeInner::Struct { span, .. }, Format::Uniform(_)) => *span,
        _ => 0,
    };
    // A texel may span several array elements.
    let fits = match used.image.resource.format {
        Format::Texels(_) => found > 0 && declared.is_multiple_of(found),
        Format::List | Format::Uniform(_) => found == declared,
    };
    if fits { Ok(()) } else { Err(Mismatch::Format(used.image.resource.name, declared, found)) }
}

#[cfg(test)]
mod tests;
