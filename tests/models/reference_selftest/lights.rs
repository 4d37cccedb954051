//! Closed forms: lights.

use std::f64::consts::PI;

use diptych::scene::{Environment, Light, LightKind, Material, Scene};
use glam::{Vec3, vec3, vec4};

use super::{floor, look_at_floor, point, white_floor};
use crate::reference::asserts::{assert_exact, assert_near};
use crate::reference::scenes::{add_material, add_quad, colored, empty, matte, place, quad};
use crate::reference::{Emitters, Reference};

/// A one-sided lamp of radiance `emissive` that faces down (or up), 2 × 1 at height 1 over (0, 0, 0).
fn lamp_over_origin(scene: &mut Scene, emissive: f32, down: bool, double_sided: bool) {
    let lamp = Material { emissive: Vec3::splat(emissive), double_sided, ..matte() };
    let material = add_material(scene, Material { base_color: vec4(0.0, 0.0, 0.0, 1.0), ..lamp });
    let (u, v) = (2.0 * Vec3::X, Vec3::Z);
    let (u, v) = if down { (u, v) } else { (v, u) };
    place(scene, quad(vec3(-1.0, 1.0, -0.5), u, v, material));
}

#[test]
fn point_light_follows_inverse_square_and_cosine() {
    let mut scene = empty("point");
    floor(&mut scene, vec3(0.8, 0.4, 0.2));
    scene.lights.push(point(vec3(0.0, 2.0, 0.0), 0.0, vec3(5.0, 6.0, 7.0)));
    let seen = look_at_floor(&scene, 1.5, 0.0, 2, 0);
    let (d2, cosine) = (1.5 * 1.5 + 4.0, 2.0 / 2.5);
    let expected = [0.8 * 5.0, 0.4 * 6.0, 0.2 * 7.0].map(|x| x / PI * cosine / d2);
    assert_exact(&seen, expected);
    assert_exact(&look_at_floor(&scene, 1.5, 0.0, 200, 3), expected); // a floor alone: no interreflection

    add_quad(&mut scene, (vec3(0.2, 1.0, -1.0), Vec3::X, 2.0 * Vec3::Z), colored(Vec3::ONE));
    assert_exact(&look_at_floor(&scene, 1.5, 0.0, 2, 0), [0.0; 3]);
}

/// A uniform spherical light entirely above the horizon lights like a point in its centre.
#[test]
fn spherical_light_equals_a_point_in_its_centre() {
    let mut scene = white_floor("sphere");
    scene.lights.push(point(vec3(0.0, 2.0, 0.0), 1.2, Vec3::splat(5.0)));
    let expected = 5.0 / PI * 0.8 / 6.25;
    assert_near(&look_at_floor(&scene, 1.5, 0.0, 200_000, 0), expected, 0.002);
}

/// With half of the sphere below the horizon, irradiance over radiance is the circle segment θ − sin θ cos θ.
#[test]
fn sphere_at_the_horizon_lights_by_its_upper_half() {
    let mut scene = white_floor("half sphere");
    let radius = 0.8f64;
    scene.lights.push(point(Vec3::ZERO, radius as f32, Vec3::splat(5.0)));
    let theta = (radius / 1.5).asin();
    let radiance = 5.0 / (PI * radius * radius);
    let expected = radiance / PI * (theta - theta.sin() * theta.cos());
    assert_near(&look_at_floor(&scene, 1.5, 0.0, 400_000, 0), expected, 0.004);
}

