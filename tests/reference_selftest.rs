//! The reference path tracer and its z-test, held against closed forms.
//!
//! Where the estimator has no variance the answer must be exact (to f32 input); elsewhere it must lie within
//! 4.5 standard errors, which must be small.

mod reference;

use std::f64::consts::PI;

use diptych::image::{Extent, Image, RgbImage};
use diptych::scene::{AlphaMode, Environment, Light, LightKind, Material, Scene, Texture, TextureRef, Wrap};
use glam::{Affine2, Affine3A, DVec2, DVec3, Quat, Vec2, Vec3, vec2, vec3, vec4};

use reference::intersect::{Geometry, Ray, Triangle};
use reference::sampling::{Rng, cone_direction, cosine_direction};
use reference::scenes::{
    add_image, add_material, add_matte, add_mesh, all, block, box_area_light, empty, icosphere, instance, matte, place,
    quad, scaled_at,
};
use reference::ztest::{Estimate, Moments, assert_agrees, compare, mean_and_variance, verdict};
use reference::{Emitters, Pinhole, Reference, texture};

// Helpers.

/// The value must be `expected` to f32 input, and without noise.
#[track_caller]
fn assert_exact(found: &Estimate, expected: [f64; 3]) {
    for (c, &e) in expected.iter().enumerate() {
        let (mean, sigma) = (found.mean[0][c], found.variance_of_mean[0][c].sqrt());
        let allowed = 1e-5 * e.abs() + 1e-9;
        assert!((mean - e).abs() <= allowed, "channel {c}: {mean} is not {e}");
        assert!(sigma <= allowed, "channel {c}: {mean} ± {sigma} has noise");
    }
}

/// The value must be `expected` within its noise, and the noise be below `resolution` of it.
#[track_caller]
fn assert_near(found: &Estimate, expected: f64, resolution: f64) {
    for c in 0..3 {
        let (mean, sigma) = (found.mean[0][c], found.variance_of_mean[0][c].sqrt());
        let z = (mean - expected) / (sigma + 1e-5 * expected.abs());
        assert!(z.abs() < 4.5, "channel {c}: {mean} ± {sigma} is not {expected} (z = {z:.2})");
        assert!(sigma <= resolution * expected.abs(), "channel {c}: {mean} ± {sigma} is too noisy");
    }
}

/// A floor at y = 0 that faces up, 20 wide.
fn floor(scene: &mut Scene, albedo: Vec3) {
    let material = add_matte(scene, albedo);
    place(scene, quad(vec3(-10.0, 0.0, -10.0), 20.0 * Vec3::Z, 20.0 * Vec3::X, material));
}

fn white_floor(name: &str) -> Scene {
    let mut scene = empty(name);
    floor(&mut scene, Vec3::ONE);
    scene
}

/// Radiance that the point (x, 0, z) of the floor sends up and aside.
fn look_at_floor(scene: &Scene, x: f32, z: f32, spp: u32, bounces: u32) -> Estimate {
    let away = vec3(0.3, 0.4, -0.2);
    Reference::new(scene).probe(vec3(x, 0.0, z) + away, -away, spp, bounces, 1)
}

fn point(position: Vec3, radius: f32, strength: Vec3) -> Light {
    Light { kind: LightKind::Point { position, radius }, strength }
}

/// A one-sided lamp of radiance `emissive` that faces down (or up), 2 × 1 at height 1 over (0, 0, 0).
fn lamp_over_origin(scene: &mut Scene, emissive: f32, down: bool, double_sided: bool) {
    let lamp = Material { emissive: Vec3::splat(emissive), double_sided, ..matte() };
    let material = add_material(scene, Material { base_color: vec4(0.0, 0.0, 0.0, 1.0), ..lamp });
    let (u, v) = (2.0 * Vec3::X, Vec3::Z);
    let (u, v) = if down { (u, v) } else { (v, u) };
    place(scene, quad(vec3(-1.0, 1.0, -0.5), u, v, material));
}

// Closed forms: energy.

#[test]
fn a_convex_body_in_a_white_furnace_has_its_albedo() {
    let mut scene = empty("furnace");
    let albedo = vec3(1.0, 0.5, 0.2);
    let material = add_matte(&mut scene, albedo);
    let ball = add_mesh(&mut scene, icosphere(2, false, material));
    instance(&mut scene, ball, Affine3A::IDENTITY);
    scene.environment = Environment::Constant(Vec3::ONE);
    let reference = Reference::new(&scene);
    for bounces in [0, 1, 5] {
        let off_axis = vec3(0.1, 0.2, 5.0);
        let seen = reference.probe(off_axis, -off_axis + vec3(0.3, 0.1, 0.0), 200, bounces, 1);
        assert_exact(&seen, albedo.as_dvec3().to_array());
    }
    let past = reference.probe(vec3(0.0, 0.0, 5.0), Vec3::Y, 2, 3, 1);
    assert_exact(&past, [1.0; 3]);
}

/// Every wall emits 1 and reflects ρ: after k reflections ρᵏ arrives, and k runs to bounces + 1.
#[test]
fn a_closed_glowing_box_is_a_truncated_geometric_series() {
    let mut scene = empty("box");
    let rho = [0.5f32, 0.8, 1.0];
    let wall =
        Material { base_color: vec4(rho[0], rho[1], rho[2], 1.0), emissive: Vec3::ONE, double_sided: true, ..matte() };
    let wall = add_material(&mut scene, wall);
    let cube = add_mesh(&mut scene, block(wall));
    let turn = Quat::from_rotation_y(0.4);
    let place = Affine3A::from_scale_rotation_translation(vec3(2.0, 3.0, 1.5), turn, Vec3::ONE);
    instance(&mut scene, cube, place);
    let reference = Reference::new(&scene).with_emitters(Emitters::BounceHits);
    for bounces in [0, 1, 4, 16] {
        let expected = rho.map(|r| (0..=bounces + 1).map(|k| f64::from(r).powi(k as i32)).sum());
        let seen = reference.probe(Vec3::ONE, vec3(0.3, -0.5, 0.7), 500, bounces, 2);
        assert_exact(&seen, expected);
    }
}

