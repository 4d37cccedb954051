//! Validates every shader that a device may be given, in all its variants, without a device. wgpu runs the same
//! validation before it calls the driver.

use std::collections::HashSet;
use std::path::Path;

use naga::back::pipeline_constants::process_overrides;
use naga::front::wgsl::{Frontend, Options};
use naga::valid::{ModuleInfo, ValidationFlags, Validator};
use naga::{Module, ShaderStage};

use super::shader::{Expansion, pass_text};
use super::shader_files::FILES;
use super::specialization::capabilities;
use super::*;
use crate::device::{SceneAccess, Tables, Traversal};
use crate::frame::RunConfig;
use crate::graph::{Kernel, SceneUse, Use};
use crate::image::Extent;
use crate::passes;
use crate::projection::PolarSpace;
use crate::scene::needs::SceneNeeds;

fn validated(text: &str, traversal: Traversal) -> Result<(Module, ModuleInfo), String> {
    let capabilities = capabilities(traversal.features());
    let mut options = Options::new();
    options.capabilities = capabilities;
    let module = Frontend::new_with_options(options).parse(text).map_err(|e| e.emit_to_string(text))?;
    let mut validator = Validator::new(ValidationFlags::all(), capabilities);
    let info = validator.validate(&module).map_err(|e| e.emit_to_string(text))?;
    Ok((module, info))
}

/// Validates a shader with its override constants all off, each one alone on, and all on. Returns the number of
/// variants.
fn validate_variants(text: &str, traversal: Traversal) -> Result<usize, String> {
    let (module, info) = validated(text, traversal)?;
    let main = (ShaderStage::Compute, "main");
    if !module.entry_points.iter().any(|entry| (entry.stage, entry.name.as_str()) == main) {
        return Err("there is no compute shader main".to_owned());
    }
    let mut names = override_names(text);
    names.sort_unstable();
    let mut declared: Vec<_> = module.overrides.iter().filter_map(|(_, constant)| constant.name.as_deref()).collect();
    declared.sort_unstable();
    if declared != names {
        return Err(format!("the shader declares {declared:?}, and {names:?} are found"));
    }
    let alone = names.iter().map(|&on| vec![on]);
    let mut variants: Vec<Vec<&str>> = [Vec::new(), names.clone()].into_iter().chain(alone).collect();
    variants.sort();
    variants.dedup();
    for on in &variants {
        let value = |name: &&str| ((*name).to_owned(), f64::from(u8::from(on.contains(name))));
        let constants = names.iter().map(value).collect();
        process_overrides(&module, &info, Some(main), &constants).map_err(|e| format!("with {on:?}: {e}"))?;
    }
    Ok(variants.len())
}

#[test]
fn every_variant_of_every_shader_is_valid() {
    let config = RunConfig::new(Extent::new(1, 1), SceneNeeds::ALL);
    let settable: Vec<&str> = config.constants(false).into_iter().map(|(name, _)| name).collect();
    let mut texts = Vec::new();
    for (tables, traversal) in
        [Tables::Buffer, Tables::Texture].into_iter().flat_map(|t| Traversal::ALL.map(|u| (t, u)))
    {
        let passes = passes::pass_of_each_kernel();
        let projections = || std::iter::once(None).chain(PolarSpace::ALL.iter().copied().map(Some));
        for (pass, polar) in passes.iter().flat_map(|pass| projections().map(move |polar| (pass, polar))) {
            let text = pass_text(pass, ShaderVariant { access: SceneAccess { tables, traversal }, polar });
            if texts.contains(&text) {
                continue;
            }
            let of = format!("{} with {tables:?}, {traversal:?} and {polar:?}", pass.kernel.name);
            for name in override_names(&text) {
                assert!(settable.contains(&name), "{of}: nothing sets {name}");
            }
            validate_variants(&text, traversal).unwrap_or_else(|e| panic!("{of}: {e}"));
            texts.push(text);
        }
    }
}

