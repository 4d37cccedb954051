//! Tests of lights and cameras.

use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_4};

use glam::{Affine3A, Quat, Vec3};
use serde_json::{Value, json};

use super::{Draft, assert_mentions};
use crate::scene::LightKind;

fn with_light(light: Value, mut node: Value) -> Draft {
    let mut draft = Draft::triangle();
    node["extensions"] = json!({"KHR_lights_punctual": {"light": 0}});
    draft.json["nodes"] = json!([node]);
    draft.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [light]}});
    draft.json["extensionsRequired"] = json!(["KHR_lights_punctual"]);
    draft
}

#[test]
fn lights_shine_along_minus_z_from_their_node() {
    let down = Quat::from_rotation_x(-FRAC_PI_2).to_array();
    let node = json!({"translation": [1, 2, 3], "rotation": down, "scale": [5, 5, 5]});
    let sun = with_light(json!({"type": "directional", "color": [1, 0.5, 0], "intensity": 4}), node.clone()).scene();
    assert_eq!(sun.lights[0].strength, Vec3::new(4.0, 2.0, 0.0));
    let LightKind::Directional { direction, angle_rad } = sun.lights[0].kind else { panic!() };
    assert!(direction.distance(Vec3::NEG_Y) < 1e-6);
    assert_eq!(angle_rad, 0.0);

    let bulb = with_light(json!({"type": "point", "range": 3}), node.clone()).scene();
    assert_eq!(bulb.lights[0].kind, LightKind::Point { position: Vec3::new(1.0, 2.0, 3.0), radius: 0.0 });
    assert_eq!(bulb.warnings.len(), 1);
    assert_mentions(&bulb.warnings[0], &["range", "node 0"]);

    let spot = json!({"type": "spot", "spot": {"innerConeAngle": FRAC_PI_4, "outerConeAngle": FRAC_PI_2}});
    let LightKind::Spot { cos_inner, cos_outer, .. } = with_light(spot, node.clone()).scene().lights[0].kind else {
        panic!()
    };
    assert!((cos_inner - FRAC_1_SQRT_2).abs() < 1e-6);
    assert_eq!(cos_outer, 0.0);
    let LightKind::Spot { cos_inner, cos_outer, .. } = with_light(json!({"type": "spot"}), node).scene().lights[0].kind
    else {
        panic!()
    };
    assert_eq!((cos_inner, cos_outer), (1.0, FRAC_PI_4.cos()));
}

#[test]
fn rejects_impossible_lights() {
    let bad = [
        json!({"type": "point", "name": "L", "intensity": -1}),
        json!({"type": "point", "name": "L", "intensity": 1e39}),
        json!({"type": "spot", "name": "L", "spot": {"innerConeAngle": 1.0, "outerConeAngle": 0.5}}),
        json!({"type": "spot", "name": "L", "spot": {"innerConeAngle": 1.0, "outerConeAngle": 3.0}}),
    ];
    for light in bad {
        assert_mentions(&with_light(light, json!({})).complaint(), &["light 0 'L'"]);
    }
    let mut absent = with_light(json!({"type": "point"}), json!({}));
    absent.json["extensions"]["KHR_lights_punctual"]["lights"] = json!([]);
    assert_mentions(&absent.complaint(), &["node 0", "light 0"]);
    let flat = with_light(json!({"type": "spot"}), json!({"scale": [0, 0, 0]})).scene();
    assert_eq!((flat.lights.len(), flat.warnings.len()), (0, 1));
    let laser = with_light(json!({"type": "laser"}), json!({})).scene();
    assert_eq!((laser.lights.len(), laser.warnings.len()), (0, 1));
}

fn with_camera(camera: Value, mut node: Value) -> Draft {
    let mut draft = Draft::triangle();
    node["camera"] = json!(0);
    draft.json["nodes"] = json!([node]);
    draft.push("cameras", camera);
    draft
}

#[test]
fn cameras_lose_scale_and_mirroring() {
    let lens = json!({"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.1}});
    let turn = Quat::from_rotation_y(0.4);
    let expected = Affine3A::from_rotation_translation(turn, Vec3::new(1.0, 2.0, 3.0));
    for scale in [[3.0, 3.0, 3.0], [-2.0, 2.0, 2.0]] {
        let node = json!({"translation": [1, 2, 3], "rotation": turn.to_array(), "scale": scale});
        let camera = with_camera(lens.clone(), node).scene().cameras[0];
        assert_eq!(camera.yfov_rad, 0.8);
        assert!(camera.world_from_view.abs_diff_eq(expected, 1e-6), "{camera:?}");
    }
    let flat = with_camera(lens, json!({"scale": [1, 0, 1]})).scene();
    assert_eq!((flat.cameras.len(), flat.warnings.len()), (0, 1));
}

#[test]
fn unsupported_cameras_cause_a_warning() {
    let flat = json!({"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 1}});
    let scene = with_camera(flat, json!({})).scene();
    assert_eq!((scene.cameras.len(), scene.warnings.len()), (0, 1));
    for yfov in [0.0, -1.0, 3.2, 1e39] {
        let lens = json!({"type": "perspective", "perspective": {"yfov": yfov, "znear": 0.1}});
        let scene = with_camera(lens, json!({})).scene();
        assert_eq!((scene.cameras.len(), scene.warnings.len()), (0, 1));
        assert_mentions(&scene.warnings[0], &["yfov", "left out"]);
    }
}