/// In a sphere around a point light the direct irradiance is I/R², and reflected light is even everywhere.
#[test]
fn an_integrating_sphere_is_a_truncated_geometric_series_of_explicit_samples() {
    let mut scene = empty("integrating sphere");
    let rho = 0.7f64;
    let material = add_matte(&mut scene, Vec3::splat(rho as f32));
    let ball = add_mesh(&mut scene, icosphere(4, false, material));
    instance(&mut scene, ball, scaled_at(2.0, Vec3::ZERO));
    scene.lights.push(point(Vec3::ZERO, 0.0, Vec3::splat(3.0)));
    let reference = Reference::new(&scene);
    for bounces in [0, 1, 3] {
        let seen = reference.probe(vec3(0.2, 0.1, 0.0), vec3(1.0, 0.3, 0.2), 400, bounces, 3);
        let series: f64 = (0..=bounces).map(|k| rho.powi(k as i32)).sum();
        let expected = rho / PI * 3.0 / 4.0 * series;
        // The facets of the sphere stand off it by up to 0.3 %.
        assert!((seen.mean[0][0] / expected - 1.0).abs() < 0.006, "{bounces}: {seen:?} {expected}");
    }
}

// Closed forms: lights.

#[test]
fn a_point_light_falls_off_with_squared_distance_and_cosine() {
    let mut scene = empty("point");
    floor(&mut scene, vec3(0.8, 0.4, 0.2));
    scene.lights.push(point(vec3(0.0, 2.0, 0.0), 0.0, vec3(5.0, 6.0, 7.0)));
    let seen = look_at_floor(&scene, 1.5, 0.0, 2, 0);
    let (d2, cosine) = (1.5 * 1.5 + 4.0, 2.0 / 2.5);
    let expected = [0.8 * 5.0, 0.4 * 6.0, 0.2 * 7.0].map(|x| x / PI * cosine / d2);
    assert_exact(&seen, expected);
    assert_exact(&look_at_floor(&scene, 1.5, 0.0, 200, 3), expected); // a floor alone: no interreflection

    let screen = add_matte(&mut scene, Vec3::ONE);
    place(&mut scene, quad(vec3(0.2, 1.0, -1.0), Vec3::X, 2.0 * Vec3::Z, screen));
    assert_exact(&look_at_floor(&scene, 1.5, 0.0, 2, 0), [0.0; 3]);
}

/// A sphere of even radiance entirely above the horizon lights like a point in its centre.
#[test]
fn a_sphere_lights_like_its_centre() {
    let mut scene = white_floor("sphere");
    scene.lights.push(point(vec3(0.0, 2.0, 0.0), 1.2, Vec3::splat(5.0)));
    let expected = 5.0 / PI * 0.8 / 6.25;
    assert_near(&look_at_floor(&scene, 1.5, 0.0, 200_000, 0), expected, 0.002);
}

/// Half below the horizon: the irradiance over the radiance is the circle segment θ − sin θ cos θ.
#[test]
fn a_sphere_on_the_horizon_lights_by_its_upper_half() {
    let mut scene = white_floor("half sphere");
    let radius = 0.8f64;
    scene.lights.push(point(Vec3::ZERO, radius as f32, Vec3::splat(5.0)));
    let theta = (radius / 1.5).asin();
    let radiance = 5.0 / (PI * radius * radius);
    let expected = radiance / PI * (theta - theta.sin() * theta.cos());
    assert_near(&look_at_floor(&scene, 1.5, 0.0, 400_000, 0), expected, 0.004);
}

#[test]
fn a_sphere_is_seen_with_its_radiance_from_outside_only_and_blocks() {
    let mut scene = white_floor("seen sphere");
    scene.environment = Environment::Constant(Vec3::ONE);
    scene.lights.push(point(vec3(0.0, 3.0, 0.0), 0.5, Vec3::splat(2.0)));
    let reference = Reference::new(&scene);
    let seen = reference.probe(vec3(3.0, 3.2, 0.0), Vec3::NEG_X, 2, 2, 1);
    assert_exact(&seen, [2.0 / (PI * 0.25); 3]);
    let inside = reference.probe(vec3(0.1, 3.0, 0.0), Vec3::NEG_X, 2, 2, 1);
    assert_exact(&inside, [0.0; 3]);
    let beside = reference.probe(vec3(3.0, 3.51, 0.0), Vec3::NEG_X, 2, 2, 1);
    assert_exact(&beside, [1.0; 3]);
}

/// A black sphere hides π sin²θ of a bright sky from the floor below it, and adds its own light once.
#[test]
fn a_sphere_hides_the_sky_behind_it_and_counts_once() {
    let mut scene = white_floor("sphere and sky");
    scene.environment = Environment::Constant(Vec3::ONE);
    scene.lights.push(point(vec3(0.0, 2.0, 0.0), 1.0, Vec3::splat(3.0)));
    let hidden = 0.25; // sin²θ
    let expected = (1.0 - hidden) + 3.0 / PI / 4.0;
    for bounces in [0, 2] {
        assert_near(&look_at_floor(&scene, 0.0, 0.0, 200_000, bounces), expected, 0.002);
    }
}

#[test]
fn a_sphere_blocks_other_lights_from_inside_too() {
    let mut scene = white_floor("blocking sphere");
    scene.lights.push(point(Vec3::Y * 4.0, 0.0, Vec3::splat(PI as f32)));
    assert_exact(&look_at_floor(&scene, 0.0, 0.0, 2, 0), [1.0 / 16.0; 3]);
    for height in [2.0, 3.8] {
        let mut scene = scene.clone();
        scene.lights.push(point(Vec3::Y * height, 0.5, Vec3::ZERO));
        assert_exact(&look_at_floor(&scene, 0.0, 0.0, 20, 2), [0.0; 3]);
    }
    // Beyond the light it hides nothing.
    scene.lights.push(point(Vec3::Y * 5.0, 0.5, Vec3::ZERO));
    assert_exact(&look_at_floor(&scene, 0.0, 0.0, 20, 2), [1.0 / 16.0; 3]);
}

