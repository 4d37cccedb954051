//! Conversion of mesh primitives to [`Mesh`]es, once per primitive regardless of its instances.

use std::ops::Range;

use ::gltf::json::accessor::ComponentType::{self, U8, U16, U32};
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{Vec2, Vec3, Vec4};

use super::accessor::Elements;
use super::buffers::Buffers;
use super::draco::{self, Decoded};
use super::fault::{Fault, Outcome, Warnings, Within, label, lookup};
use super::topology::{assemble, compact, corners};
use super::variants;
pub use super::vertices::Wanted;
use super::vertices::{QUANTIZED, Vertices, attribute};
use super::{morphs, skins, tangents};
use crate::scene::motion::Influence;
use crate::scene::{Material, Mesh};

/// Limit on triangles before instancing. Files with more are taken for damaged or hostile.
const MAX_TRIANGLES: usize = 1 << 27;

const INDEX: &[ComponentType] = &[U8, U16, U32];

/// Bytes that assembling triangles takes: per triangle corner, including the spare capacity of growing lists, and per
/// vertex of the file.
const CORNER_BYTES: u64 = 40;
const VERTEX_BYTES: u64 = 16;

/// The meshes read so far.
pub struct Geometry<'a, 'b> {
    buffers: &'a Buffers<'b>,
    /// Materials of the file, which determine the meshes that need tangents.
    materials: &'a [Material],
    /// Motion data that each glTF mesh needs.
    wanted: &'a [Wanted],
    /// Index of the material variant; `None` for the default look.
    variant: Option<usize>,
    meshes: Vec<Mesh>,
    /// Range in `meshes` of each glTF mesh's primitives, once read.
    ranges: Vec<Option<Range<usize>>>,
    triangles_left: usize,
}

impl<'a, 'b> Geometry<'a, 'b> {
    pub fn new(
        buffers: &'a Buffers<'b>,
        materials: &'a [Material],
        wanted: &'a [Wanted],
        variant: Option<usize>,
    ) -> Self {
        let ranges = vec![None; buffers.root.meshes.len()];
        Self { buffers, materials, wanted, variant, meshes: Vec::new(), ranges, triangles_left: MAX_TRIANGLES }
    }

