//! Turns mesh primitives into [`Mesh`]es, each once however often it is placed.

use std::ops::Range;

use ::gltf::json::accessor::ComponentType::{self, F32, I8, I16, U8, U16, U32};
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{DVec3, Vec2, Vec3, Vec4};

use super::accessor::Elements;
use super::buffers::Buffers;
use super::fault::{Fault, Outcome, Warnings, Within, label, lookup};
use super::tangents;
use crate::scene::{Material, Mesh};

/// More triangles than this, before instancing, are taken for a damaged or hostile file.
const MAX_TRIANGLES: usize = 1 << 27;

const QUANTIZED: &[ComponentType] = &[F32, I8, U8, I16, U16];
const COLOR: &[ComponentType] = &[F32, U8, U16];
const INDEX: &[ComponentType] = &[U8, U16, U32];

/// What a corner takes while triangles are made, with their list as it grows, and a vertex of the file, bytes.
const CORNER_BYTES: u64 = 40;
const VERTEX_BYTES: u64 = 16;

/// The meshes read so far.
pub struct Geometry<'a, 'b> {
    buffers: &'a Buffers<'b>,
    /// Those of the file; they say which meshes need tangents.
    materials: &'a [Material],
    meshes: Vec<Mesh>,
    /// Per glTF mesh, once read, where its primitives are in `meshes`.
    ranges: Vec<Option<Range<usize>>>,
    triangles_left: usize,
}

impl<'a, 'b> Geometry<'a, 'b> {
    pub fn new(buffers: &'a Buffers<'b>, materials: &'a [Material]) -> Self {
        let ranges = vec![None; buffers.root.meshes.len()];
        Self { buffers, materials, meshes: Vec::new(), ranges, triangles_left: MAX_TRIANGLES }
    }

    /// The places in the scene's meshes of the primitives of glTF mesh `index`, read on first use.
    pub fn primitives_of(&mut self, index: usize, warnings: &mut Warnings) -> Outcome<Range<usize>> {
        let mesh = lookup(&self.buffers.root.meshes, "mesh", index)?;
        if let Some(range) = &self.ranges[index] {
            return Ok(range.clone());
        }
        let start = self.meshes.len();
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("{} primitive {i}", label("mesh", index, &mesh.name));
            let read = self.read(primitive, &place, warnings).within(|| place.clone())?;
            self.meshes.extend(read);
        }
        let range = start..self.meshes.len();
        self.ranges[index] = Some(range.clone());
        Ok(range)
    }

    /// Whether a mesh refers to the material after the file's last.
    pub fn uses_default_material(&self) -> bool {
        self.meshes.iter().any(|m| m.material == self.materials.len())
    }

    pub fn into_meshes(self) -> Vec<Mesh> {
        self.meshes
    }

    fn read(&mut self, primitive: &Primitive, place: &str, warnings: &mut Warnings) -> Outcome<Option<Mesh>> {
        let Checked::Valid(mode) = primitive.mode else {
            return Err(Fault::Invalid("its mode is none of 0 to 6".into()));
        };
        if !matches!(mode, Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan) {
            warnings.note("points and lines are left out", place);
            return Ok(None);
        }
        let Some(positions) = attribute(self.buffers, primitive, Semantic::Positions, 3..=3, QUANTIZED)? else {
            warnings.note("primitives without POSITION are left out", place);
            return Ok(None);
        };
        if primitive.targets.as_ref().is_some_and(|t| !t.is_empty()) {
            warnings.note("morph targets are left out", place);
        }
        let indices = self.indices(primitive)?;
        let corner_count = indices.as_ref().map_or(positions.count, |(indices, _)| indices.count);
        if corner_count / 3 > MAX_TRIANGLES {
            return Err(too_many());
        }
        let budget = self.buffers.budget();
        let _lists = budget.reserve(corner_count as u64 * CORNER_BYTES + positions.count as u64 * VERTEX_BYTES)?;
        let corners = corners(indices, positions.count)?;
        let mut triangles = assemble(mode, &corners)?;
        if triangles.is_empty() {
            warnings.note("primitives without triangles are left out", place);
            return Ok(None);
        }
        self.triangles_left = self.triangles_left.checked_sub(triangles.len()).ok_or_else(too_many)?;
        let used = compact(&mut triangles, positions.count);
        let vertices = Vertices { buffers: self.buffers, primitive, used: &used, count: positions.count };
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
            triangles,
            material,
            ..Mesh::default()
        };
        if let Some(map) = map {
            // The format has tangents ignored where there are no normals.
            let given = if mesh.normals.is_empty() { None } else { vertices.tangents(place, warnings)? };
            tangents::give(&mut mesh, map, given, place, warnings);
        }
        reserved.shrink_to(mesh.bytes());
        reserved.keep();
        Ok(Some(mesh))
    }

    fn material(&self, primitive: &Primitive) -> Outcome<usize> {
        match primitive.material {
            Some(index) => lookup(self.materials, "material", index.value()).map(|_| index.value()),
            None => Ok(self.materials.len()),
        }
    }

    /// The elements of the primitive's indices, with their accessor.
    fn indices(&self, primitive: &Primitive) -> Outcome<Option<(Elements<'a>, usize)>> {
        let Some(index) = primitive.indices else { return Ok(None) };
        let indices = Elements::open(self.buffers, index.value()).within(|| "indices".into())?;
        if indices.width != 1 || !INDEX.contains(&indices.component) {
            return Err(Fault::Invalid(format!(
                "indices: accessor {index} holds {:?} x {}, not unsigned scalars",
                indices.component, indices.width
            )));
        }
        Ok(Some((indices, index.value())))
    }
}

