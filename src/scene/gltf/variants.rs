//! Material variants (`KHR_materials_variants`).

use ::gltf::json::Root;
use ::gltf::json::mesh::Primitive;
use serde_json::Value;

use super::fault::{Fault, Outcome};

const EXTENSION: &str = "KHR_materials_variants";

/// Returns the index of the variant of this name; `None` without a name, for the default look.
///
/// # Errors
/// A message with the names of the variants that the file has.
pub fn find(root: &Root, name: Option<&str>) -> Outcome<Option<usize>> {
    let Some(name) = name else { return Ok(None) };
    let extension = root.extensions.as_ref().and_then(|e| e.others.get(EXTENSION));
    let variants = extension.and_then(|e| e.get("variants")?.as_array()).map_or(&[][..], Vec::as_slice);
    let names: Vec<&str> = variants.iter().map(|v| v.get("name").and_then(Value::as_str).unwrap_or_default()).collect();
    let found = names.iter().position(|n| *n == name);
    let hint = || if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    found.map(Some).ok_or_else(|| Fault::Invalid(format!("it has no variant named '{name}': it has {}", hint())))
}

/// Returns the material that a primitive has in a variant, if it differs from the default look.
pub fn material(primitive: &Primitive, variant: usize) -> Option<usize> {
    let mappings = primitive.extensions.as_ref()?.others.get(EXTENSION)?.get("mappings")?.as_array()?;
    let applies = |mapping: &&Value| {
        let variants = mapping.get("variants").and_then(Value::as_array);
        variants.is_some_and(|all| all.iter().any(|v| v.as_u64() == Some(variant as u64)))
    };
    let material = mappings.iter().find(applies)?.get("material")?.as_u64()?;
    // A number that is too large fails where the material is looked up.
    Some(usize::try_from(material).unwrap_or(usize::MAX))
}