    /// Returns the range of the scene's meshes that holds the primitives of glTF mesh `index`. Reads the glTF mesh on
    /// first use.
    pub fn primitives_of(&mut self, index: usize, warnings: &mut Warnings) -> Outcome<Range<usize>> {
        let mesh = lookup(&self.buffers.root.meshes, "mesh", index)?;
        if let Some(range) = &self.ranges[index] {
            return Ok(range.clone());
        }
        let start = self.meshes.len();
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("{} primitive {i}", label("mesh", index, &mesh.name));
            let wanted = self.wanted.get(index).copied().unwrap_or_default();
            let read = self.read(primitive, wanted, &place, warnings).within(|| place.clone())?;
            self.meshes.extend(read);
        }
        let range = start..self.meshes.len();
        self.ranges[index] = Some(range.clone());
        Ok(range)
    }

    /// Returns true if a mesh refers to the default material, which follows the file's materials.
    pub fn uses_default_material(&self) -> bool {
        self.meshes.iter().any(|m| m.material == self.materials.len())
    }

    pub fn into_meshes(self) -> Vec<Mesh> {
        self.meshes
    }

    fn read(
        &mut self,
        primitive: &Primitive,
        wanted: Wanted,
        place: &str,
        warnings: &mut Warnings,
    ) -> Outcome<Option<Mesh>> {
        let Checked::Valid(mode) = primitive.mode else {
            warnings.note("primitives whose mode is none of 0 to 6 are left out", place);
            return Ok(None);
        };
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            warnings.note("points and lines are left out", place);
            return Ok(None);
        }
        let decoded = draco::decode(self.buffers, primitive).within(|| draco::NAME.into())?;
        let Some(positions) = attribute(self.buffers, &decoded, primitive, Semantic::Positions, 3..=3, QUANTIZED)?
        else {
            warnings.note("primitives without POSITION are left out", place);
            return Ok(None);
        };
        let indices = self.indices(&decoded, primitive)?;
        let corner_count = indices.as_ref().map_or(positions.count, |(indices, _)| indices.count);
        if corner_count / 3 > MAX_TRIANGLES {
            return Err(too_many());
        }
        let budget = self.buffers.budget();
        let _lists = budget.reserve(corner_count as u64 * CORNER_BYTES + positions.count as u64 * VERTEX_BYTES)?;
        let corners = corners(indices, positions.count)?;
        if mode == Mode::Triangles && !corners.len().is_multiple_of(3) {
            warnings.note("vertices after the last whole triangle are left out", place);
        }
        let mut triangles = assemble(mode, &corners);
        if triangles.is_empty() {
            warnings.note("primitives without triangles are left out", place);
            return Ok(None);
        }
        self.triangles_left = self.triangles_left.checked_sub(triangles.len()).ok_or_else(too_many)?;
        let used = compact(&mut triangles, positions.count);
        let vertices = Vertices {
            buffers: self.buffers,
            decoded: &decoded,
            primitive,
            used: &used,
            count: positions.count,
            wanted,
        };
        let material = self.material(primitive)?;
        let map = self.materials.get(material).and_then(tangents::wanted_by);
        let mut reserved = budget.reserve(vertices.mesh_bytes(triangles.capacity(), map.is_some()))?;
        let positions = vertices.positions(&positions)?;
        let normals = vertices.normals(&positions, &triangles, place, warnings)?;
        let mut mesh = Mesh {
            normals,
            positions,
            uvs: [vertices.uvs(0, place, warnings)?, vertices.uvs(1, place, warnings)?],
            colors: vertices.colors(place, warnings)?,
            influences: if wanted.influences { skins::influences(&vertices, place, warnings)? } else { Vec::new() },
            morphs: morphs::read(&vertices, vertices.targets())?,
            triangles,
            material,
            ..Mesh::default()
        };
        if let Some(map) = map {
            // glTF ignores the tangents of a primitive without normals.
            let given = if mesh.normals.is_empty() { None } else { vertices.tangents(place, warnings)? };
            tangents::give(&mut mesh, map, given, place, warnings);
        }
        reserved.shrink_to(mesh.bytes());
        reserved.keep();
        Ok(Some(mesh))
    }

    fn material(&self, primitive: &Primitive) -> Outcome<usize> {
        let of_variant = self.variant.and_then(|variant| variants::material(primitive, variant));
        match of_variant.or(primitive.material.map(|index| index.value())) {
            Some(index) => lookup(self.materials, "material", index).map(|_| index),
            None => Ok(self.materials.len()),
        }
    }

    /// Returns the primitive's indices and the index of their accessor.
    fn indices<'c>(&self, decoded: &'c Decoded, primitive: &Primitive) -> Outcome<Option<(Elements<'c>, usize)>>
    where
        'a: 'c,
    {
        let Some(index) = primitive.indices else { return Ok(None) };
        let indices = Elements::open_decoded(self.buffers, index.value(), decoded.elements(index.value()))
            .within(|| "indices".into())?;
        if indices.width != 1 || !INDEX.contains(&indices.component) {
            return Err(Fault::Invalid(format!(
                "indices: accessor {index} holds {:?} x {}, not unsigned scalars",
                indices.component, indices.width
            )));
        }
        Ok(Some((indices, index.value())))
    }
}

impl Vertices<'_, '_> {
    /// Returns an upper bound on the bytes of a mesh with `triangles` triangles during its construction. `mapped` is
    /// true if the mesh needs tangents for a normal map.
    fn mesh_bytes(&self, triangles: usize, mapped: bool) -> u64 {
        let has = |semantic| self.primitive.attributes.contains_key(&Checked::Valid(semantic));
        let attributes = [
            (true, size_of::<Vec3>()),
            (has(Semantic::Normals), size_of::<Vec3>()),
            (has(Semantic::TexCoords(0)), size_of::<Vec2>()),
            (has(Semantic::TexCoords(1)), size_of::<Vec2>()),
            (has(Semantic::Colors(0)), size_of::<Vec4>()),
            (mapped, size_of::<Vec4>()),
        ];
        let still: usize = attributes.iter().filter(|(is_there, _)| *is_there).map(|(_, bytes)| bytes).sum();
        let influence = if self.wanted.influences { size_of::<Influence>() } else { 0 };
        let made = mapped && !(has(Semantic::Tangents) && has(Semantic::Normals));
        // Tangents of each morph target; temporarily also the positions and normals of one target, and the derivatives
        // of two shapes.
        let targets = self.targets().len();
        let made_of_targets = if made && targets > 0 { (targets + 4) * size_of::<Vec3>() } else { 0 };
        let moved = influence + morphs::bytes_per_vertex(self.targets()) + made_of_targets;
        let per_triangle = size_of::<[u32; 3]>() + if made { tangents::BYTES_PER_TRIANGLE + 6 * moved } else { 0 };
        (self.used.len() * (still + moved) + triangles * per_triangle) as u64
    }
}

fn too_many() -> Fault {
    Fault::Invalid(format!("the file has more than {MAX_TRIANGLES} triangles"))
}
