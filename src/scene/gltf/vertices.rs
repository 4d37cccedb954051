//! Vertex attributes of a primitive.

use ::gltf::json::accessor::ComponentType::{self, F32, I8, I16, U8, U16};
use ::gltf::json::mesh::{MorphTarget, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{DVec3, Vec2, Vec3, Vec4};

use super::accessor::Elements;
use super::buffers::Buffers;
use super::draco::Decoded;
use super::fault::{Fault, Outcome, Warnings, Within};

pub const QUANTIZED: &[ComponentType] = &[F32, I8, U8, I16, U16];
const COLOR: &[ComponentType] = &[F32, U8, U16];

/// Motion data to read besides a mesh's shape: skinning influences and morph targets.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wanted {
    pub influences: bool,
    pub morphs: bool,
}

/// Attributes of one primitive, gathered for the vertices in use.
pub struct Vertices<'a, 'b> {
    pub buffers: &'a Buffers<'b>,
    pub decoded: &'a Decoded<'b>,
    pub primitive: &'a Primitive,
    /// Indices, in the file, of the vertices that triangles use, in increasing order.
    pub used: &'a [u32],
    /// Number of the primitive's vertices in the file, used or not.
    pub count: usize,
    pub wanted: Wanted,
}

impl Vertices<'_, '_> {
    /// Returns the primitive's morph targets; none if they are not wanted.
    pub fn targets(&self) -> &[MorphTarget] {
        self.primitive.targets.as_deref().filter(|_| self.wanted.morphs).unwrap_or_default()
    }

    pub fn positions(&self, elements: &Elements) -> Outcome<Vec<Vec3>> {
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

    pub fn normals(
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

    pub fn uvs(&self, set: u32, place: &str, warnings: &mut Warnings) -> Outcome<Vec<Vec2>> {
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

    pub fn tangents(&self, place: &str, warnings: &mut Warnings) -> Outcome<Option<Vec<Vec4>>> {
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

    pub fn colors(&self, place: &str, warnings: &mut Warnings) -> Outcome<Vec<Vec4>> {
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

    /// Opens an attribute and checks that it has one element per vertex of the file.
    pub fn open(
        &self,
        semantic: Semantic,
        widths: std::ops::RangeInclusive<usize>,
        components: &[ComponentType],
    ) -> Outcome<Option<Elements<'_>>> {
        let name = semantic.to_string();
        let elements = attribute(self.buffers, self.decoded, self.primitive, semantic, widths, components)?;
        match elements {
            Some(e) if e.count != self.count => {
                Err(Fault::Invalid(format!("{name} has {} elements for {} vertices", e.count, self.count)))
            }
            other => Ok(other),
        }
    }
}

pub fn attribute<'a>(
    buffers: &'a Buffers,
    decoded: &'a Decoded,
    primitive: &Primitive,
    semantic: Semantic,
    widths: std::ops::RangeInclusive<usize>,
    components: &[ComponentType],
) -> Outcome<Option<Elements<'a>>> {
    let name = semantic.to_string();
    let Some(index) = primitive.attributes.get(&Checked::Valid(semantic)) else { return Ok(None) };
    let elements =
        Elements::open_decoded(buffers, index.value(), decoded.elements(index.value())).within(|| name.clone())?;
    if !widths.contains(&elements.width) || !components.contains(&elements.component) {
        return Err(Fault::Invalid(format!(
            "{name}: accessor {index} holds {:?} x {}, which is not allowed here",
            elements.component, elements.width
        )));
    }
    Ok(Some(elements))
}

/// Returns the direction of a vector; `None` if it has none. A vector that has unit length in single precision keeps its
/// bits, so that an exported scene is read back as it was.
fn unit(v: DVec3) -> Option<Vec3> {
    let is_unit = (v.length_squared() - 1.0).abs() < 4.0 * f64::from(f32::EPSILON);
    if is_unit { Some(v.as_vec3()) } else { v.try_normalize().map(DVec3::as_vec3) }
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
