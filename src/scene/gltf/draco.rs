//! Decompression of primitives with `KHR_draco_mesh_compression`.
//!
//! A decoded stream holds the elements of the primitive's accessors. The accessors' own counts are not trusted: the
//! stream knows how many vertices and triangles it has.

use std::collections::{BTreeMap, HashMap};

use ::gltf::json::accessor::{Accessor, ComponentType};
use ::gltf::json::mesh::{Mode, Primitive};
use ::gltf::json::validation::Checked;
use draco_core::{DataType, DecoderBuffer, FaceIndex, Mesh, MeshDecoder, PointAttribute, PointIndex};
use serde::Deserialize;

use super::buffers::Buffers;
use super::fault::{Fault, Outcome, Within, lookup};
use crate::scene::budget::Held;

pub const NAME: &str = "KHR_draco_mesh_compression";

/// Bytes of memory to reserve during decoding, per byte of a stream. Typical streams take one to three bytes per vertex.
const DECODING_BYTES: u64 = 128;

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Compressed {
    buffer_view: usize,
    /// Identifier in the stream of each attribute.
    attributes: BTreeMap<String, u32>,
}

/// Packed elements of a primitive's accessors, by the accessor's index; empty if the primitive is not compressed.
#[derive(Default)]
pub struct Decoded<'a>(HashMap<usize, Held<'a>>);

impl Decoded<'_> {
    pub fn elements(&self, accessor: usize) -> Option<&[u8]> {
        self.0.get(&accessor).map(|held| &**held)
    }
}

/// Decodes a primitive.
pub fn decode<'a>(buffers: &Buffers<'a>, primitive: &Primitive) -> Outcome<Decoded<'a>> {
    let extension = primitive.extensions.as_ref().and_then(|e| e.others.get(NAME));
    let mut decoded = Decoded::default();
    let Some(extension) = extension else { return Ok(decoded) };
    let compressed =
        Compressed::deserialize(extension).map_err(|e| Fault::Invalid(format!("it cannot be parsed: {e}")))?;
    if primitive.mode != Checked::Valid(Mode::Triangles) {
        return Err(Fault::Invalid("only primitives of triangles are read".into()));
    }
    let Some(indices) = primitive.indices else {
        return Err(Fault::Invalid("the primitive has no accessor for its indices".into()));
    };
    let stream = buffers.view(compressed.buffer_view)?.bytes;
    let budget = buffers.budget();
    let _decoder = budget.reserve(DECODING_BYTES * stream.len() as u64)?;
    let mut mesh = Mesh::new();
    MeshDecoder::new()
        .decode(&mut DecoderBuffer::new(stream), &mut mesh)
        .map_err(|e| Fault::Invalid(format!("its stream of {} bytes cannot be decoded: {e}", stream.len())))?;
    let corners = mesh.num_faces() * 3;
    let held = elements(buffers, indices.value(), corners, |accessor, bytes| copy_indices(&mesh, accessor, bytes))
        .within(|| "indices".into())?;
    decoded.0.insert(indices.value(), held);
    for (semantic, accessor) in &primitive.attributes {
        let Checked::Valid(semantic) = semantic else { continue };
        let name = semantic.to_string();
        let Some(&id) = compressed.attributes.get(&name) else { continue };
        let read = || {
            let attribute = mesh.attribute_by_unique_id(id);
            let attribute = attribute.ok_or_else(|| Fault::Invalid(format!("the stream has no attribute {id}")))?;
            elements(buffers, accessor.value(), mesh.num_points(), |accessor, bytes| {
                copy_attribute(&mesh, attribute, accessor, bytes)
            })
        };
        decoded.0.insert(accessor.value(), read().within(|| name.clone())?);
    }
    Ok(decoded)
}

/// Returns an accessor's `count` elements, which `copy` appends to its argument.
fn elements<'a>(
    buffers: &Buffers<'a>,
    index: usize,
    count: usize,
    copy: impl FnOnce(&Accessor, &mut Vec<u8>) -> Outcome<()>,
) -> Outcome<Held<'a>> {
    let accessor = lookup(&buffers.root.accessors, "accessor", index)?;
    let size = element_size(accessor)?;
    let reserved = buffers.budget().reserve((count * size) as u64)?;
    let mut bytes = Vec::with_capacity(count * size);
    copy(accessor, &mut bytes)?;
    Ok(Held { bytes, reserved })
}

fn copy_indices(mesh: &Mesh, accessor: &Accessor, bytes: &mut Vec<u8>) -> Outcome<()> {
    let component = component_of(accessor)?;
    for face in 0..mesh.num_faces() as u32 {
        for PointIndex(point) in mesh.face(FaceIndex(face)) {
            let word = point.to_le_bytes();
            let size = component.size();
            if size < 4 && point >> (8 * size) != 0 {
                return Err(Fault::Invalid(format!("vertex {point} does not fit in the accessor's {component:?}")));
            }
            bytes.extend_from_slice(&word[..size]);
        }
    }
    Ok(())
}

fn copy_attribute(mesh: &Mesh, attribute: &PointAttribute, accessor: &Accessor, bytes: &mut Vec<u8>) -> Outcome<()> {
    let component = component_of(accessor)?;
    let size = element_size(accessor)?;
    let is_same = matches!(
        (component, attribute.data_type()),
        (ComponentType::I8, DataType::Int8)
            | (ComponentType::U8, DataType::Uint8)
            | (ComponentType::I16, DataType::Int16)
            | (ComponentType::U16, DataType::Uint16)
            | (ComponentType::U32, DataType::Uint32)
            | (ComponentType::F32, DataType::Float32)
    );
    let width = usize::from(attribute.num_components());
    if !is_same || width * component.size() != size {
        return Err(Fault::Invalid(format!(
            "the stream holds {:?} x {width}, which differs from its accessor",
            attribute.data_type()
        )));
    }
    let data = attribute.buffer().data();
    let stride = usize::try_from(attribute.byte_stride()).unwrap_or(size);
    for point in 0..mesh.num_points() as u32 {
        let value = attribute.mapped_index(PointIndex(point)).0 as usize;
        let element = value.checked_mul(stride).and_then(|start| data.get(start..start.checked_add(size)?));
        let element = element.ok_or_else(|| Fault::Invalid(format!("the stream has no value for vertex {point}")))?;
        bytes.extend_from_slice(element);
    }
    Ok(())
}

fn component_of(accessor: &Accessor) -> Outcome<ComponentType> {
    match accessor.component_type {
        Checked::Valid(component) => Ok(component.0),
        Checked::Invalid => Err(Fault::Invalid("its accessor's componentType is unknown".into())),
    }
}

/// Returns the bytes of a packed element of an accessor.
fn element_size(accessor: &Accessor) -> Outcome<usize> {
    match accessor.type_ {
        Checked::Valid(type_) => Ok(component_of(accessor)?.size() * type_.multiplicity()),
        Checked::Invalid => Err(Fault::Invalid("its accessor's type is unknown".into())),
    }
}