/// Differential element under the centre of a parallel rectangle: four of those of a
/// rectangle with a corner over the element, a textbook's closed form.
fn rectangle_form_factor(half_x: f64, half_z: f64, height: f64) -> f64 {
    let (x, z) = (half_x / height, half_z / height);
    let side = |x: f64, z: f64| {
        let root = (1.0 + x * x).sqrt();
        x / root * (z / root).atan()
    };
    4.0 * (side(x, z) + side(z, x)) / (2.0 * PI)
}

#[test]
fn an_emissive_quad_lights_by_its_form_factor() {
    let expected = 3.0 * rectangle_form_factor(1.0, 0.5, 1.0);
    for double_sided in [false, true] {
        let mut scene = white_floor("quad");
        lamp_over_origin(&mut scene, 3.0, true, double_sided);
        // From within the lamp's height, so that the look is not through it.
        let look = |emitters, spp| {
            let reference = Reference::new(&scene).with_emitters(emitters);
            reference.probe(vec3(0.3, 0.4, -0.2), vec3(-0.3, -0.4, 0.2), spp, 0, 4)
        };
        assert_near(&look(Emitters::Area, 100_000), expected, 0.003);
        assert_near(&look(Emitters::BounceHits, 300_000), expected, 0.004);
    }
}

#[test]
fn the_back_of_a_one_sided_lamp_is_dark() {
    for emitters in [Emitters::Area, Emitters::BounceHits] {
        let mut scene = white_floor("back");
        lamp_over_origin(&mut scene, 3.0, false, false);
        let reference = Reference::new(&scene).with_emitters(emitters);
        let up = vec3(0.3, 0.4, -0.2);
        assert_exact(&reference.probe(up, -up, 1_000, 2, 1), [0.0; 3]);
        assert_exact(&reference.probe(up, Vec3::Y, 2, 2, 1), [0.0; 3]);
        assert_exact(&reference.probe(up + 2.0 * Vec3::Y, -Vec3::Y, 2, 0, 1), [3.0; 3]);
    }
}

/// Two lamps of different colour and size: both are found in proportion.
#[test]
fn lamps_add_up() {
    let mut scene = white_floor("two lamps");
    lamp_over_origin(&mut scene, 3.0, true, false);
    let dim = add_material(&mut scene, Material { emissive: vec3(0.2, 0.2, 0.2), ..matte() });
    // Below the first one and smaller: it hides the middle of it.
    place(&mut scene, quad(vec3(-0.25, 0.5, -0.25), 0.5 * Vec3::X, 0.5 * Vec3::Z, dim));
    let whole = rectangle_form_factor(1.0, 0.5, 1.0);
    let hidden = rectangle_form_factor(0.25, 0.25, 0.5);
    let expected = 3.0 * (whole - hidden) + 0.2 * hidden;
    // From the side, under both, so that the look does not pass through the lower lamp.
    let seen = Reference::new(&scene).probe(vec3(0.4, 0.2, 0.0), vec3(-0.4, -0.2, 0.0), 400_000, 0, 5);
    assert_near(&seen, expected, 0.003);
}

