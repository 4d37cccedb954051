//! Instances of a node's mesh (`EXT_mesh_gpu_instancing`).

use ::gltf::json::accessor::ComponentType::{F32, I8, I16};
use ::gltf::json::scene::Node;
use glam::{DAffine3, DQuat, DVec3, DVec4};
use serde_json::Value;

use super::accessor::Elements;
use super::buffers::Buffers;
use super::fault::{Fault, Outcome, Within, lookup};

/// Returns the transforms from the instances of a node's mesh to the node; `None` if the node is not instanced.
pub fn places(buffers: &Buffers, node: &Node) -> Outcome<Option<Vec<DAffine3>>> {
    let extension = node.extensions.as_ref().and_then(|e| e.others.get("EXT_mesh_gpu_instancing"));
    let Some(extension) = extension else { return Ok(None) };
    read(buffers, extension).within(|| "EXT_mesh_gpu_instancing".into()).map(Some)
}

fn read(buffers: &Buffers, extension: &Value) -> Outcome<Vec<DAffine3>> {
    let attributes = extension.get("attributes").and_then(Value::as_object);
    let number = |name: &str, index: &Value| {
        let index = index.as_u64().and_then(|i| usize::try_from(i).ok());
        index.ok_or_else(|| Fault::Invalid(format!("{name} is not the number of an accessor")))
    };
    let open = |name: &str, width: usize| {
        let Some(index) = attributes.and_then(|a| a.get(name)) else { return Ok(None) };
        let index = number(name, index)?;
        let elements = Elements::open(buffers, index).within(|| name.to_owned())?;
        if elements.width != width || ![F32, I8, I16].contains(&elements.component) {
            return Err(Fault::Invalid(format!(
                "{name}: accessor {index} does not hold vectors of {width} components"
            )));
        }
        Ok(Some(elements))
    };
    let [translations, rotations, scales] = [open("TRANSLATION", 3)?, open("ROTATION", 4)?, open("SCALE", 3)?];
    // Attributes of applications, whose names begin with `_`, count the instances too.
    let counts = attributes.into_iter().flatten().map(|(name, index)| {
        let accessors = &buffers.root.accessors;
        number(name, index).and_then(|index| lookup(accessors, "accessor", index)).within(|| name.clone())
    });
    let counts: Vec<u64> = counts.map(|accessor| accessor.map(|accessor| accessor.count.0)).collect::<Outcome<_>>()?;
    if counts.windows(2).any(|pair| pair[0] != pair[1]) {
        return Err(Fault::Invalid("its attributes have different counts".into()));
    }
    let count = counts.first().map_or(0, |&count| usize::try_from(count).unwrap_or(usize::MAX));
    if count > super::MAX_INSTANCES {
        return Err(super::too_many_instances());
    }
    buffers.budget().reserve((count * size_of::<DAffine3>()) as u64)?.keep();
    let vector = |elements: &Option<Elements>, i: usize, default: DVec3| {
        elements.as_ref().map_or(default, |e| DVec4::from_array(e.floats(i).map(f64::from)).truncate())
    };
    let place = |i: usize| {
        let rotation = rotations.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |e| e.floats(i)).map(f64::from);
        let rotation = DVec4::from_array(rotation).try_normalize().unwrap_or(DVec4::W);
        DAffine3::from_scale_rotation_translation(
            vector(&scales, i, DVec3::ONE),
            DQuat::from_vec4(rotation),
            vector(&translations, i, DVec3::ZERO),
        )
    };
    Ok((0..count).map(place).collect())
}
