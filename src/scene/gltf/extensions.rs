//! Supported glTF extensions, and errors and warnings for the others.

use ::gltf::json::Root;

use super::fault::{Fault, Outcome, Warnings};

/// Extensions that a file may require.
const READ: &[&str] = &[
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_meshopt_compression",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
];

/// Unsupported extensions that cause no warning, since they do not change the picture.
const UNREMARKABLE: &[&str] = &["KHR_xmp", "KHR_xmp_json_ld"];

/// Unsupported extensions, each with advice on how to convert a file so that it does not need the extension.
const CONVERTERS: &[(&str, &str)] = &[("MSFT_texture_dds", "export again with PNG or JPEG textures instead of DDS")];

/// Returns an error if a required extension is not supported. Warns of each unsupported optional one.
pub fn check(root: &Root, warnings: &mut Warnings) -> Outcome<()> {
    let mut missing: Vec<String> =
        root.extensions_required.iter().filter(|e| !READ.contains(&e.as_str())).cloned().collect();
    missing.sort_unstable();
    missing.dedup();
    if !missing.is_empty() {
        let hint = hint_for(&missing);
        return Err(Fault::Extensions { extensions: missing, hint });
    }
    for extension in root.extensions_used.iter().map(String::as_str) {
        if !READ.contains(&extension) && !UNREMARKABLE.contains(&extension) {
            warnings.note(&format!("extension {extension} is not supported and is ignored"), "");
        }
    }
    Ok(())
}

fn hint_for(missing: &[String]) -> String {
    let known: Vec<&str> = missing
        .iter()
        .filter_map(|e| CONVERTERS.iter().find(|(name, _)| name == e).map(|(_, advice)| *advice))
        .collect();
    if known.is_empty() { "; export the file without this".into() } else { format!("; {}", known.join(", ")) }
}