#[test]
fn a_spot_has_gltf_falloff() {
    let (inner, outer) = (20f32.to_radians().cos(), 40f32.to_radians().cos());
    let falloff = |degrees: f64| {
        let cosine = degrees.to_radians().cos();
        let (inner, outer) = (f64::from(inner), f64::from(outer));
        ((cosine - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2)
    };
    for (radius, spp) in [(0.0, 2), (0.05, 20_000)] {
        let mut scene = white_floor("spot");
        let direction = Vec3::NEG_Y;
        let position = vec3(0.0, 1.0, 0.0);
        let kind = LightKind::Spot { position, radius, direction, cos_inner: inner, cos_outer: outer };
        scene.lights.push(Light { kind, strength: Vec3::splat(PI as f32) });
        for degrees in [0.0f64, 15.0, 25.0, 33.0, 39.0, 45.0] {
            let x = degrees.to_radians().tan();
            // cos θ / d² with d = 1 / cos θ.
            let expected = falloff(degrees) * degrees.to_radians().cos().powi(3);
            let seen = look_at_floor(&scene, x as f32, 0.0, spp, 0);
            if radius > 0.0 && expected > 0.0 {
                assert_near(&seen, expected, 0.01);
            } else {
                assert_exact(&seen, [expected; 3]);
            }
        }
    }
}

#[test]
fn a_spherical_spot_seen_is_scaled_by_its_cone() {
    let mut scene = empty("seen spot");
    let kind =
        LightKind::Spot { position: Vec3::ZERO, radius: 0.5, direction: Vec3::X, cos_inner: 0.9, cos_outer: 0.5 };
    scene.lights.push(Light { kind, strength: Vec3::splat(2.0) });
    let reference = Reference::new(&scene);
    let away = vec3(0.7, (1.0f32 - 0.49).sqrt(), 0.0);
    let expected = 2.0 / (PI * 0.25) * 0.25; // t = (0.7 − 0.5) / 0.4
    let aside = vec3(0.1, 0.0, 0.1); // anywhere on the sphere: the cone is that of its centre
    for aside in [Vec3::ZERO, aside] {
        assert_exact(&reference.probe(away * 3.0, aside - away * 3.0, 2, 0, 1), [expected; 3]);
    }
    assert_exact(&reference.probe(vec3(-3.0, 0.0, 0.0), Vec3::X, 2, 0, 1), [0.0; 3]);
}

#[test]
fn a_directional_light_has_its_irradiance_with_and_without_a_disc() {
    let direction = vec3(0.6, -0.8, 0.0);
    for (angle_rad, spp) in [(0.0, 2), (0.004_65, 1_000), (0.5, 100_000)] {
        let mut scene = white_floor("sun");
        let kind = LightKind::Directional { direction, angle_rad };
        scene.lights.push(Light { kind, strength: Vec3::splat(2.0) });
        let expected = 2.0 * 0.8 / PI;
        let seen = look_at_floor(&scene, 0.0, 0.0, spp, 2);
        if angle_rad == 0.0 {
            assert_exact(&seen, [expected; 3]);
        } else {
            assert_near(&seen, expected, 0.002);
        }
        // Its disc is not in the sky.
        let seen = Reference::new(&scene).probe(Vec3::Y, -direction, 2, 2, 1);
        assert_exact(&seen, [0.0; 3]);
    }
}

// Surfaces.

#[test]
fn a_shading_normal_turns_the_cosine_on_both_sides_and_never_lets_light_through() {
    let mut scene = empty("tilted");
    let white = add_matte(&mut scene, Vec3::ONE);
    let mut mesh = quad(vec3(-1.0, 0.0, -1.0), 2.0 * Vec3::Z, 2.0 * Vec3::X, white);
    let normal = vec3(0.6, 0.8, 0.0);
    mesh.normals = vec![normal; 4];
    place(&mut scene, mesh);
    let sun = |scene: &Scene, direction: Vec3, from: Vec3| {
        let mut scene = scene.clone();
        let kind = LightKind::Directional { direction, angle_rad: 0.0 };
        scene.lights.push(Light { kind, strength: Vec3::splat(PI as f32) });
        Reference::new(&scene).probe(from, -from, 2, 0, 1)
    };
    assert_exact(&sun(&scene, Vec3::NEG_Y, Vec3::Y), [0.8; 3]);
    assert_exact(&sun(&scene, Vec3::Y, Vec3::NEG_Y), [0.8; 3]);
    assert_exact(&sun(&scene, -normal, Vec3::Y), [1.0; 3]);
    assert_exact(&sun(&scene, Vec3::NEG_Y, Vec3::NEG_Y), [0.0; 3]);
    // Above the shading normal's horizon, but below the surface.
    assert_exact(&sun(&scene, vec3(-0.96, 0.28, 0.0), Vec3::Y), [0.0; 3]);
    // The shading normal faces away from this viewer: the geometric one counts.
    assert_exact(&sun(&scene, Vec3::NEG_Y, vec3(-0.96, 0.28, 0.0)), [1.0; 3]);
}

#[test]
fn bounces_that_leave_below_the_surface_are_lost() {
    let mut scene = empty("tilted furnace");
    let white = add_matte(&mut scene, Vec3::ONE);
    let mut mesh = quad(vec3(-1.0, 0.0, -1.0), 2.0 * Vec3::Z, 2.0 * Vec3::X, white);
    mesh.normals = vec![vec3(0.6, 0.8, 0.0); 4];
    place(&mut scene, mesh);
    scene.environment = Environment::Constant(Vec3::ONE);
    let seen = Reference::new(&scene).probe(Vec3::Y, Vec3::NEG_Y, 200_000, 0, 6);
    // Of the cosine lobe around ns, (1 + cos) / 2 lies above a plane tilted by that angle.
    assert_near(&seen, 0.9, 0.002);
}

#[test]
fn a_mirrored_instance_keeps_its_front_and_its_normals() {
    let mut scene = empty("mirror");
    let lamp = Material { emissive: Vec3::ONE, base_color: vec4(0.0, 0.0, 0.0, 1.0), ..matte() };
    let lamp = add_material(&mut scene, lamp);
    let mut mesh = quad(vec3(1.0, -1.0, -1.0), 2.0 * Vec3::Y, 2.0 * Vec3::Z, lamp); // faces +x
    mesh.normals = vec![Vec3::X; 4];
    let mesh = add_mesh(&mut scene, mesh);
    let seen_from = |scale: Vec3, x: f32| {
        let mut scene = scene.clone();
        instance(&mut scene, mesh, Affine3A::from_scale(scale));
        Reference::new(&scene).probe(vec3(x, 0.1, 0.3), vec3(-x, 0.0, 0.0), 2, 0, 1)
    };
    assert_exact(&seen_from(Vec3::ONE, 3.0), [1.0; 3]);
    assert_exact(&seen_from(Vec3::ONE, -3.0), [0.0; 3]);
    // Mirrored in x it stands at −1 and faces −x; in y, in place and still facing +x.
    assert_exact(&seen_from(vec3(-1.0, 1.0, 1.0), -3.0), [1.0; 3]);
    assert_exact(&seen_from(vec3(-1.0, 1.0, 1.0), 3.0), [0.0; 3]);
    assert_exact(&seen_from(vec3(1.0, -2.0, 1.0), 3.0), [1.0; 3]);
    assert_exact(&seen_from(vec3(1.0, -2.0, 1.0), -3.0), [0.0; 3]);
}

/// Normals go by the inverse transpose: a sphere stretched to an ellipsoid has the gradient as its normal.
#[test]
fn stretched_and_mirrored_smooth_normals_stand_on_the_surface() {
    for mirror in [1.0f32, -1.0] {
        let mut scene = empty("ellipsoid");
        let white = add_matte(&mut scene, Vec3::ONE);
        let ball = add_mesh(&mut scene, icosphere(5, true, white));
        let stretch = vec3(mirror * 3.0, 1.0, 1.0);
        instance(&mut scene, ball, Affine3A::from_scale(stretch));
        let kind = LightKind::Directional { direction: Vec3::NEG_Y, angle_rad: 0.0 };
        scene.lights.push(Light { kind, strength: Vec3::splat(PI as f32) });
        let x = 1.5f32;
        let seen = Reference::new(&scene).probe(vec3(x, 5.0, 0.0), Vec3::NEG_Y, 2, 0, 1);
        let height = (1.0f64 - 0.25).sqrt();
        let normal = DVec3::new(1.5 / 9.0, height, 0.0).normalize();
        assert!((seen.mean[0][0] - normal.y).abs() < 1e-3, "{seen:?} {normal}");
    }
}

// Textures and alpha.

fn checker_scene(wrap_u: Wrap, wrap_v: Wrap, linear: bool) -> Scene {
    let mut scene = empty("texture");
    let mut image = Image::filled(Extent::new(2, 2), [0u8; 4]);
    image.pixels = vec![[255, 0, 0, 255], [0, 128, 0, 0], [0, 0, 255, 51], [255, 255, 255, 102]];
    let image = add_image(&mut scene, image);
    scene.textures.push(Texture { image, wrap_u, wrap_v, linear });
    scene
}

/// The only texture, through a coordinate set as it is.
const fn texture_ref(uv_set: usize) -> TextureRef {
    TextureRef { texture: 0, uv_set, uv_from_uv: Affine2::IDENTITY }
}

/// sRGB code 128, decoded.
const MIDDLE: f64 = 0.215_860_500_113_899_26;

#[test]
fn texels_are_decoded_before_they_are_filtered() {
    let scene = checker_scene(Wrap::Repeat, Wrap::Repeat, true);
    let at = |u, v| {
        let reference = texture_ref(0);
        texture::color(&scene, reference, DVec2::new(u, v)).to_array()
    };
    let close = |a: [f64; 4], b: [f64; 4]| {
        assert!(a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-12), "{a:?} is not {b:?}");
    };
    close(at(0.25, 0.25), [1.0, 0.0, 0.0, 1.0]);
    close(at(0.75, 0.25), [0.0, MIDDLE, 0.0, 0.0]);
    close(at(0.25, 0.75), [0.0, 0.0, 1.0, 0.2]);
    close(at(0.5, 0.25), [0.5, MIDDLE / 2.0, 0.0, 0.5]);
    close(at(0.5, 0.5), [0.5, (MIDDLE + 1.0) / 4.0, 0.5, 0.4]);
    close(at(0.0, 0.25), [0.5, MIDDLE / 2.0, 0.0, 0.5]); // across the seam
    close(at(0.35, 0.25), [0.8, 0.2 * MIDDLE, 0.0, 0.8]);
    close(at(-2.65, 7.25), at(0.35, 0.25));
}

