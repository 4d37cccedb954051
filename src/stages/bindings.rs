//! Generates the WGSL of a pass's bindings. Names, address spaces and types follow from the uses that it declares.

use std::borrow::Cow;

use crate::graph::{Access, Format, Resource, Use};
use crate::scene::rig::Eye;

/// Returns the declarations of the variables that a pass binds, in order.
pub fn bindings(uses: &[Use]) -> String {
    let line = |(binding, used): (usize, &Use)| {
        let (space, of) = (address_space(used), type_name(used));
        format!("@group(1) @binding({binding}) var<{space}> {}: {of};\n", variable(used))
    };
    uses.iter().enumerate().map(line).collect()
}

/// Returns the name of the variable of a binding. Shaders call a source the left view, and each other view the right
/// one.
pub fn variable(used: &Use) -> Cow<'static, str> {
    let Resource { name, variable, .. } = used.image.resource;
    match (used.name, used.eye) {
        (Some(own), _) => own.into(),
        (None, Some(eye)) => format!("{}_{name}", if eye.is_source() { Eye::LEFT } else { Eye::RIGHT }).into(),
        (None, None) if used.is_before => format!("last_{name}").into(),
        (None, None) => variable.unwrap_or(name).into(),
    }
}

fn address_space(used: &Use) -> &'static str {
    match (used.image.resource.format, used.access) {
        (Format::Uniform { .. }, _) => "uniform",
        (_, Access::Read) => "storage, read",
        _ => "storage, read_write",
    }
}

fn type_name(used: &Use) -> String {
    match used.image.resource.format {
        Format::Uniform { name, .. } => name.to_owned(),
        Format::Texels { element, .. } => format!("array<{}>", used.element.unwrap_or(element)),
        // Passes that write a list need atomics, since invocations append concurrently. Passes that only read it see
        // plain integers, since WGSL forbids atomics in read-only bindings.
        Format::List if used.access == Access::Read => "array<u32>".to_owned(),
        Format::List => "array<atomic<u32>>".to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Extent;

    /// Checks names, address spaces and types.
    #[test]
    fn bindings_follow_from_the_declaration() {
        let hit: Resource = Resource::image::<glam::UVec4>("hit").bound_as("hit_image");
        let table = Resource::table::<[glam::Vec4; 2]>("boxes", Extent::new(1, 1));
        let list = Resource::list("holes");
        let uses = [
            Use::read(hit),
            Use::read(hit).before(None),
            Use::read(hit).before(None).of(Eye::LEFT),
            Use::write(hit).named("target_"),
            Use::update(table).viewed_as::<glam::UVec4>(),
            Use::read(list),
            Use::write_then_read(list),
            Use::read(Resource::constants("previous", "Previous", 16)),
        ];
        let expected = "\
            @group(1) @binding(0) var<storage, read> hit_image: array<vec4<u32>>;\n\
            @group(1) @binding(1) var<storage, read> last_hit: array<vec4<u32>>;\n\
            @group(1) @binding(2) var<storage, read> left_hit: array<vec4<u32>>;\n\
            @group(1) @binding(3) var<storage, read_write> target_: array<vec4<u32>>;\n\
            @group(1) @binding(4) var<storage, read_write> boxes: array<vec4<u32>>;\n\
            @group(1) @binding(5) var<storage, read> holes: array<u32>;\n\
            @group(1) @binding(6) var<storage, read_write> holes: array<atomic<u32>>;\n\
            @group(1) @binding(7) var<uniform> previous: Previous;\n";
        assert_eq!(bindings(&uses), expected);
    }
}