#[test]
fn spherical_light_is_visible_only_from_outside() {
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
fn spherical_light_hides_the_sky_and_counts_once() {
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
fn spherical_light_blocks_lights_behind_and_inside() {
    let mut scene = white_floor("blocking sphere");
    scene.lights.push(point(Vec3::Y * 4.0, 0.0, Vec3::splat(PI as f32)));
    assert_exact(&look_at_floor(&scene, 0.0, 0.0, 2, 0), [1.0 / 16.0; 3]);
    for height in [2.0, 3.8] {
        let mut scene = scene.clone();
        scene.lights.push(point(Vec3::Y * height, 0.5, Vec3::ZERO));
        assert_exact(&look_at_floor(&scene, 0.0, 0.0, 20, 2), [0.0; 3]);
    }
    // A sphere beyond the light occludes nothing.
    scene.lights.push(point(Vec3::Y * 5.0, 0.5, Vec3::ZERO));
    assert_exact(&look_at_floor(&scene, 0.0, 0.0, 20, 2), [1.0 / 16.0; 3]);
}

/// Returns the form factor of a parallel rectangle from a differential element below its centre. It is four times the
/// textbook's closed form for a rectangle with a corner above the element.
fn rectangle_form_factor(half_x: f64, half_z: f64, height: f64) -> f64 {
    let (x, z) = (half_x / height, half_z / height);
    let side = |x: f64, z: f64| {
        let root = (1.0 + x * x).sqrt();
        x / root * (z / root).atan()
    };
    4.0 * (side(x, z) + side(z, x)) / (2.0 * PI)
}

#[test]
fn emissive_quad_lights_by_its_form_factor() {
    let expected = 3.0 * rectangle_form_factor(1.0, 0.5, 1.0);
    for double_sided in [false, true] {
        let mut scene = white_floor("quad");
        lamp_over_origin(&mut scene, 3.0, true, double_sided);
        // Look from within the lamp's height, so that the ray does not pass through it.
        let look = |emitters, spp| {
            let reference = Reference::new(&scene).with_emitters(emitters);
            reference.probe(vec3(0.3, 0.4, -0.2), vec3(-0.3, -0.4, 0.2), spp, 0, 4)
        };
        assert_near(&look(Emitters::Sampled, 100_000), expected, 0.003);
        assert_near(&look(Emitters::BounceHits, 300_000), expected, 0.004);
    }
}

#[test]
fn back_of_a_one_sided_lamp_is_dark() {
    for emitters in [Emitters::Sampled, Emitters::BounceHits] {
        let mut scene = white_floor("back");
        lamp_over_origin(&mut scene, 3.0, false, false);
        let reference = Reference::new(&scene).with_emitters(emitters);
        let up = vec3(0.3, 0.4, -0.2);
        assert_exact(&reference.probe(up, -up, 1_000, 2, 1), [0.0; 3]);
        assert_exact(&reference.probe(up, Vec3::Y, 2, 2, 1), [0.0; 3]);
        assert_exact(&reference.probe(up + 2.0 * Vec3::Y, -Vec3::Y, 2, 0, 1), [3.0; 3]);
    }
}

/// Two lamps of different colour and size are sampled in proportion.
#[test]
fn lamps_add_up() {
    let mut scene = white_floor("two lamps");
    lamp_over_origin(&mut scene, 3.0, true, false);
    let dim = add_material(&mut scene, Material { emissive: vec3(0.2, 0.2, 0.2), ..matte() });
    // The second lamp is smaller, below the first one, and occludes its middle.
    place(&mut scene, quad(vec3(-0.25, 0.5, -0.25), 0.5 * Vec3::X, 0.5 * Vec3::Z, dim));
    let whole = rectangle_form_factor(1.0, 0.5, 1.0);
    let hidden = rectangle_form_factor(0.25, 0.25, 0.5);
    let expected = 3.0 * (whole - hidden) + 0.2 * hidden;
    // Look from the side under both lamps, so that the ray does not pass through the lower one.
    let seen = Reference::new(&scene).probe(vec3(0.4, 0.2, 0.0), vec3(-0.4, -0.2, 0.0), 400_000, 0, 5);
    assert_near(&seen, expected, 0.003);
}

#[test]
fn spot_light_has_gltf_falloff() {
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
fn visible_spherical_spot_is_scaled_by_its_cone() {
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
fn directional_light_has_its_irradiance_at_any_angle() {
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
        // The disc is not visible in the sky.
        let seen = Reference::new(&scene).probe(Vec3::Y, -direction, 2, 2, 1);
        assert_exact(&seen, [0.0; 3]);
    }
}