#[test]
fn coordinates_are_transformed_before_the_lookup() {
    let scene = checker_scene(Wrap::Repeat, Wrap::Repeat, true);
    let turned = Affine2::from_scale_angle_translation(vec2(2.0, 0.5), 0.3, vec2(0.1, -0.2));
    let look = |reference, uv: Vec2| texture::color(&scene, reference, uv.as_dvec2());
    let uv = vec2(0.3, 0.8);
    let expected = look(texture_ref(0), turned.transform_point2(uv));
    let found = look(TextureRef { uv_from_uv: turned, ..texture_ref(0) }, uv);
    assert!((found - expected).abs().max_element() < 1e-6, "{found} is not {expected}");
}

#[test]
fn wrap_modes_repeat_mirror_and_clamp() {
    let row = |mode, n| (-4..8).map(|i| texture::wrap(f64::from(i), n, mode)).collect::<Vec<_>>();
    assert_eq!(row(Wrap::Repeat, 3), [2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1]);
    assert_eq!(row(Wrap::MirroredRepeat, 3), [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1]);
    assert_eq!(row(Wrap::ClampToEdge, 3), [0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2, 2]);

    let look = |wrap_u, wrap_v, u: f64, v: f64| {
        let scene = checker_scene(wrap_u, wrap_v, false);
        texture::color(&scene, texture_ref(0), DVec2::new(u, v)).w
    };
    use Wrap::{ClampToEdge, MirroredRepeat, Repeat};
    assert_eq!(look(Repeat, ClampToEdge, 1.1, 1.6), 0.2);
    assert_eq!(look(MirroredRepeat, ClampToEdge, 1.1, 1.6), 0.4);
    assert_eq!(look(ClampToEdge, Repeat, 1.1, 1.1), 0.0);
    assert_eq!(look(ClampToEdge, MirroredRepeat, -0.1, 1.1), 0.2);
}

/// A quad in the plane z = 0, 1 × 1 from the origin, textured with v down, before a sky of 1.
fn textured_quad(material: Material, colors: Vec<glam::Vec4>, linear: bool) -> Scene {
    let mut scene = checker_scene(Wrap::ClampToEdge, Wrap::ClampToEdge, linear);
    let material = add_material(&mut scene, material);
    let mut mesh = quad(Vec3::ZERO, Vec3::X, Vec3::Y, material);
    mesh.uvs[1] = vec![vec2(0.0, 1.0), Vec2::ONE, vec2(1.0, 0.0), Vec2::ZERO];
    mesh.colors = colors;
    place(&mut scene, mesh);
    scene.environment = Environment::Constant(Vec3::ONE);
    scene
}

fn through(scene: &Scene, x: f32, y: f32, spp: u32) -> Estimate {
    Reference::new(scene).probe(vec3(x, y, 2.0), Vec3::NEG_Z, spp, 0, 7)
}

const SECOND_SET: Option<TextureRef> = Some(texture_ref(1));

#[test]
fn a_textured_surface_multiplies_factor_vertex_colour_and_texel() {
    let material = Material {
        base_color: vec4(0.5, 0.5, 0.5, 1.0),
        base_color_texture: SECOND_SET,
        emissive: vec3(2.0, 4.0, 8.0),
        emissive_texture: SECOND_SET,
        ..matte()
    };
    let scene = textured_quad(material, vec![vec4(0.5, 0.25, 1.0, 1.0); 4], false);
    // Under a white sky: albedo + emission.
    assert_exact(&through(&scene, 0.2, 0.8, 20), [0.25 + 2.0, 0.0, 0.0]);
    assert_exact(&through(&scene, 0.8, 0.8, 20), [0.0, (0.125 + 4.0) * MIDDLE, 0.0]);
    assert_exact(&through(&scene, 0.2, 0.2, 20), [0.0, 0.0, 0.5 + 8.0]);
}