/// Compiles every include with its own includes alone. Bindings are those of a pass that includes it.
#[test]
fn every_include_is_valid_alone() {
    let accesses = [(Tables::Buffer, Traversal::Compute), (Tables::Texture, Traversal::Hardware)];
    let accesses = accesses.map(|(tables, traversal)| SceneAccess { tables, traversal });
    let polar = PolarSpace::ALL.iter().copied().map(Some);
    let variants =
        std::iter::once(None).chain(polar).flat_map(|polar| accesses.map(|a| ShaderVariant { access: a, polar }));
    let (mut files, mut texts) = (HashSet::new(), HashSet::new());
    for (variant, pass) in variants.flat_map(|v| passes::pass_of_each_kernel().into_iter().map(move |pass| (v, pass))) {
        for include in Expansion::of(&pass.kernel, &pass.uses, variant, None).unwrap().done {
            // Kernels of polar images include their projection themselves.
            if include == "bindings" || (include == "grid_polar" && variant.polar.is_none()) {
                continue;
            }
            let text = format!("//!include {include}").leak();
            let mut kernel = Kernel::from_text("alone", text).with(pass.kernel.constants);
            kernel.arguments = pass.kernel.arguments;
            let kernel = if pass.kernel.scene == SceneUse::Read { kernel.reading_scene() } else { kernel };
            let text = shader_text(&kernel, &pass.uses, variant);
            if !texts.contains(&text) {
                validated(&text, variant.access.traversal)
                    .unwrap_or_else(|e| panic!("{include} with {variant:?}: {e}"));
                texts.insert(text);
            }
            files.insert(format!("{include}.inc"));
        }
    }
    let unused: Vec<_> =
        FILES.iter().filter(|(n, ..)| n.ends_with(".inc") && !files.contains(*n)).map(|(n, ..)| n).collect();
    assert!(unused.is_empty(), "no pass includes {unused:?}");
}

#[test]
fn each_include_is_inserted_once() {
    const PARTS: &str = "//!include frame grid projection rng scene light_tree environment lights trace traverse hits
//!include reflectance parameters surface facets bsdf split path motion last_surface mirror_motion mirror pack mirrored
//!include mirrored grid frame";
    for polar in [None, Some(PolarSpace::ALL[0])] {
        let kernel = Kernel::from_text("foreign", PARTS).reading_scene();
        let text = shader_text(&kernel, &[], ShaderVariant { polar, ..Default::default() });
        validated(&text, Traversal::Compute).unwrap_or_else(|e| panic!("{e}"));
    }
}

#[test]
fn rejects_invalid_shader_texts() {
    let access = SceneAccess { traversal: Traversal::Hardware, ..Default::default() };
    let text = shader_text_of("path_trace", access);
    let refused = |text: &str, traversal, reason: &str| {
        let error = validate_variants(text, traversal).expect_err(reason);
        assert!(error.contains(reason), "{error}");
    };
    refused(&text, Traversal::Compute, "ray_query");
    for (part, broken, reason) in [
        ("override HAS_ALPHA: bool", "override HAS_ALPHA: u32", "HAS_ALPHA"),
        ("override HAS_ALPHA: bool", "  override HAS_ALPHA: bool", "are found"),
        ("fn main(", "fn other(", "no compute shader main"),
    ] {
        assert!(text.contains(part), "{part}");
        refused(&text.replacen(part, broken, 1), Traversal::Hardware, reason);
    }
    let sized = |size: &str| format!("override ON: bool = true;\n@compute @workgroup_size({size}) fn main() {{}}");
    assert_eq!(validate_variants(&sized("4u * u32(ON) + 4u"), Traversal::Compute), Ok(2));
    refused(&sized("4u / u32(ON)"), Traversal::Compute, "with []");
}

#[test]
fn shader_folder_replaces_embedded_files() {
    let shaders = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/shaders"));
    let text = |kernel: &Kernel, uses: &[Use], folder| {
        Ok::<_, String>(Expansion::of(kernel, uses, ShaderVariant::default(), folder).map_err(|e| e.to_string())?.text)
    };
    for pass in passes::pass_of_each_kernel() {
        assert_eq!(text(&pass.kernel, &pass.uses, Some(shaders)), text(&pass.kernel, &pass.uses, None));
    }
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        std::fs::create_dir_all(folder.path().join("shared")).unwrap();
        std::fs::write(folder.path().join("shared").join(name), text).unwrap();
    };
    let refused =
        |include: &'static str| text(&Kernel::from_text("mine", include), &[], Some(folder.path())).unwrap_err();
    write("a.inc.wgsl", "//!include b");
    write("b.inc.wgsl", "//!include a");
    assert!(refused("//!include a").ends_with("form a cycle: a > b > a"), "{}", refused("//!include a"));
    assert!(refused("//!include rng").contains("shared/rng.inc.wgsl"), "{}", refused("//!include rng"));
    write("c.inc.wgsl", "const C: u32 = 1u;");
    let own = text(&Kernel::from_text("mine", "//!include c"), &[], Some(folder.path()));
    assert!(own.unwrap().contains("const C: u32 = 1u;"));
}
