//! Turns mesh primitives into [`Mesh`]es, each once however often it is placed.

use std::ops::Range;

use ::gltf::json::accessor::ComponentType::{self, F32, I8, I16, U8, U16, U32};
use ::gltf::json::mesh::{Mode, MorphTarget, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{DVec3, Vec2, Vec3, Vec4};

use super::accessor::Elements;
use super::buffers::Buffers;
use super::fault::{Fault, Outcome, Warnings, Within, label, lookup};
use super::topology::{assemble, compact, corners};
use super::{morphs, skins, tangents};
use crate::scene::motion::Influence;
use crate::scene::{Material, Mesh};

/// More triangles than this, before instancing, are taken for a damaged or hostile file.
const MAX_TRIANGLES: usize = 1 << 27;

const QUANTIZED: &[ComponentType] = &[F32, I8, U8, I16, U16];
const COLOR: &[ComponentType] = &[F32, U8, U16];
const INDEX: &[ComponentType] = &[U8, U16, U32];

/// What a corner takes while triangles are made, with their list as it grows, and a vertex of the file, bytes.
const CORNER_BYTES: u64 = 40;
const VERTEX_BYTES: u64 = 16;

/// What a mesh needs besides its shape.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wanted {
    pub influences: bool,
    pub morphs: bool,
}

/// The meshes read so far.
pub struct Geometry<'a, 'b> {
    buffers: &'a Buffers<'b>,
    /// Those of the file; they say which meshes need tangents.
    materials: &'a [Material],
    /// Per glTF mesh.
    wanted: &'a [Wanted],
    meshes: Vec<Mesh>,
    /// Per glTF mesh, once read, where its primitives are in `meshes`.
    ranges: Vec<Option<Range<usize>>>,
    triangles_left: usize,
}

impl<'a, 'b> Geometry<'a, 'b> {
    pub fn new(buffers: &'a Buffers<'b>, materials: &'a [Material], wanted: &'a [Wanted]) -> Self {
        let ranges = vec![None; buffers.root.meshes.len()];
        Self { buffers, materials, wanted, meshes: Vec::new(), ranges, triangles_left: MAX_TRIANGLES }
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
            let wanted = self.wanted.get(index).copied().unwrap_or_default();
            let read = self.read(primitive, wanted, &place, warnings).within(|| place.clone())?;
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

    fn read(
        &mut self,
        primitive: &Primitive,
        wanted: Wanted,
        place: &str,
        warnings: &mut Warnings,
    ) -> Outcome<Option<Mesh>> {
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
        let vertices = Vertices { buffers: self.buffers, primitive, used: &used, count: positions.count, wanted };
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

/// Attributes of one primitive, gathered for the vertices in use.
pub struct Vertices<'a, 'b> {
    pub buffers: &'a Buffers<'b>,
    primitive: &'a Primitive,
    /// Their numbers in the file, rising.
    pub used: &'a [u32],
    /// Vertices in the file.
    pub count: usize,
    wanted: Wanted,
}

impl Vertices<'_, '_> {
    /// The morph targets that are wanted.
    fn targets(&self) -> &[MorphTarget] {
        self.primitive.targets.as_deref().filter(|_| self.wanted.morphs).unwrap_or_default()
    }

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
        let still: usize = attributes.iter().filter(|(is_there, _)| *is_there).map(|(_, bytes)| bytes).sum();
        let influence = if self.wanted.influences { size_of::<Influence>() } else { 0 };
        let made = mapped && !(has(Semantic::Tangents) && has(Semantic::Normals));
        // Tangents of each target; while they are made, also positions and normals of one, and derivatives of two.
        let targets = self.targets().len();
        let made_of_targets = if made && targets > 0 { (targets + 4) * size_of::<Vec3>() } else { 0 };
        let moved = influence + morphs::bytes_per_vertex(self.targets()) + made_of_targets;
        let per_triangle = size_of::<[u32; 3]>() + if made { tangents::BYTES_PER_TRIANGLE + 6 * moved } else { 0 };
        (self.used.len() * (still + moved) + triangles * per_triangle) as u64
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

    /// The elements of an attribute, one for each vertex of the file.
    pub fn open(
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
