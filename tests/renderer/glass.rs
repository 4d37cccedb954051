//! Light through glass, and surfaces that only look like glass.

use crate::common::{Stage, Subject};
use crate::pictures::seen;
use crate::reference::Pinhole;
use crate::reference::scenes::{add_material, add_quad, colored, empty, matte, place, quad, studio};
use diptych::RunConfig;
use diptych::image::RgbImage;
use diptych::scene::needs::SceneNeeds;
use diptych::scene::{Environment, Light, LightKind, Material, Scene, Volume};
use glam::{Vec3, vec3};

const SIZE: u32 = 8;

/// Returns a white floor for a camera beneath all panes that looks straight down at the origin.
fn floor() -> Scene {
    let mut scene = empty("floor");
    add_quad(&mut scene, (vec3(-9.0, 0.0, -9.0), 18.0 * Vec3::Z, 18.0 * Vec3::X), colored(Vec3::splat(0.8)));
    scene
}

fn subject(scene: &Scene) -> Subject {
    let camera = Pinhole::looking_at(vec3(0.0, 0.9, 0.3), Vec3::ZERO, Vec3::Y, 6.0);
    seen((scene.clone(), camera))
}

fn rendered(scene: &Scene, settings: impl Fn(&mut RunConfig)) -> RgbImage {
    let subject = subject(scene);
    let mut chosen = subject.settings(SIZE, SIZE);
    chosen.envelope.most.bounces = 1;
    settings(&mut chosen);
    Stage::alone(&subject, &chosen).frame(0).linear.into_left()
}

/// Returns the light of a floor with panes of these materials above it, relative to the floor without panes, in red,
/// green and blue.
fn passed(light: Light, panes: &[Material]) -> [f64; 3] {
    let mut scene = floor();
    scene.lights.push(light);
    let open = rendered(&scene, |_| ());
    for (i, pane) in panes.iter().enumerate() {
        add_quad(&mut scene, (vec3(-9.0, 1.0 + 0.1 * i as f32, -9.0), 18.0 * Vec3::Z, 18.0 * Vec3::X), pane.clone());
    }
    let dimmed = rendered(&scene, |_| ());
    let mean = |image: &RgbImage, c| image.pixels.iter().map(|p: &[f32; 3]| f64::from(p[c])).sum::<f64>();
    assert!(mean(&open, 0) > 0.1, "the floor is dark without panes");
    [0, 1, 2].map(|c| mean(&dimmed, c) / mean(&open, c))
}

fn clear() -> Material {
    studio::glass(Vec3::ONE, 0.0)
}

fn sun(direction: Vec3, angle_rad: f32) -> Light {
    Light { kind: LightKind::Directional { direction: direction.normalize(), angle_rad }, strength: Vec3::splat(3.0) }
}

#[track_caller]
fn assert_passes(light: Light, panes: &[Material], expected: [f64; 3]) {
    let found = passed(light, panes);
    let is_near = found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-3);
    assert!(is_near, "{:?}: {found:?} of the light passes, not {expected:?}", light.kind);
}

/// Returns 1 − F of the thin-walled model, F = 0.04 + 0.96 (1 − cos)⁵ for an index of refraction of 1.5.
fn clearness(cosine: f64) -> f64 {
    0.96 * (1.0 - (1.0 - cosine).powi(5))
}

#[test]
fn delta_lights_shine_through_panes() {
    let high = vec3(0.0, 30.0, 0.0);
    let point = Light { kind: LightKind::Point { position: high, radius: 0.0 }, strength: Vec3::splat(3e3) };
    let (cos_inner, cos_outer) = (0.95, 0.8);
    let spot = LightKind::Spot { position: high, radius: 0.0, direction: Vec3::NEG_Y, cos_inner, cos_outer };
    let spot = Light { kind: spot, ..point };
    for light in [sun(Vec3::NEG_Y, 0.0), sun(Vec3::NEG_Y, 0.05), point, spot] {
        assert_passes(light, &[clear()], [0.96; 3]);
    }
    // Cases differ by angle, number and kind of panes.
    let down = sun(Vec3::NEG_Y, 0.0);
    assert_passes(sun(vec3(0.8, -0.6, 0.0), 0.0), &[clear()], [clearness(0.6); 3]);
    assert_passes(down, &[clear(), clear(), clear()], [0.96f64.powi(3); 3]);
    assert_passes(down, &[studio::glass(vec3(0.25, 0.5, 1.0), 0.0)], [0.24, 0.48, 0.96]);
    let half = Material { transmission: 0.5, metallic: 0.2, ..clear() };
    assert_passes(down, &[half], [0.96 * 0.5 * 0.8; 3]);
    let coated = Material { clearcoat: diptych::scene::Clearcoat { factor: 1.0, ..Default::default() }, ..clear() };
    assert_passes(down, &[coated], [0.96 * 0.96; 3]);
    // An opaque surface among panes blocks all light, and rough panes and volumes pass none straight on.
    for stops in [matte(), studio::glass(Vec3::ONE, 0.3), Material { volume: studio::CLEAR, ..clear() }] {
        assert_passes(down, &[clear(), stops, clear()], [0.0; 3]);
    }
}

