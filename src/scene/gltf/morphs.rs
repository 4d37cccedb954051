//! Morph targets of a primitive.

use ::gltf::json::Index;
use ::gltf::json::accessor::Accessor;
use ::gltf::json::accessor::ComponentType::{self, F32, I8, I16, U8, U16};
use ::gltf::json::mesh::MorphTarget;
use glam::Vec3;

use super::accessor::Elements;
use super::fault::{Fault, Outcome, Within};
use super::vertices::Vertices;
use crate::scene::motion::Morph;

const POSITION: &[ComponentType] = &[F32, I8, U8, I16, U16];
const DIRECTION: &[ComponentType] = &[F32, I8, I16];

/// Reads all targets in the file's order, for the vertices in use.
pub fn read(vertices: &Vertices, targets: &[MorphTarget]) -> Outcome<Vec<Morph>> {
    let one = |(i, target): (usize, &MorphTarget)| {
        let read = || -> Outcome<Morph> {
            Ok(Morph {
                positions: offsets(vertices, target.positions, POSITION).within(|| "POSITION".into())?,
                normals: offsets(vertices, target.normals, DIRECTION).within(|| "NORMAL".into())?,
                tangents: offsets(vertices, target.tangents, DIRECTION).within(|| "TANGENT".into())?,
            })
        };
        read().within(|| format!("morph target {i}"))
    };
    targets.iter().enumerate().map(one).collect()
}

/// Returns an upper bound on the morph targets' bytes per vertex.
pub fn bytes_per_vertex(targets: &[MorphTarget]) -> usize {
    let of = |t: &MorphTarget| [t.positions, t.normals, t.tangents].iter().flatten().count() * size_of::<Vec3>();
    targets.iter().map(of).sum()
}

fn offsets(vertices: &Vertices, accessor: Option<Index<Accessor>>, components: &[ComponentType]) -> Outcome<Vec<Vec3>> {
    let Some(accessor) = accessor else { return Ok(Vec::new()) };
    let elements = Elements::open(vertices.buffers, accessor.value())?;
    if elements.width != 3 || !components.contains(&elements.component) {
        return Err(Fault::Invalid(format!(
            "accessor {accessor} holds {:?} x {}, which is not allowed here",
            elements.component, elements.width
        )));
    }
    if elements.count != vertices.count {
        return Err(Fault::Invalid(format!("it has {} elements for {} vertices", elements.count, vertices.count)));
    }
    let gather = |&i: &u32| {
        let [x, y, z, _] = elements.floats(i as usize);
        let offset = Vec3::new(x, y, z);
        match offset.is_finite() {
            true => Ok(offset),
            false => Err(Fault::Invalid(format!("the offset of vertex {i} is not finite: {offset}"))),
        }
    };
    vertices.used.iter().map(gather).collect()
}