/// The vertices in the order in which triangles take them, each below `vertex_count`.
fn corners(indices: Option<(Elements, usize)>, vertex_count: usize) -> Outcome<Vec<u32>> {
    let Some((indices, accessor)) = indices else { return Ok((0..vertex_count as u32).collect()) };
    let corners: Vec<u32> = (0..indices.count).map(|i| indices.unsigned(i)).collect();
    match corners.iter().position(|&v| v as usize >= vertex_count) {
        None => Ok(corners),
        Some(at) => Err(Fault::Invalid(format!(
            "indices: accessor {accessor} points to vertex {} (its element {at}), but there are {vertex_count}",
            corners[at]
        ))),
    }
}

/// Attributes of one primitive, gathered for the vertices in use.
struct Vertices<'a, 'b> {
    buffers: &'a Buffers<'b>,
    primitive: &'a Primitive,
    used: &'a [u32],
    /// Vertices in the file.
    count: usize,
}

impl Vertices<'_, '_> {
    /// At most what the mesh takes while it is made.
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
        let per_vertex: usize = attributes.iter().filter(|(is_there, _)| *is_there).map(|(_, bytes)| bytes).sum();
        let made = mapped && !has(Semantic::Tangents);
        let per_triangle = size_of::<[u32; 3]>() + if made { tangents::BYTES_PER_TRIANGLE } else { 0 };
        (self.used.len() * per_vertex + triangles * per_triangle) as u64
    }

    fn positions(&self, elements: &Elements) -> Outcome<Vec<Vec3>> {
        let gather = |&i: &u32| {
            let [x, y, z, _] = elements.floats(i as usize);
            let p = Vec3::new(x, y, z);
            if p.is_finite() {
                Ok(p)
            } else {
                Err(Fault::Invalid(format!("POSITION of vertex {i} is not finite: {p}")))
            }
        };
        self.used.iter().map(gather).collect()
    }

    fn normals(
        &self,
        positions: &[Vec3],
        triangles: &[[u32; 3]],
        place: &str,
        warnings: &mut Warnings,
    ) -> Outcome<Vec<Vec3>> {
        let Some(elements) = self.open(Semantic::Normals, 3..=3, &[F32, I8, I16])? else { return Ok(Vec::new()) };
        let mut normals = Vec::with_capacity(self.used.len());
        let mut broken = Vec::new();
        for (new, &old) in self.used.iter().enumerate() {
            let [x, y, z, _] = elements.floats(old as usize);
            let unit = unit(DVec3::new(x.into(), y.into(), z.into()));
            if unit.is_none() {
                broken.push(new);
            }
            normals.push(unit.unwrap_or(Vec3::Z));
        }
        if broken.len() == normals.len() {
            warnings.note("normals without direction are left out", place);
            return Ok(Vec::new());
        }
        if !broken.is_empty() {
            warnings.note("some normals without direction are replaced by those of their triangles", place);
            replace_normals(&mut normals, &broken, positions, triangles);
        }
        Ok(normals)
    }

    fn uvs(&self, set: u32, place: &str, warnings: &mut Warnings) -> Outcome<Vec<Vec2>> {
        let Some(elements) = self.open(Semantic::TexCoords(set), 2..=2, QUANTIZED)? else { return Ok(Vec::new()) };
        let mut finite = true;
        let uvs = self.used.iter().map(|&i| {
            let [u, v, ..] = elements.floats(i as usize);
            let uv = Vec2::new(u, v);
            finite &= uv.is_finite();
            if uv.is_finite() { uv } else { Vec2::ZERO }
        });
        let uvs = uvs.collect();
        if !finite {
            warnings.note("texture coordinates that are not finite are set to 0", place);
        }
        Ok(uvs)
    }

    fn tangents(&self, place: &str, warnings: &mut Warnings) -> Outcome<Option<Vec<Vec4>>> {
        let Some(elements) = self.open(Semantic::Tangents, 4..=4, &[F32, I8, I16])? else { return Ok(None) };
        let mut broken = false;
        let tangents = self.used.iter().map(|&i| {
            let [x, y, z, w] = elements.unit_floats(i as usize);
            let direction = unit(DVec3::new(x.into(), y.into(), z.into())).filter(|_| (w.abs() - 1.0).abs() < 0.01);
            broken |= direction.is_none();
            direction.map_or(Vec4::ZERO, |d| d.extend(w.signum()))
        });
        let tangents = tangents.collect();
        if broken {
            warnings.note("normal maps are left out at tangents without direction or sign", place);
        }
        Ok(Some(tangents))
    }

    fn colors(&self, place: &str, warnings: &mut Warnings) -> Outcome<Vec<Vec4>> {
        let Some(elements) = self.open(Semantic::Colors(0), 3..=4, COLOR)? else { return Ok(Vec::new()) };
        let mut clamped = false;
        let colors = self.used.iter().map(|&i| {
            let mut color = Vec4::from_array(elements.unit_floats(i as usize));
            if elements.width == 3 {
                color.w = 1.0;
            }
            let sane = if color.is_finite() { color.clamp(Vec4::ZERO, Vec4::ONE) } else { Vec4::ONE };
            clamped |= sane != color;
            sane
        });
        let colors = colors.collect();
        if clamped {
            warnings.note("vertex colours outside 0 to 1 are clamped", place);
        }
        Ok(colors)
    }

    fn open(
        &self,
        semantic: Semantic,
        widths: std::ops::RangeInclusive<usize>,
        components: &[ComponentType],
    ) -> Outcome<Option<Elements<'_>>> {
        let name = semantic.to_string();
        let elements = attribute(self.buffers, self.primitive, semantic, widths, components)?;
        match elements {
            Some(e) if e.count != self.count => {
                Err(Fault::Invalid(format!("{name} has {} elements for {} vertices", e.count, self.count)))
            }
            other => Ok(other),
        }
    }
}

