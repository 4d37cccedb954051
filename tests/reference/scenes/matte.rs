//! Lambertian scenes: every kind of light, textures, coverage, instances.

use diptych::image::Extent;
use diptych::scene::{AlphaMode, Environment, Light, LightKind, Material, Mesh, Texture, TextureRef, Wrap};
use glam::{Affine2, Affine3A, Quat, Vec3, vec2, vec3, vec4};

use super::*;

/// Returns all scenes of this file.
pub fn all() -> Vec<(Scene, Pinhole)> {
    vec![
        box_area_light(),
        sphere_light(),
        point_spot_directional(),
        environment_only(),
        textured_masked_blend(),
        instanced_mirrored(),
    ]
}

/// Adds a light.
fn shine(scene: &mut Scene, kind: LightKind, strength: Vec3) {
    scene.lights.push(Light { kind, strength });
}

/// A box open towards the camera with two blocks and a one-sided emissive quad under the ceiling.
pub fn box_area_light() -> (Scene, Pinhole) {
    let mut scene = empty("box_area_light");
    let white = add_matte(&mut scene, vec3(0.73, 0.73, 0.73));
    let red = add_matte(&mut scene, vec3(0.63, 0.06, 0.05));
    let green = add_matte(&mut scene, vec3(0.14, 0.45, 0.09));
    let lamp = Material { base_color: vec4(0.4, 0.4, 0.4, 1.0), emissive: vec3(6.0, 4.5, 2.5), ..matte() };
    let lamp = add_material(&mut scene, lamp);
    let (x, y, z) = (2.0 * Vec3::X, 2.0 * Vec3::Y, 2.0 * Vec3::Z);
    let corner = vec3(-1.0, 0.0, -1.0);
    place(&mut scene, quad(corner, z, x, white)); // floor, faces +y
    place(&mut scene, quad(corner + y, x, z, white)); // ceiling
    place(&mut scene, quad(corner, x, y, white)); // back
    place(&mut scene, quad(corner, y, z, red)); // left, faces +x
    place(&mut scene, quad(corner + x, z, y, green)); // right
    place(&mut scene, quad(vec3(-0.5, 1.98, -0.5), Vec3::X, Vec3::Z, lamp));
    let block = add_mesh(&mut scene, block(white));
    let stand = |size: Vec3, at: Vec3, turn_deg: f32| {
        let turn = Quat::from_rotation_y(turn_deg.to_radians());
        Affine3A::from_scale_rotation_translation(size, turn, at + Vec3::Y * (0.5 * size.y))
    };
    let tall = stand(vec3(0.6, 1.2, 0.6), vec3(-0.35, 0.0, -0.3), 18.0);
    let low = stand(vec3(0.6, 0.6, 0.6), vec3(0.35, 0.0, 0.35), -17.0);
    instance(&mut scene, block, tall);
    instance(&mut scene, block, low);
    (scene, Pinhole::looking_at(vec3(0.0, 1.0, 3.6), vec3(0.0, 1.0, 0.0), Vec3::Y, 40.0))
}

/// A corner with a ball and a block, lit by a spherical lamp and a spherical spot, both in the picture.
pub fn sphere_light() -> (Scene, Pinhole) {
    let mut scene = empty("sphere_light");
    let grey = add_matte(&mut scene, vec3(0.6, 0.6, 0.65));
    let ochre = add_matte(&mut scene, vec3(0.8, 0.5, 0.2));
    place(&mut scene, quad(vec3(-3.0, 0.0, -2.0), 5.0 * Vec3::Z, 6.0 * Vec3::X, grey));
    place(&mut scene, quad(vec3(-3.0, 0.0, -2.0), 6.0 * Vec3::X, 3.0 * Vec3::Y, grey));
    place_at(&mut scene, icosphere(3, true, ochre), scaled_at(0.5, vec3(-0.8, 0.5, -0.6)));
    place_at(&mut scene, block(ochre), scaled_at(0.6, vec3(0.7, 0.3, -0.9)));
    let point = LightKind::Point { position: vec3(0.1, 1.3, -0.3), radius: 0.35 };
    shine(&mut scene, point, vec3(3.0, 2.7, 2.0));
    let (position, direction) = (vec3(1.9, 1.8, 0.2), vec3(-0.45, -0.8, -0.35).normalize());
    let (cos_inner, cos_outer) = (15f32.to_radians().cos(), 40f32.to_radians().cos());
    let spot = LightKind::Spot { position, radius: 0.1, direction, cos_inner, cos_outer };
    shine(&mut scene, spot, vec3(2.0, 4.0, 6.0));
    (scene, Pinhole::looking_at(vec3(0.2, 1.5, 4.5), vec3(0.1, 0.8, -0.5), Vec3::Y, 42.0))
}

