//! Reflects a shader's declarations.

use naga::{AddressSpace, StorageAccess};

#[derive(Clone, Copy, PartialEq)]
pub enum Kind {
    Uniform,
    Read,
    Write,
}

/// A binding of group 1, of the projection, or of the scene's tables if a shader writes them.
#[derive(Clone)]
pub struct Binding {
    pub name: String,
    pub group: u32,
    pub number: u32,
    pub kind: Kind,
}

/// Panics unless both lists contain the same names, each once.
pub fn assert_same_names(what: &str, declared: &[&str], given: &[&str]) {
    let missing: Vec<_> = declared.iter().filter(|name| !given.contains(name)).collect();
    let unknown: Vec<_> = given.iter().filter(|name| !declared.contains(name)).collect();
    assert!(
        missing.is_empty() && unknown.is_empty() && declared.len() == given.len(),
        "{what}: the shader declares {declared:?}; the test lacks {missing:?} and has {unknown:?} beside them"
    );
}

/// Returns the binding; none if it belongs to group 0, unless the shader writes it.
pub fn binding(variable: &naga::GlobalVariable) -> Option<Binding> {
    let stores = |space| matches!(space, AddressSpace::Storage { access } if access.contains(StorageAccess::STORE));
    let place = variable.binding.filter(|b| b.group >= 1 || stores(variable.space))?;
    let name = variable.name.clone()?;
    let kind = match variable.space {
        AddressSpace::Uniform => Kind::Uniform,
        AddressSpace::Storage { access } if access.contains(StorageAccess::STORE) => Kind::Write,
        AddressSpace::Storage { .. } => Kind::Read,
        other => panic!("'{name}' is in {other:?}, which the harness does not bind"),
    };
    Some(Binding { name, group: place.group, number: place.binding, kind })
}

pub fn layout_entry(binding: u32, kind: Kind) -> wgpu::BindGroupLayoutEntry {
    let ty = match kind {
        Kind::Uniform => wgpu::BufferBindingType::Uniform,
        Kind::Read => wgpu::BufferBindingType::Storage { read_only: true },
        Kind::Write => wgpu::BufferBindingType::Storage { read_only: false },
    };
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    }
}