#[test]
fn a_mask_is_there_at_its_cutoff_and_above() {
    let material = |cutoff| Material {
        base_color: vec4(0.0, 0.0, 0.0, 0.5),
        base_color_texture: SECOND_SET,
        alpha_mode: AlphaMode::Mask { cutoff },
        ..matte()
    };
    let covered = |cutoff: f32, x: f32, y: f32| {
        let scene = textured_quad(material(cutoff), vec![vec4(1.0, 1.0, 1.0, 0.5); 4], false);
        through(&scene, x, y, 2).mean[0] == [0.0; 3]
    };
    // Alpha is 0.25 × 1, 0, 0.2, 0.4.
    assert!(covered(0.25, 0.2, 0.8));
    assert!(!covered(0.2501, 0.2, 0.8));
    assert!(covered(0.0, 0.8, 0.8));
    assert!(!covered(0.06, 0.2, 0.2));
    assert!(covered(0.06, 0.8, 0.2));
}

#[test]
fn blending_is_there_with_probability_alpha_for_camera_and_shadow_rays() {
    let veil = Material {
        base_color: vec4(0.0, 0.0, 0.0, 0.5),
        emissive: Vec3::splat(3.0),
        alpha_mode: AlphaMode::Blend,
        ..matte()
    };
    let scene = textured_quad(veil.clone(), vec![vec4(1.0, 1.0, 1.0, 0.6); 4], false);
    assert_near(&through(&scene, 0.3, 0.4, 100_000), 0.3 * 3.0 + 0.7, 0.004);

    let mut scene = white_floor("veiled");
    let veil = add_material(&mut scene, Material { emissive: Vec3::ZERO, ..veil });
    for height in [0.5, 0.7] {
        place(&mut scene, quad(vec3(-0.05, height, -0.05), 0.1 * Vec3::X, 0.1 * Vec3::Z, veil));
    }
    scene.lights.push(point(Vec3::Y, 0.0, Vec3::splat(PI as f32)));
    assert_exact(&look_at_floor(&scene, 0.001, 0.002, 2, 0), {
        let d2: f64 = 1.0 + 5e-6;
        [0.25 / d2.powf(1.5); 3]
    });
}

/// Emission of a half-open lamp: explicit samples must weigh by coverage what bounces find by chance.
#[test]
fn masked_and_blended_lamps_light_the_same_by_either_estimator() {
    for alpha_mode in [AlphaMode::Mask { cutoff: 0.3 }, AlphaMode::Blend] {
        let mut scene = checker_scene(Wrap::Repeat, Wrap::Repeat, true);
        floor(&mut scene, Vec3::ONE);
        let texture = Some(texture_ref(0));
        let lamp = Material {
            emissive: Vec3::ONE,
            base_color_texture: texture,
            emissive_texture: texture,
            alpha_mode,
            ..matte()
        };
        let lamp = add_material(&mut scene, lamp);
        let mut mesh = quad(vec3(-1.0, 1.0, -1.0), 2.0 * Vec3::X, 2.0 * Vec3::Z, lamp);
        mesh.uvs[0] = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        place(&mut scene, mesh);
        let look = |emitters| {
            let reference = Reference::new(&scene).with_emitters(emitters);
            reference.probe(vec3(0.5, 0.3, 0.1), vec3(-0.5, -0.3, 0.0), 500_000, 1, 8)
        };
        let (area, hits) = (look(Emitters::Area), look(Emitters::BounceHits));
        assert_agrees("lamp", &area, &hits, 0.03);
    }
}

// Environment and camera.

#[test]
fn the_environment_runs_right_towards_positive_x_from_negative_z() {
    let mut image = Image::filled(Extent::new(4, 2), [0.0f32; 3]);
    for (i, texel) in image.pixels.iter_mut().enumerate() {
        *texel = [i as f32 % 4.0, (i / 4) as f32, 1.0];
    }
    let sky = |rotation_deg| Environment::Map { image: image.clone(), rotation_deg };
    let at = |rotation: f32, azimuth_deg: f64, y: f64| {
        let a = azimuth_deg.to_radians();
        let d = DVec3::new(a.sin(), y, -a.cos()).normalize();
        texture::environment(&sky(rotation), d).to_array()
    };
    let close = |a: [f64; 3], b: [f64; 3]| {
        assert!(a.iter().zip(b).all(|(x, y)| (x - y).abs() < 1e-9), "{a:?} is not {b:?}");
    };
    close(at(0.0, 0.0, 0.0), [1.5, 0.5, 1.0]); // the image's centre, between texels
    close(at(0.0, 45.0, 0.0), [2.0, 0.5, 1.0]);
    close(at(0.0, 90.0, 0.0), [2.5, 0.5, 1.0]);
    close(at(0.0, 180.0, 0.0), [1.5, 0.5, 1.0]); // 3 and 0 across the seam
    close(at(90.0, -45.0, 0.0), [2.0, 0.5, 1.0]);
    close(at(0.0, 45.0, 1.0), [2.0, 0.0, 1.0]); // 45° up is the upper row's centre
    close(at(0.0, 45.0, 5.0), [2.0, 0.0, 1.0]); // clamped above it
    close(at(0.0, 45.0, -5.0), [2.0, 1.0, 1.0]);
}

/// A sky of radiance 2 above and 0 below, seen by a floor and by a wall.
#[test]
fn a_half_sky_lights_a_floor_wholly_and_a_wall_by_half() {
    let mut image = Image::filled(Extent::new(4, 512), [0.0f32; 3]);
    image.pixels[..4 * 256].fill([2.0; 3]);
    let environment = Environment::Map { image, rotation_deg: 0.0 };
    let mut scene = white_floor("half sky");
    scene.environment = environment.clone();
    assert_near(&look_at_floor(&scene, 0.0, 0.0, 100_000, 0), 2.0, 0.001);
    let mut scene = empty("half sky");
    let white = add_matte(&mut scene, Vec3::ONE);
    place(&mut scene, quad(vec3(-1.0, -1.0, 0.0), 2.0 * Vec3::X, 2.0 * Vec3::Y, white));
    scene.environment = environment;
    let seen = Reference::new(&scene).probe(Vec3::Z, Vec3::NEG_Z, 200_000, 0, 9);
    assert_near(&seen, 1.0, 0.003);
}