/// Lights without extent, and a sun with a disc of 3°, over a floor with a ball and a block.
pub fn point_spot_directional() -> (Scene, Pinhole) {
    let mut scene = empty("point_spot_directional");
    let grey = add_matte(&mut scene, vec3(0.7, 0.68, 0.66));
    let blue = add_matte(&mut scene, vec3(0.2, 0.35, 0.75));
    place(&mut scene, quad(vec3(-4.0, 0.0, -4.0), 8.0 * Vec3::Z, 8.0 * Vec3::X, grey));
    place_at(&mut scene, icosphere(3, true, blue), scaled_at(0.6, vec3(-0.9, 0.6, 0.0)));
    let cube = add_mesh(&mut scene, block(grey));
    let turn = Quat::from_rotation_y(0.6);
    let stretch = vec3(0.7, 1.1, 0.5);
    let stand = Affine3A::from_scale_rotation_translation(stretch, turn, vec3(0.8, 0.55, -0.2));
    instance(&mut scene, cube, stand);
    let point = LightKind::Point { position: vec3(0.0, 1.6, 0.9), radius: 0.0 };
    shine(&mut scene, point, vec3(1.5, 1.2, 0.8));
    let (position, direction) = (vec3(2.2, 2.4, 1.0), vec3(-0.6, -0.75, -0.3).normalize());
    let [cos_inner, cos_outer] = [10f32, 25.0].map(|degrees| degrees.to_radians().cos());
    let spot = LightKind::Spot { position, radius: 0.0, direction, cos_inner, cos_outer };
    shine(&mut scene, spot, vec3(4.0, 8.0, 4.0));
    let sun = |direction: Vec3, degrees: f32| LightKind::Directional {
        direction: direction.normalize(),
        angle_rad: degrees.to_radians(),
    };
    shine(&mut scene, sun(vec3(0.7, -1.0, -0.4), 0.0), vec3(0.3, 0.4, 0.6));
    shine(&mut scene, sun(vec3(-0.3, -0.8, 0.6), 3.0), vec3(0.9, 0.8, 0.6));
    (scene, Pinhole::looking_at(vec3(0.3, 2.0, 4.2), vec3(0.0, 0.5, 0.0), Vec3::Y, 45.0))
}

/// A rotated sky with a soft sun and a dark ground as the only light on a ball and a block on a floor.
pub fn environment_only() -> (Scene, Pinhole) {
    let mut scene = empty("environment_only");
    let grey = add_matte(&mut scene, vec3(0.5, 0.5, 0.5));
    let rose = add_matte(&mut scene, vec3(0.85, 0.5, 0.55));
    place(&mut scene, quad(vec3(-2.0, 0.0, -2.0), 4.0 * Vec3::Z, 4.0 * Vec3::X, grey));
    place_at(&mut scene, icosphere(3, true, rose), scaled_at(0.7, vec3(-0.6, 0.7, 0.0)));
    place_at(&mut scene, block(rose), scaled_at(0.8, vec3(0.8, 0.4, 0.3)));
    scene.environment = Environment::Map { image: sky(Extent::new(64, 32)).into(), rotation_deg: 70.0 };
    (scene, Pinhole::looking_at(vec3(0.0, 1.4, 4.0), vec3(0.0, 0.7, 0.0), Vec3::Y, 50.0))
}