/// Water attenuates a lamp below its surface over the way to that surface. For the floor beside a lamp, it also
/// attenuates the way from the lamp.
#[test]
fn volumes_attenuate_light_on_each_path_segment() {
    let absorption = [0.5f64, 1.0, 2.0];
    let below_water = |light: Light, per_metre: [f64; 3]| {
        let mut scene = floor();
        scene.lights.push(light);
        let attenuation_color = Vec3::from(per_metre.map(|a| (-a).exp() as f32));
        let volume = Some(Volume { attenuation_color, attenuation_distance: 1.0 });
        let water = add_material(&mut scene, Material { ior: 1.0, volume, ..clear() });
        place(&mut scene, quad(vec3(-9.0, 0.5, -9.0), 18.0 * Vec3::Z, 18.0 * Vec3::X, water));
        let image = rendered(&scene, |settings| settings.envelope.most.bounces = 2);
        [0, 1, 2].map(|c| image.pixels.iter().map(|p: &[f32; 3]| f64::from(p[c])).sum::<f64>())
    };
    // Light goes from the floor or a lamp's front to the surface at an angle, then from that point to the floor.
    let up = 0.5 * (0.9f64.powi(2) + 0.3f64.powi(2)).sqrt() / 0.9;
    for (height, radius, way) in [(0.4f32, 0.0f32, up + 0.4), (0.0, 0.2, up - 0.2)] {
        let kind = LightKind::Point { position: vec3(0.0, height, 0.0), radius };
        let light = Light { kind, strength: Vec3::splat(3.0) };
        let (clear, dimmed) = (below_water(light, [0.0; 3]), below_water(light, absorption));
        for c in 0..3 {
            let (found, expected) = (dimmed[c] / clear[c], (-absorption[c] * way).exp());
            assert!((found / expected - 1.0).abs() < 0.03, "radius {radius}: {found} of the light, not {expected}");
        }
    }
}

/// The volume of an opaque material is invisible, whatever else the scene contains and whatever is compiled in.
#[test]
fn volume_of_an_opaque_material_is_ignored() {
    let dense = Volume { attenuation_color: vec3(0.5, 0.1, 0.01), attenuation_distance: 0.1 };
    let render = |volume, all| {
        let mut scene = floor();
        scene.materials[0].volume = volume;
        // Seen from behind, a ray would have passed through the volume.
        scene.instances[0].world_from_local = glam::Affine3A::from_rotation_x(std::f32::consts::PI);
        scene.lights.push(sun(vec3(0.3, -1.0, 0.1), 0.0));
        rendered(&scene, |settings| {
            settings.envelope.most.bounces = 4;
            let needs = SceneNeeds::of(&scene);
            settings.buffers.needs = if all { needs.widened() } else { needs };
        })
    };
    let expected = render(None, false);
    assert!(expected.pixels.iter().all(|p| p[0] > 0.1));
    for all in [false, true] {
        assert!(render(Some(dense), all) == expected, "everything compiled in: {all}");
    }
}

/// Behind dark glass, a surface is hardly seen. The filter shares its light with what is seen of it beside the glass,
/// where noise of a pixel of the glass would be bright.
#[test]
#[ignore = "takes many samples: `make test-full` runs it"]
fn dark_glass_sheds_no_light_on_its_surroundings() {
    let mut scene = floor();
    scene.environment = Environment::Constant(Vec3::ONE);
    let lamp = LightKind::Point { position: vec3(3.0, 4.0, 1.0), radius: 1.5 };
    scene.lights.push(Light { kind: lamp, strength: Vec3::splat(300.0) });
    let pane = add_material(&mut scene, studio::glass(Vec3::splat(1e-3), 0.0));
    place(&mut scene, quad(vec3(-9.0, 0.1, -9.0), 18.0 * Vec3::Z, 9.0 * Vec3::X, pane));
    let camera = Pinhole::looking_at(vec3(0.0, 4.0, 0.5), Vec3::ZERO, Vec3::Y, 40.0);
    let subject = seen((scene, camera));
    let (width, height) = (48, 32);
    // The right half of the picture shows the floor beside the pane.
    let beside = |image: RgbImage| -> Vec<f32> {
        image.pixels.chunks(width as usize).flat_map(|row| row[26..].iter().map(|p| p[1])).collect()
    };
    let mut thorough = subject.settings(width, height);
    thorough.envelope.most.spp = 256.into();
    let expected = beside(Stage::alone(&subject, &thorough).frame(0).linear.into_left());
    let mut stage = Stage::alone(&subject, &subject.accumulated(width, height));
    for index in 0..12 {
        let found = beside(stage.frame(index).linear.into_left());
        let off = found.iter().zip(&expected).map(|(found, expected)| found / expected - 1.0).fold(0.0, f32::max);
        assert!(off < 0.08, "frame {index}: a pixel beside the pane is {off} times too bright");
    }
}