#[test]
fn pixels_run_right_and_down_and_are_box_filtered() {
    let mut scene = empty("camera");
    let extent = Extent::new(8, 4);
    let camera = Pinhole::looking_at(Vec3::ZERO, Vec3::X, Vec3::Z, 90.0);
    // The image plane at distance 1 is 2 high and 4 wide; right is −y, up is +z.
    assert_eq!(camera.right, Vec3::NEG_Y);
    let lamp = add_material(&mut scene, Material { emissive: Vec3::ONE, double_sided: true, ..matte() });
    // Covers x 5 to 6.5 of the image and y 0 to 1.
    let corner = vec3(1.0, 2.0 - 6.5 / 2.0, 0.5);
    place(&mut scene, quad(corner, 0.75 * Vec3::Y, 0.5 * Vec3::Z, lamp));
    let seen = Reference::new(&scene).render(&camera, extent, 4_000, 0, 1);
    for y in 0..4 {
        for x in 0..8 {
            let expected = match (x, y) {
                (5, 0) => 1.0,
                (6, 0) => 0.5,
                _ => 0.0,
            };
            let i = y * 8 + x;
            let sigma = seen.variance_of_mean[i][0].sqrt();
            assert!((seen.mean[i][0] - expected).abs() <= 4.5 * sigma + 1e-9, "{x}, {y}: {seen:?}");
        }
    }
}

#[test]
fn a_render_depends_on_its_seed_alone() {
    let (scene, camera) = box_area_light();
    let reference = Reference::new(&scene);
    let render = |seed| reference.render(&camera, Extent::new(12, 9), 4, 2, seed).mean;
    assert_eq!(render(1), render(1));
    assert_ne!(render(1), render(2));
}

// Rays.

/// Rays from inside a closed mesh at its vertices and edges: none escapes. Also far from the origin and small.
#[test]
fn no_ray_leaks_through_shared_edges() {
    for (size, offset) in [(1.0f64, 0.0f64), (1e-3, 1e2), (1e6, 0.0)] {
        let mesh = icosphere(2, false, 0);
        let at = |p: Vec3| p.as_dvec3() * size + DVec3::new(offset, -offset, offset * 0.5);
        let triangles: Vec<Triangle> = mesh
            .triangles
            .iter()
            .enumerate()
            .map(|(index, t)| Triangle { vertices: t.map(|i| at(mesh.positions[i as usize])), instance: 0, index })
            .collect();
        let geometry = Geometry::new(triangles.clone());
        let origin = at(vec3(0.1, -0.2, 0.05));
        let mut rng = Rng::new(1, 2);
        for _ in 0..20 {
            for triangle in &triangles {
                let [a, b, _] = triangle.vertices;
                let target = match rng.uniform() {
                    x if x < 0.2 => a,
                    x => a.lerp(b, x),
                };
                let ray = Ray { origin, direction: (target - origin).normalize() };
                let hit = geometry.closest(&ray, f64::INFINITY, None, |_, _| true);
                let distance = (target - origin).length();
                let t = hit.expect("a ray leaked").t;
                assert!((t / distance - 1.0).abs() < 1e-9, "{t} {distance}");
                assert_eq!(geometry.transmittance(&ray, distance * 2.0, [None; 2], |_, _| 1.0), 0.0);
                assert_eq!(geometry.transmittance(&ray, distance * 0.99, [None; 2], |_, _| 1.0), 1.0);
            }
        }
    }
}

/// A ray that starts just off a wall, as in a corner, still meets it.
#[test]
fn walls_nearer_than_the_hierarchy_can_tell_are_hit() {
    let corners = [DVec3::ZERO, DVec3::Y * 10.0, DVec3::Z * 10.0];
    let wall = |x: f64, index: usize| Triangle { vertices: corners.map(|c| c + DVec3::X * x), instance: 0, index };
    // A dense pile up to x = 5, so that its inner nodes have a fine grid, in a scene ten wide.
    let mut places: Vec<f64> = (0..400).map(|i| 5.0 - 1e-3 * f64::from(i)).collect();
    places.extend([0.0, 10.0]);
    let walls = places.iter().enumerate().map(|(i, &x)| wall(x, i));
    let geometry = Geometry::new(walls.collect());
    for distance in [5e-4, 1e-4, 1e-5, 1e-6, 1e-8] {
        let origin = DVec3::new(5.0 - distance, 1.0, 1.0);
        let direction = DVec3::new(1.0, 0.3, 0.2).normalize();
        let expected = distance / direction.x;
        let hit = geometry.closest(&Ray { origin, direction }, f64::INFINITY, None, |_, _| true);
        let t = hit.expect("a hit").t;
        assert!((t - expected).abs() < 1e-12, "{t} {expected}");
    }
}

/// The hierarchy against all triangles one by one.
#[test]
fn the_hierarchy_finds_what_brute_force_finds() {
    let mut rng = Rng::new(3, 4);
    let mut vector = || DVec3::new(rng.uniform(), rng.uniform(), rng.uniform()) * 2.0 - 1.0;
    let triangles: Vec<Triangle> = (0..400)
        .map(|index| {
            let centre = vector() * 5.0;
            let vertices = [centre + vector(), centre + vector(), centre + vector()];
            Triangle { vertices, instance: 0, index }
        })
        .collect();
    let geometry = Geometry::new(triangles.clone());
    let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
    for i in 0..4_000 {
        let direction = if i % 4 == 0 { axes[i / 4 % 6] } else { vector().normalize() };
        // From inside, and from far outside.
        let origin = vector() * 4.0 - direction * if i % 3 == 0 { 1e4 } else { 0.0 };
        let ray = Ray { origin, direction };
        let found = geometry.closest(&ray, f64::INFINITY, None, |_, _| true).map(|h| h.t);
        let expected = triangles
            .iter()
            .filter_map(|t| reference::intersect::intersect_triangle(&ray, &t.vertices))
            .map(|(t, _)| t)
            .filter(|&t| t > 1e-9)
            .min_by(f64::total_cmp);
        assert_eq!(found, expected);
    }
}