/// Every wrap mode, nearest and bilinear, textured emission, a mask, and blending by texture and by vertex alpha.
pub fn textured_masked_blend() -> (Scene, Pinhole) {
    let mut scene = empty("textured_masked_blend");
    let image = add_image(&mut scene, checker(Extent::new(7, 5)));
    let mut add_texture = |wrap_u, wrap_v, linear| {
        scene.textures.push(Texture { image, wrap_u, wrap_v, linear });
        Some(TextureRef { texture: scene.textures.len() - 1, uv_set: 0, uv_from_uv: Affine2::IDENTITY })
    };
    let tiles = add_texture(Wrap::Repeat, Wrap::MirroredRepeat, true);
    let pixels = add_texture(Wrap::MirroredRepeat, Wrap::Repeat, false);
    let single = add_texture(Wrap::ClampToEdge, Wrap::ClampToEdge, true);
    let other_set = single.map(|t| TextureRef { uv_set: 1, ..t });
    let turned = Affine2::from_scale_angle_translation(vec2(1.4, 0.7), 0.4, vec2(0.15, -0.3));
    let pixels = pixels.map(|t| TextureRef { uv_from_uv: turned, ..t });
    let floor = Material { base_color_texture: tiles, ..matte() };
    let wall = Material { base_color: vec4(0.9, 0.7, 0.5, 1.0), base_color_texture: pixels, ..matte() };
    let leaf = Material {
        base_color_texture: single,
        alpha_mode: AlphaMode::Mask { cutoff: 0.5 },
        double_sided: true,
        ..matte()
    };
    let veil = Material {
        base_color: vec4(0.3, 0.8, 0.4, 0.8),
        base_color_texture: tiles,
        alpha_mode: AlphaMode::Blend,
        ..matte()
    };
    let panel = Material {
        base_color: vec4(0.1, 0.1, 0.1, 1.0),
        emissive: vec3(3.0, 2.5, 2.0),
        emissive_texture: other_set,
        double_sided: true,
        ..matte()
    };
    let [floor, wall, leaf, veil, panel] = [floor, wall, leaf, veil, panel].map(|m| add_material(&mut scene, m));
    let uvs = |mesh: Mesh, low: f32, high: f32| {
        let corners = [vec2(low, high), vec2(high, high), vec2(high, low), vec2(low, low)];
        Mesh { uvs: [corners.to_vec(), Vec::new()], ..mesh }
    };
    let ground = quad(vec3(-3.0, 0.0, -2.0), 5.0 * Vec3::Z, 6.0 * Vec3::X, floor);
    place(&mut scene, uvs(ground, -1.3, 2.6));
    let back = quad(vec3(-3.0, 0.0, -2.0), 6.0 * Vec3::X, 3.0 * Vec3::Y, wall);
    place(&mut scene, uvs(back, -2.2, 1.9));
    let masked = quad(vec3(-1.5, 0.1, -0.4), vec3(1.2, 0.0, 0.3), vec3(0.0, 1.3, -0.2), leaf);
    place(&mut scene, uvs(masked, -0.2, 1.2));
    let mut blended = quad(vec3(0.2, 0.2, 0.2), vec3(1.3, 0.0, -0.4), vec3(0.0, 1.2, 0.1), veil);
    blended.colors =
        vec![vec4(1.0, 1.0, 1.0, 1.0), vec4(1.0, 0.5, 1.0, 0.2), vec4(1.0, 1.0, 0.5, 0.9), vec4(0.5, 1.0, 1.0, 0.6)];
    place(&mut scene, uvs(blended, 0.0, 1.4));
    let mut lit = uvs(quad(vec3(-0.4, 1.4, -1.2), vec3(1.0, 0.0, 0.0), Vec3::Y * 0.7, panel), 0.0, 1.0);
    lit.uvs.swap(0, 1);
    place(&mut scene, lit);
    let point = LightKind::Point { position: vec3(0.4, 2.2, 2.0), radius: 0.0 };
    shine(&mut scene, point, vec3(4.0, 4.0, 4.5));
    scene.environment = Environment::Constant(vec3(0.2, 0.25, 0.3));
    (scene, Pinhole::looking_at(vec3(0.0, 1.3, 4.0), vec3(0.0, 0.8, -0.5), Vec3::Y, 45.0))
}

/// One mesh pair (a ball with smooth normals and a one-sided emissive badge beside it), placed plain, mirrored,
/// stretched and rotated, and both mirrored and stretched.
pub fn instanced_mirrored() -> (Scene, Pinhole) {
    let mut scene = empty("instanced_mirrored");
    let grey = add_matte(&mut scene, vec3(0.6, 0.6, 0.6));
    let ball = add_matte(&mut scene, vec3(0.7, 0.75, 0.3));
    let badge = Material { base_color: vec4(0.2, 0.2, 0.6, 1.0), emissive: vec3(2.0, 3.0, 4.0), ..matte() };
    let badge = add_material(&mut scene, badge);
    place(&mut scene, quad(vec3(-4.0, 0.0, -3.0), 6.0 * Vec3::Z, 8.0 * Vec3::X, grey));
    let ball = add_mesh(&mut scene, icosphere(2, true, ball));
    // The badge faces +x and slightly towards +z; the plain instance shines away from the ball.
    let (along, up) = (vec3(0.3, 0.0, -0.8), vec3(0.0, 0.8, 0.0));
    let badge = add_mesh(&mut scene, quad(vec3(1.2, -0.4, 0.4), along, up, badge));
    let turn = Quat::from_rotation_y(0.5) * Quat::from_rotation_z(0.4);
    for (scale, turn, at) in [
        (Vec3::splat(0.45), Quat::IDENTITY, vec3(-2.0, 0.6, 0.0)),
        (vec3(-0.45, 0.45, 0.45), Quat::IDENTITY, vec3(-0.2, 0.6, 0.3)),
        (vec3(0.3, 0.7, 0.45), turn, vec3(0.8, 0.9, -0.8)),
        (vec3(0.4, 0.6, -0.3), Quat::from_rotation_y(-0.7), vec3(1.9, 0.7, 0.3)),
    ] {
        let world_from_local = Affine3A::from_scale_rotation_translation(scale, turn, at);
        instance(&mut scene, ball, world_from_local);
        instance(&mut scene, badge, world_from_local);
    }
    let direction = vec3(0.5, -1.0, -0.6).normalize();
    shine(&mut scene, LightKind::Directional { direction, angle_rad: 0.0 }, vec3(1.0, 0.95, 0.9));
    scene.environment = Environment::Constant(vec3(0.1, 0.12, 0.15));
    (scene, Pinhole::looking_at(vec3(0.0, 1.8, 4.8), vec3(0.0, 0.6, 0.0), Vec3::Y, 45.0))
}
