use super::layout;
use super::*;
use crate::device::{override_names, wgsl};
use crate::graph::Stage;
use crate::passes::{self, tests::all_specs};

fn module(shader: &str) -> naga::Module {
    let source = wgsl(shader);
    naga::front::wgsl::parse_str(&source).unwrap_or_else(|e| panic!("{shader}: {}", e.emit_to_string(&source)))
}

#[test]
fn every_pass_does_what_it_declares() {
    let mut verified: Vec<Stage> = Vec::new();
    for spec in all_specs() {
        for pass in passes::declare(&spec).passes {
            if !verified.contains(&pass.stage) {
                verify(&pass).unwrap_or_else(|e| panic!("{}: {e}", pass.stage.name()));
                verified.push(pass.stage);
            }
        }
    }
    assert_eq!(verified.len(), 15);
}

/// Size and member offsets of a struct, as the shader compiler lays it out.
fn reflect(module: &naga::Module, name: &str) -> Option<(u32, Vec<(String, u32)>)> {
    module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).map(|(_, t)| match &t.inner {
        naga::TypeInner::Struct { members, span } => {
            (*span, members.iter().map(|m| (m.name.clone().unwrap_or_default(), m.offset)).collect())
        }
        other => panic!("{name} is {other:?}"),
    })
}

macro_rules! same_layout {
    ($module:expr, $wgsl:literal, $rust:ty, [$($field:ident = $name:literal),* $(,)?]) => {{
        let (size, members) = reflect($module, $wgsl).expect($wgsl);
        assert_eq!(size as usize, size_of::<$rust>(), "size of {}", $wgsl);
        $(
            let offset = std::mem::offset_of!($rust, $field) as u32;
            assert!(members.contains(&($name.to_owned(), offset)), "{}.{} at {offset}: {members:?}", $wgsl, $name);
        )*
    }};
}

#[test]
fn host_structs_lie_as_shaders_read_them() {
    let m = &module("path_trace");
    same_layout!(
        m,
        "View",
        layout::View,
        [
            origin = "origin",
            tan_half_x = "tan_half_x",
            right = "right",
            tan_half_y = "tan_half_y",
            up = "up",
            forward = "forward"
        ]
    );
    same_layout!(
        m,
        "Frame",
        layout::Frame,
        [
            views = "views",
            width = "width",
            height = "height",
            index = "index",
            seed = "seed",
            spp = "spp",
            reflections = "reflections",
            indirect_clamp = "indirect_clamp",
            exposure = "exposure",
            light_groups = "light_groups",
            env_width = "env_width",
            env_height = "env_height",
            env_radiance = "env_radiance",
            env_rotation = "env_rotation",
            sphere_tree = "sphere_tree",
            sphere_tree_end = "sphere_tree_end",
            light_tree = "light_tree",
            local_lights = "local_lights",
            directional_lights = "directional_lights",
            env_grid_width = "env_grid_width",
            env_grid_height = "env_grid_height",
            sample_base = "sample_base",
            instances = "instances",
            world_origin = "world_origin",
            instance_tree = "instance_tree",
            instance_count = "instance_count",
            curve_shift = "curve_shift",
            history_rows = "history_rows",
            centre = "centre",
            fovea_radii = "fovea_radii",
            gaze = "gaze",
            layer_iterations = "layer_iterations",
            unsampled_share = "unsampled_share",
            mask_turn = "mask_turn"
        ]
    );
    same_layout!(
        m,
        "Pass",
        layout::PassConstants,
        [
            view = "view",
            row_begin = "row_begin",
            row_end = "row_end",
            valid_begin = "valid_begin",
            valid_end = "valid_end",
            args = "arg0",
            width = "width",
            height = "height",
            device = "device"
        ]
    );
    same_layout!(
        m,
        "Material",
        layout::Material,
        [
            base_color = "base_color",
            emissive = "emissive",
            roughness = "roughness",
            metallic = "metallic",
            alpha_cutoff = "alpha_cutoff",
            flags = "flags",
            ior = "ior",
            specular = "specular",
            transmission = "transmission",
            clearcoat = "clearcoat",
            specular_color = "specular_color",
            clearcoat_roughness = "clearcoat_roughness",
            absorption = "absorption",
            normal_scale = "normal_scale",
            first_texture = "first_texture",
            texture_count = "texture_count",
            clearcoat_normal_scale = "clearcoat_normal_scale"
        ]
    );
    same_layout!(
        m,
        "TextureInfo",
        layout::TextureInfo,
        [
            first = "first",
            width = "width",
            height = "height",
            flags = "flags",
            uv_matrix = "uv_matrix",
            uv_offset = "uv_offset"
        ]
    );
    same_layout!(
        m,
        "Light",
        layout::Light,
        [
            position = "position",
            kind = "kind",
            strength = "strength",
            radius = "radius",
            axis = "axis",
            cos_outer = "cos_outer",
            cone_scale = "cone_scale",
            pick = "pick",
            keep = "keep",
            alias = "alias_",
            prim = "prim",
            trail = "trail"
        ]
    );
    same_layout!(m, "EnvCell", layout::EnvCell, [keep = "keep", alias = "alias_", density = "density"]);
    same_layout!(
        m,
        "Triangle",
        crate::accel::Triangle,
        [v0 = "v0", material = "material", v1 = "v1", flags = "flags", v2 = "v2", light = "light"]
    );
    same_layout!(
        m,
        "Shading",
        crate::accel::Shading,
        [n0 = "n0", u0 = "u0", n1 = "n1", v0 = "v0", n2 = "n2", u1 = "u1", v1 = "v1", u2 = "u2", v2 = "v2"]
    );
}

#[test]
fn instances_take_the_rows_that_shaders_count() {
    let m = module("path_trace");
    let rows = m.constants.iter().find(|(_, c)| c.name.as_deref() == Some("ROWS_PER_INSTANCE")).expect("is declared").1;
    let bytes = size_of::<crate::accel::Instance>() as u32;
    assert_eq!(m.global_expressions[rows.init], naga::Expression::Literal(naga::Literal::U32(bytes / 16)));
    assert_eq!(bytes % 16, 0);
}

#[test]
fn every_need_is_an_override_of_path_tracing() {
    let source = wgsl("path_trace");
    let declared = override_names(&source);
    for (name, _) in SceneNeeds::ALL.constants() {
        assert!(declared.contains(&name), "{name}");
    }
}
