//! Lights (`KHR_lights_punctual`) and cameras, transformed by the scene's nodes.

use std::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use ::gltf::json::Root;
use ::gltf::json::camera::Type as Projection;
use ::gltf::json::extensions::scene::khr_lights_punctual::{Light as JsonLight, Type as JsonKind};
use ::gltf::json::validation::Checked;
use glam::{DVec3, Vec3};

use super::fault::{Fault, Outcome, Warnings, Within, label, lookup};
use super::hierarchy::PlacedNode;
use crate::scene::motion::pose::without_scale;
use crate::scene::{Camera, Light, LightKind};

/// A light of the scene: a light of the file, placed by a node.
pub struct PlacedLight {
    pub light: Light,
    /// Index into the file's lights.
    pub index: usize,
    /// Index of its node in the list of placed nodes.
    pub place: usize,
}

pub fn lights(root: &Root, nodes: &[PlacedNode], warnings: &mut Warnings) -> Outcome<Vec<PlacedLight>> {
    let declared = root.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref());
    let declared = declared.map_or(&[][..], |l| &l.lights);
    let mut lights = Vec::new();
    for (at, placed) in nodes.iter().enumerate() {
        let node = &root.nodes[placed.node];
        if !placed.is_visible {
            continue;
        }
        let Some(reference) = node.extensions.as_ref().and_then(|e| e.khr_lights_punctual.as_ref()) else { continue };
        let place = label("node", placed.node, &node.name);
        let index = reference.light.value();
        let light = lookup(declared, "light", index).within(|| place.clone())?;
        let read = read_light(light, placed, &place, warnings).within(|| label("light", index, &light.name))?;
        lights.extend(read.map(|light| PlacedLight { light, index, place: at }));
    }
    Ok(lights)
}

/// Reads a light. Returns `None`, with a warning, if its type is unknown, or if it needs a direction but its node has scale
/// 0.
fn read_light(light: &JsonLight, placed: &PlacedNode, place: &str, warnings: &mut Warnings) -> Outcome<Option<Light>> {
    let strength = Vec3::from_array(light.color) * light.intensity;
    if !strength.is_finite() || strength.min_element() < 0.0 {
        return Err(Fault::Invalid(format!("its colour times intensity, {strength}, is negative or not finite")));
    }
    if light.range.is_some() {
        warnings.note("the range of lights is ignored: their falloff is the inverse square of the distance", place);
    }
    let Checked::Valid(kind) = light.type_ else {
        warnings.note("lights whose type is none of directional, point and spot are left out", place);
        return Ok(None);
    };
    let position = placed.world_from_node.translation.as_vec3();
    let direction = placed.world_from_node.transform_vector3(DVec3::NEG_Z).try_normalize().map(DVec3::as_vec3);
    let kind = match (kind, direction) {
        (JsonKind::Point, _) => LightKind::Point { position, radius: 0.0 },
        (_, None) => {
            warnings.note("lights on nodes of scale 0 have no direction and are left out", place);
            return Ok(None);
        }
        (JsonKind::Directional, Some(direction)) => LightKind::Directional { direction, angle_rad: 0.0 },
        (JsonKind::Spot, Some(direction)) => {
            let (inner, outer) =
                light.spot.as_ref().map_or((0.0, FRAC_PI_4), |s| (s.inner_cone_angle, s.outer_cone_angle));
            // Files write π/2 with few digits, which may round it up.
            if !(0.0 <= inner && inner <= outer && 0.0 < outer && outer <= FRAC_PI_2 + 1e-3) {
                return Err(Fault::Invalid(format!(
                    "its cone angles {inner} and {outer} violate 0 <= inner <= outer <= pi / 2 or outer > 0"
                )));
            }
            let cosine = |angle: f32| angle.cos().max(0.0);
            LightKind::Spot { position, radius: 0.0, direction, cos_inner: cosine(inner), cos_outer: cosine(outer) }
        }
    };
    Ok(Some(Light { kind, strength }))
}

/// Returns the cameras, each with its node's index in the list of nodes.
pub fn cameras(root: &Root, nodes: &[PlacedNode], warnings: &mut Warnings) -> Outcome<Vec<(Camera, usize)>> {
    let mut cameras = Vec::new();
    for (at, placed) in nodes.iter().enumerate() {
        let node = &root.nodes[placed.node];
        let Some(index) = node.camera else { continue };
        let place = label("node", placed.node, &node.name);
        let camera = lookup(&root.cameras, "camera", index.value()).within(|| place.clone())?;
        let Checked::Valid(Projection::Perspective) = camera.type_ else {
            warnings.note("only perspective cameras are read", &place);
            continue;
        };
        let yfov_rad = camera.perspective.as_ref().map(|p| p.yfov).filter(|yfov| *yfov > 0.0 && *yfov < PI);
        let Some(yfov_rad) = yfov_rad else {
            warnings.note("cameras whose yfov is not between 0 and pi are left out", &place);
            continue;
        };
        match without_scale(&placed.world_from_node) {
            Some(world_from_view) => cameras.push((Camera { world_from_view, yfov_rad }, at)),
            None => warnings.note("cameras on nodes of scale 0 have no direction and are left out", &place),
        }
    }
    Ok(cameras)
}