/// Means of cos θ: 2/3 for the cosine lobe, (1 + cos θ₀) / 2 for a cone.
#[test]
fn directions_have_their_densities() {
    let mut rng = Rng::new(5, 6);
    for axis in [DVec3::Y, DVec3::new(0.6, 0.0, -0.8), DVec3::new(-1.0, 2.0, 2.0) / 3.0] {
        let n = 100_000;
        let (mut lobe, mut cone, mut sum) = (0.0, 0.0, DVec3::ZERO);
        for _ in 0..n {
            lobe += cosine_direction(axis, &mut rng).dot(axis) / f64::from(n);
            let direction = cone_direction(axis, 0.4, &mut rng);
            cone += direction.dot(axis) / f64::from(n);
            sum += direction / f64::from(n);
        }
        assert!((lobe - 2.0 / 3.0).abs() < 0.004, "{lobe}");
        assert!((cone - 0.8).abs() < 0.002, "{cone}");
        assert!((sum - axis * 0.8).length() < 0.01, "{sum}");
    }
}

// The z-test, and whole scenes by it.

/// K renders of independent noise around `mean`, standard deviation 0.3.
fn noise(extent: Extent, renders: u64, mean: f32, seed: u64) -> Vec<RgbImage> {
    (0..renders)
        .map(|k| {
            let mut rng = Rng::new(seed, k);
            let mut image = Image::filled(extent, [0.0; 3]);
            for x in image.pixels.as_flattened_mut() {
                let (u, v) = (1.0 - rng.uniform(), rng.uniform());
                let normal = (-2.0 * u.ln()).sqrt() * (2.0 * PI * v).cos();
                *x = mean + 0.3 * normal as f32;
            }
            image
        })
        .collect()
}

#[test]
fn equal_means_pass_and_have_the_documented_z() {
    let extent = Extent::new(100, 76);
    let (mut squares, mut tails) = (0.0, 0.0);
    for seed in 0..20 {
        let a = mean_and_variance(&noise(extent, 8, 1.0, 2 * seed));
        let b = mean_and_variance(&noise(extent, 8, 1.0, 2 * seed + 1));
        let report = assert_agrees("noise", &a, &b, 0.015);
        squares += report.block_mean_square() / 20.0;
        tails += report.blocks_beyond_3() / 20.0;
        // t-like with 14 degrees of freedom: 1 % beyond 3.
        assert!((0.005..0.015).contains(&report.pixels_beyond_3), "{report}");
    }
    assert!((squares - 1.0).abs() < 0.05, "{squares}");
    assert!(tails < 0.006, "{tails}");
}

#[test]
fn a_bias_of_the_resolution_and_a_local_one_are_found() {
    let extent = Extent::new(96, 72);
    let a = mean_and_variance(&noise(extent, 12, 1.0, 1));
    let brighter = mean_and_variance(&noise(extent, 12, 1.01, 2));
    let against = verdict(&compare(&a, &brighter), 0.01);
    assert!(against.len() == 1 && against[0].contains("image mean"), "{against:?}");

    let mut spoilt = noise(extent, 12, 1.0, 3);
    for image in &mut spoilt {
        for y in 24..32 {
            for x in 40..48 {
                image.pixels[y * 96 + x][1] += 0.15;
            }
        }
    }
    let against = verdict(&compare(&a, &mean_and_variance(&spoilt)), 0.01);
    assert!(against.iter().any(|line| line.contains("max |z|")), "{against:?}");
}

#[test]
fn noise_that_hides_everything_and_values_that_are_not_finite_do_not_pass() {
    let extent = Extent::new(32, 32);
    let a = mean_and_variance(&noise(extent, 4, 1.0, 1));
    let mut b = mean_and_variance(&noise(extent, 4, 1.0, 2));
    assert!(verdict(&compare(&a, &b), 0.05).is_empty());
    assert!(verdict(&compare(&a, &b), 0.005).iter().any(|line| line.contains("noisy")));
    b.mean[100][2] = f64::NAN;
    assert!(verdict(&compare(&a, &b), 0.05).len() > 1);
}

/// Images without noise may differ by f32 rounding, and by no more.
#[test]
fn exact_images_agree_to_rounding() {
    let flat = |value: f64| {
        let mut moments = Moments::default();
        moments.add([value; 3]);
        moments.add([value; 3]);
        Estimate::from_moments(Extent::new(16, 16), &[moments; 256])
    };
    assert!(verdict(&compare(&flat(0.5), &flat(0.5 * (1.0 + 1e-6))), 0.005).is_empty());
    assert!(verdict(&compare(&flat(0.0), &flat(0.0)), 0.005).is_empty());
    assert!(!verdict(&compare(&flat(0.5), &flat(0.5005)), 0.005).is_empty());
}

#[test]
fn every_scene_agrees_with_itself_under_another_seed() {
    for (name, scene, camera) in all() {
        let reference = Reference::new(&scene);
        let extent = Extent::new(48, 36);
        let [a, b] = [1, 2].map(|seed| reference.render(&camera, extent, 128, 2, seed));
        let report = assert_agrees(name, &a, &b, 0.03);
        println!("{name}\n{report}");
        assert!(report.block_mean_square() > 0.5, "{name}: variances are too large\n{report}");
    }
}

#[test]
fn explicit_samples_and_bounce_hits_of_emissive_triangles_agree() {
    for (name, scene, camera) in all() {
        if !["box_area_light", "textured_masked_blend", "instanced_mirrored"].contains(&name) {
            continue;
        }
        let extent = Extent::new(40, 32);
        let [a, b] = [(Emitters::Area, 128), (Emitters::BounceHits, 512)]
            .map(|(emitters, spp)| Reference::new(&scene).with_emitters(emitters).render(&camera, extent, spp, 2, 3));
        let report = assert_agrees(name, &a, &b, 0.04);
        println!("{name}\n{report}");
    }
}
