use super::bindings::bindings;
use super::shader::{Shader, pass_text};
use super::*;
use crate::accel::{Instance, Node};
use crate::device::{SceneAccess, ShaderChecks, Traversal};
use crate::graph::{Kernel, Pass, SceneUse, Stage};
use crate::image::Extent;
use crate::layout;
use crate::passes::{self, tests::all_specs};
use crate::projection::PolarSpace;
use crate::scene::needs::SceneNeeds;
use crate::wgsl::{Declaration, ROW_BYTES};

fn module(shader: &str) -> naga::Module {
    let source = shader_text_of(shader, SceneAccess::default());
    naga::front::wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{shader}: {}", e.emit_to_string(&source)))
}

#[test]
fn every_pass_matches_its_declaration() {
    let mut verified: Vec<Stage> = Vec::new();
    for spec in all_specs() {
        for pass in passes::declare(&spec).passes {
            if !verified.contains(&pass.stage) {
                verify(&pass).unwrap_or_else(|e| panic!("{}: {e}", pass.stage.name()));
                verified.push(pass.stage);
            }
        }
    }
    assert_eq!(verified.len(), 30);
}

/// Checks that bindings do not depend on the frame, since pipelines are created once.
#[test]
fn kernels_have_the_same_bindings_in_every_pass() {
    let mut known: Vec<(&str, String)> = Vec::new();
    for pass in all_specs().iter().flat_map(|spec| passes::declare(spec).passes) {
        let (name, found) = (pass.kernel.name, bindings(&pass.uses));
        match known.iter().find(|(kernel, _)| *kernel == name) {
            Some((_, text)) => assert_eq!(*text, found, "{name}"),
            None => known.push((name, found)),
        }
    }
}

/// Returns a struct's size and its members with their offsets, bytes, as the shader compiler lays it out.
fn reflect(module: &naga::Module, name: &str) -> Option<(usize, Vec<(String, usize)>)> {
    let (_, found) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name))?;
    let naga::TypeInner::Struct { members, span } = &found.inner else { return None };
    let members = members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset as usize));
    Some((*span as usize, members.collect()))
}

#[test]
fn host_structs_lie_as_shaders_read_them() {
    let check = |module: &naga::Module, Declaration { name, members, bytes }| {
        let declared = members.into_iter().map(|m| (m.name.to_owned(), m.offset)).collect();
        assert_eq!(reflect(module, name), Some((bytes, declared)), "{name}");
    };
    let path_trace = module("path_trace");
    layout::all_structs().into_iter().for_each(|declaration| check(&path_trace, declaration));
    for space in PolarSpace::ALL {
        let variant = ShaderVariant { polar: Some(*space), ..Default::default() };
        let module = naga::front::wgsl::parse_str(&shader_text_of("path_trace", variant)).unwrap();
        let declaration = space.method().declaration();
        assert_eq!(declaration.as_ref().map_or(0, |of| of.bytes), space.method().constants(Extent::new(64, 48)).len());
        declaration.into_iter().for_each(|declaration| check(&module, declaration));
    }
}

/// Checks row alignment: shaders read nodes and instances by rows, and an instance's header as a single row.
#[test]
fn tables_are_made_of_whole_rows() {
    let header = std::mem::offset_of!(Instance, first_prim);
    let last = std::mem::offset_of!(Instance, last_world_from_local);
    let local = std::mem::offset_of!(Instance, local_from_world);
    for bytes in [size_of::<Instance>(), size_of::<Node>(), local, header, last] {
        assert_eq!(bytes % ROW_BYTES, 0);
    }
    assert_eq!(last - header, ROW_BYTES);
}

#[test]
fn only_shaders_reading_the_scene_use_ray_queries() {
    for pass in passes::pass_of_each_kernel() {
        let kernel = pass.kernel;
        let [compute, hardware] =
            Traversal::ALL.map(|traversal| pass_text(&pass, SceneAccess { traversal, ..Default::default() }));
        assert!(!compute.contains("ray_query"), "{}", kernel.name);
        assert_eq!(hardware.starts_with("enable wgpu_ray_query;"), kernel.scene == SceneUse::Read, "{}", kernel.name);
        assert_eq!(hardware == compute, kernel.scene != SceneUse::Read, "{}", kernel.name);
    }
}

#[test]
fn custom_shaders_always_have_all_checks() {
    // Foreign text stays foreign even if it copies the text or the name of one of the library's shaders.
    let passes = passes::pass_of_each_kernel();
    let own = pass_text(&passes[0], SceneAccess::default());
    let include: &'static str = include_str!("../../shaders/tally.wgsl");
    for (name, text) in [("outline", "fn main() {}"), ("tally", include), ("gbuffer", own.leak())] {
        let foreign = Kernel::from_text(name, text);
        for kernel in [foreign, foreign.with(&[("COUNT", 1)]), foreign.reading_scene().workgroup([1; 3])] {
            let shader = Shader::new(&kernel, &[], SceneAccess::default()).unwrap();
            assert_eq!([ShaderChecks::Fast, ShaderChecks::Full].map(|set| shader.checks(set)), [ShaderChecks::Full; 2]);
        }
    }
    for Pass { kernel, uses, .. } in passes {
        let shader = Shader::new(&kernel, &uses, SceneAccess::default()).unwrap();
        for set in [ShaderChecks::Fast, ShaderChecks::Full] {
            assert_eq!(shader.checks(set), set, "{}", kernel.name);
        }
    }
}

#[test]
fn every_need_is_an_override_of_path_tracing() {
    let source = shader_text_of("path_trace", SceneAccess::default());
    let declared = override_names(&source);
    for (name, _) in SceneNeeds::ALL.constants() {
        assert!(declared.contains(&name), "{name}");
    }
}

#[test]
fn shaders_have_the_constants_of_their_kernels() {
    const COUNT: Kernel = Kernel::from_text("count", "const_assert COUNT == 3u && LIST_HEADER == 4u;");
    let parses =
        |kernel: Kernel| naga::front::wgsl::parse_str(&shader_text(&kernel, &[], SceneAccess::default())).is_ok();
    assert!(parses(COUNT.with(&[("COUNT", 3)])));
    assert!(!parses(COUNT.with(&[("COUNT", 4)])));
    for pass in passes::pass_of_each_kernel() {
        let text = pass_text(&pass, SceneAccess::default());
        for (name, _) in pass.kernel.constants {
            assert!(text.matches(name).count() > 1, "{} does not use {name}", pass.kernel.name);
        }
    }
}