fn attribute<'a>(
    buffers: &'a Buffers,
    primitive: &Primitive,
    semantic: Semantic,
    widths: std::ops::RangeInclusive<usize>,
    components: &[ComponentType],
) -> Outcome<Option<Elements<'a>>> {
    let name = semantic.to_string();
    let Some(index) = primitive.attributes.get(&Checked::Valid(semantic)) else { return Ok(None) };
    let elements = Elements::open(buffers, index.value()).within(|| name.clone())?;
    if !widths.contains(&elements.width) || !components.contains(&elements.component) {
        return Err(Fault::Invalid(format!(
            "{name}: accessor {index} holds {:?} x {}, which it cannot be",
            elements.component, elements.width
        )));
    }
    Ok(Some(elements))
}

fn too_many() -> Fault {
    Fault::Invalid(format!("the file has more than {MAX_TRIANGLES} triangles"))
}

/// Triangles from corners in the order of section 3.7.2.1 of glTF 2.0. Strips and fans lose triangles that name a
/// vertex twice, which is how they make jumps.
fn assemble(mode: Mode, corners: &[u32]) -> Outcome<Vec<[u32; 3]>> {
    let has_area = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    match mode {
        Mode::TriangleStrip => {
            let turned = |(i, w): (usize, &[u32])| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] };
            Ok(corners.windows(3).enumerate().map(turned).filter(has_area).collect())
        }
        Mode::TriangleFan => {
            let hub = corners.first().copied().unwrap_or_default();
            let rim = corners.get(1..).unwrap_or_default();
            Ok(rim.windows(2).map(|w| [w[0], w[1], hub]).filter(has_area).collect())
        }
        _ => {
            let (triangles, rest) = corners.as_chunks::<3>();
            if !rest.is_empty() {
                return Err(Fault::Invalid(format!("{} corners do not make whole triangles", corners.len())));
            }
            Ok(triangles.to_vec())
        }
    }
}

/// Renumbers the triangles' vertices without gaps; returns the old number of each, rising.
fn compact(triangles: &mut [[u32; 3]], vertex_count: usize) -> Vec<u32> {
    // One more than the new number, 0 where unused: pages that no triangle touches cost nothing.
    let mut successor = vec![0u32; vertex_count];
    let mut used = Vec::new();
    for &v in triangles.as_flattened() {
        if std::mem::replace(&mut successor[v as usize], 1) == 0 {
            used.push(v);
        }
    }
    used.sort_unstable();
    for (new, &old) in used.iter().enumerate() {
        successor[old as usize] = new as u32 + 1;
    }
    for v in triangles.as_flattened_mut() {
        *v = successor[*v as usize] - 1;
    }
    used
}

fn unit(v: DVec3) -> Option<Vec3> {
    v.try_normalize().map(DVec3::as_vec3)
}

/// Gives each `broken` vertex the area-weighted normal of its triangles.
fn replace_normals(normals: &mut [Vec3], broken: &[usize], positions: &[Vec3], triangles: &[[u32; 3]]) {
    let mut sums = vec![DVec3::ZERO; broken.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|v| positions[v as usize].as_dvec3());
        let weighted = (b - a).cross(c - a);
        for v in triangle {
            if let Ok(at) = broken.binary_search(&(*v as usize)) {
                sums[at] += weighted;
            }
        }
    }
    for (&vertex, &sum) in broken.iter().zip(&sums) {
        normals[vertex] = unit(sum).unwrap_or(Vec3::Z);
    }
}
