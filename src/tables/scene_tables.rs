//! The tables of a scene, built once.

use std::borrow::Cow;
use std::hash::{DefaultHasher, Hasher};
use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3, Vec4};

use super::moves::Moves;
use crate::accel;
use crate::accel::Accel;
use crate::graph::Resource;
use crate::image::Extent;
use crate::layout::{
    self, ALPHA_BLEND, ALPHA_MASK, BASE_COLOR_TEXTURE, CLEAR_GLASS, CLEARCOAT_NORMAL_MAP, DOUBLE_SIDED,
    EMISSIVE_TEXTURE, MIRROR, NORMAL_MAP, POLISHED, ROLE_SHIFT, TEXTURE_LINEAR, TEXTURE_SECOND_UVS, TEXTURE_SRGB,
    THICK, TextureInfo, TextureRole, UNLIT, WRAP_CLAMP, WRAP_MIRROR, WRAP_REPEAT, WRAP_U_SHIFT, WRAP_V_SHIFT,
};
use crate::passes::Moving;
use crate::scene::budget::{Budget, Exceeded};
use crate::scene::{self, AlphaMode, Environment, Scene, TexelImage, Wrap};
use crate::tables::albedo_table;
use crate::tables::color::linear_from_srgb;
use crate::tables::emitters::{self, Emitters, Sources};
use crate::wgsl::ROW_BYTES;

#[derive(Debug, thiserror::Error)]
pub enum TableError {
    #[error("the scene's light tables do not fit into memory: {0}")]
    Memory(Exceeded),
    #[error("the scene's textures hold {0} texels, more than the 2^32 that can be addressed: make them smaller")]
    Texels(u64),
}

/// Tables of one scene, the same for every device.
pub struct SceneTables {
    pub(super) accel: Accel,
    pub(super) sources: Sources,
    /// First row of the instances (`instances`), and of the map from triangle numbers to instances (`numbers`).
    pub(super) instances: u32,
    pub(super) numbers: u32,
    pub(super) moving: Option<Moves>,
    pub(super) first_rows: layout::Tables,
    has_surfaces: bool,
    pub(super) materials: Vec<layout::Material>,
    textures: Vec<TextureInfo>,
    pub(super) images: Vec<Arc<TexelImage>>,
    pub(super) emitters: Emitters,
    pub(super) environment: Environment,
}

impl SceneTables {
    /// Builds the tables of a scene without a memory limit.
    ///
    /// # Errors
    /// [`TableError::Texels`] if the scene's textures have too many texels.
    pub fn new(scene: &Scene, accel: Accel) -> Result<Self, TableError> {
        Self::within(scene, accel, &Budget::unlimited())
    }

    /// Builds the tables of a scene within a memory budget.
    ///
    /// # Errors
    /// The errors of [`Self::new`], and [`TableError::Memory`] if the light tables would exceed the budget.
    pub fn within(scene: &Scene, mut accel: Accel, budget: &Budget) -> Result<Self, TableError> {
        let _reserved = budget.reserve(emitters::making_bytes(scene, &accel)).map_err(TableError::Memory)?;
        let has_surfaces = accel.nodes.len() > 1 || accel.nodes[0] != [0; 20];
        let sources = Sources::new(scene, &accel);
        let emitters = Emitters::new(scene, &sources, &mut accel);
        accel.know_lights();
        let instances = emitters::rows(&accel.nodes);
        emitters::append(&mut accel.nodes, bytemuck::cast_slice(&accel.instances));
        // Reserve rows for the maximum number of moving instances.
        let count = if accel.moves() { accel.most_instances() } else { accel.instances.len() };
        let end = instances as usize + count * size_of::<accel::Instance>() / ROW_BYTES;
        let nodes = (end * ROW_BYTES).div_ceil(size_of::<accel::Node>());
        accel.nodes.resize(accel.nodes.len().max(nodes), Default::default());
        let numbers = emitters::rows(&accel.nodes);
        let mut rows = accel.numbers.clone();
        rows.resize(count, [u32::MAX; 4]);
        emitters::append(&mut accel.nodes, rows.as_flattened());
        let mut firsts = Vec::with_capacity(scene.images.len());
        let mut texels = 0;
        for image in &scene.images {
            firsts.push(texels);
            texels += image.pixels.len() as u64;
        }
        if texels > u64::from(u32::MAX) {
            return Err(TableError::Texels(texels));
        }
        let firsts = firsts.into_iter().map(|first| first as u32).collect();
        let mut table = TextureTable { scene, firsts, infos: Vec::new() };
        let materials: Vec<_> = scene.materials.iter().map(|m| table.material(m)).collect();
        let textures = table.infos;
        let (images, environment) = (scene.images.clone(), scene.environment.clone());
        let first_rows = layout::Tables::default();
        let mut tables = Self {
            accel,
            sources,
            instances,
            numbers,
            moving: Moves::of(scene),
            first_rows,
            has_surfaces,
            materials,
            textures,
            images,
            emitters,
            environment,
        };
        tables.first_rows = tables.in_order().0;
        Ok(tables)
    }

    /// Returns the first row of each table, and the bytes of all tables in order.
    pub(super) fn in_order(&self) -> (layout::Tables, Vec<Cow<'_, [u8]>>) {
        let Self { accel, emitters, .. } = self;
        let mut parts: Vec<Cow<'_, [u8]>> = Vec::new();
        let mut rows = 0;
        let mut add = |bytes| {
            let bytes: Cow<'_, [u8]> = bytes;
            let first = if bytes.is_empty() { 0 } else { rows };
            rows += (bytes.len() / ROW_BYTES) as u32;
            parts.push(bytes);
            first
        };
        add(bytes_of(&accel.nodes));
        let tables = layout::Tables {
            triangles: add(bytes_of(&accel.triangles)),
            shadings: add(bytes_of(&accel.shadings)),
            vertex_colors: add(bytes_of(&accel.colors)),
            second_uvs: add(collected(accel.second_uvs.chunks_exact(3).map(second_uvs))),
            tangents: add(bytes_of(&accel.tangents)),
            materials: add(bytes_of(&self.materials)),
            textures: add(bytes_of(&self.textures)),
            lights: add(bytes_of(&emitters.lights)),
            env_cells: add(bytes_of(&emitters.env_cells)),
            srgb: add(collected((0..=255).map(|code| [linear_from_srgb(code), 0.0, 0.0, 0.0]))),
            albedo: add(collected(albedo_table::table().iter().map(|[x, y, z]| [*x, *y, *z, 0.0]))),
            last_corners: add(Cow::Owned(vec![0; 3 * ROW_BYTES * accel.skins.triangles.len()])),
        };
        (tables, parts)
    }

    /// Returns a hash of all scene data that shaders read, to tell scenes apart.
    pub fn fingerprint(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.in_order().1.iter().for_each(|part| hasher.write(part));
        self.images.iter().for_each(|image| hasher.write(bytemuck::cast_slice(&image.pixels)));
        if let Environment::Map { image, .. } = &self.environment {
            hasher.write(bytemuck::cast_slice(&image.pixels));
        }
        let skins = &self.accel.skins;
        hasher.write(bytemuck::cast_slice(&skins.triangles));
        hasher.write(bytemuck::cast_slice(&skins.vertices));
        hasher.write(bytemuck::cast_slice(&skins.morphs));
        hasher.finish()
    }

    /// Fills in the constants of a frame that depend on the scene.
    pub fn describe(&self, frame: &mut layout::Frame) {
        frame.geometry = layout::Geometry {
            world_origin: self.accel.origin.as_vec3(),
            instance_tree: self.accel.instance_tree,
            instances: self.instances,
            instance_count: self.accel.instances.len() as u32,
            instance_numbers: self.numbers,
            first_deforming: self.accel.skins.first_row,
            deforming_count: self.accel.skins.triangles.len() as u32,
            ..Default::default()
        };
        frame.tables = self.first_rows;
        frame.lights = self.emitters.constants;
        frame.environment = self.describe_environment();
    }

    fn describe_environment(&self) -> layout::Environment {
        let [grid_width, grid_height] = self.emitters.env_size;
        let grid = layout::Environment { grid_width, grid_height, ..Default::default() };
        match &self.environment {
            Environment::Black => grid,
            Environment::Constant(radiance) => layout::Environment { radiance: *radiance, ..grid },
            Environment::Map { image, rotation_deg } => {
                let Extent { width, height } = image.extent;
                layout::Environment { rotation: rotation_deg / 360.0, width, height, ..grid }
            }
        }
    }

    /// Returns the world-space position of the point to which positions in the tables are relative.
    pub fn origin(&self) -> DVec3 {
        self.accel.origin
    }

    /// Returns a lower bound of the distance from a point, relative to [`Self::origin`], to the nearest triangle.
    pub fn clearance(&self, point: Vec3) -> f32 {
        self.accel.clearance(point)
    }

    /// True if rays traverse other instances besides the one that holds the flattened static triangles.
    pub fn has_instances(&self) -> bool {
        self.accel.most_instances() > 1
    }

    /// Returns the dynamic geometry that passes depend on; `None` for a static scene.
    pub fn moving(&self) -> Option<Moving> {
        let moving = Moving { bodies: self.accel.moves(), ..Moving::of(&self.accel.skins) };
        self.moving.as_ref().map(|_| moving)
    }

    /// Returns the inputs of the motion passes, with their contents.
    pub(crate) fn skin_inputs(&self) -> [(Resource, &[u8]); 5] {
        let skins = &self.accel.skins;
        let bytes: [&[u8]; 5] = [
            bytemuck::cast_slice(&skins.triangles),
            bytemuck::cast_slice(&skins.vertices),
            bytemuck::cast_slice(&skins.morphs),
            bytemuck::cast_slice(&skins.nodes),
            bytemuck::cast_slice(&skins.order),
        ];
        let inputs = Moving::of(skins).inputs();
        std::array::from_fn(|i| (inputs[i], bytes[i]))
    }

    /// Whether the scene has surfaces that could reflect light.
    pub fn has_surfaces(&self) -> bool {
        self.has_surfaces
    }
}

pub(super) fn bytes_of<T: bytemuck::Pod>(table: &[T]) -> Cow<'_, [u8]> {
    Cow::Borrowed(bytemuck::cast_slice(table))
}

fn collected<T: bytemuck::Pod>(entries: impl Iterator<Item = T>) -> Cow<'static, [u8]> {
    Cow::Owned(bytemuck::cast_slice(&entries.collect::<Vec<T>>()).to_vec())
}

fn second_uvs(corners: &[[f32; 2]]) -> layout::SecondUvs {
    let [uv0, uv1, uv2] = std::array::from_fn(|i| Vec2::from(corners[i]));
    layout::SecondUvs { uv0, uv1, uv2, pad: Vec2::ZERO }
}

/// The texture table: each material's textures, one after another.
struct TextureTable<'a> {
    scene: &'a Scene,
    /// First texel of each image.
    firsts: Vec<u32>,
    infos: Vec<TextureInfo>,
}

impl TextureTable<'_> {
    fn info(&self, r: &scene::TextureRef, role: TextureRole) -> TextureInfo {
        let wrap = |w| match w {
            Wrap::Repeat => WRAP_REPEAT,
            Wrap::MirroredRepeat => WRAP_MIRROR,
            Wrap::ClampToEdge => WRAP_CLAMP,
        };
        let texture = &self.scene.textures[r.texture];
        let Extent { width, height } = self.scene.images[texture.image].extent;
        let wraps = wrap(texture.wrap_u) << WRAP_U_SHIFT | wrap(texture.wrap_v) << WRAP_V_SHIFT;
        let flags =
            [(texture.linear, TEXTURE_LINEAR), (r.uv_set == 1, TEXTURE_SECOND_UVS), (role.is_color(), TEXTURE_SRGB)];
        let m = r.uv_from_uv.matrix2;
        TextureInfo {
            first: self.firsts[texture.image],
            width,
            height,
            flags: all_set(&flags) | wraps | (role as u32) << ROLE_SHIFT,
            uv_matrix: Vec4::new(m.x_axis.x, m.y_axis.x, m.x_axis.y, m.y_axis.y),
            uv_offset: r.uv_from_uv.translation,
            ..Default::default()
        }
    }

    fn material(&mut self, m: &scene::Material) -> layout::Material {
        let (alpha, alpha_cutoff) = match m.alpha_mode {
            AlphaMode::Opaque => (0, 0.0),
            AlphaMode::Mask { cutoff } => (ALPHA_MASK, cutoff),
            AlphaMode::Blend => (ALPHA_BLEND, 0.0),
        };
        let flags = [
            (m.double_sided, DOUBLE_SIDED),
            (m.enclosed_volume().is_some(), THICK),
            (m.unlit, UNLIT),
            (m.base_color_texture.is_some(), BASE_COLOR_TEXTURE),
            (m.emissive_texture.is_some(), EMISSIVE_TEXTURE),
            (m.normal_map.is_some(), NORMAL_MAP),
            (m.clearcoat.normal_map.is_some(), CLEARCOAT_NORMAL_MAP),
            (m.is_mirror(), MIRROR),
            (m.is_clear_glass(), CLEAR_GLASS),
            (m.is_polished(), POLISHED),
        ];
        let first_texture = self.infos.len() as u32;
        for (texture, role) in textures_in_order(m) {
            self.infos.push(self.info(&texture, role));
        }
        let scale = |map: Option<scene::NormalMap>| map.map_or(1.0, |map| map.scale);
        layout::Material {
            base_color: m.base_color,
            emissive: m.emissive,
            roughness: m.roughness,
            metallic: m.metallic,
            alpha_cutoff,
            flags: alpha | all_set(&flags),
            ior: m.ior,
            specular: m.specular,
            transmission: m.transmission,
            clearcoat: m.clearcoat.factor,
            specular_color: m.specular_color,
            clearcoat_roughness: m.clearcoat.roughness,
            absorption: m.enclosed_volume().map_or(Vec3::ZERO, absorption),
            normal_scale: scale(m.normal_map),
            clearcoat_normal_scale: scale(m.clearcoat.normal_map),
            sheen_color: m.sheen.color,
            sheen_roughness: m.sheen.roughness,
            iridescence: m.iridescence.factor,
            film_ior: m.iridescence.ior,
            film_thickness: m.iridescence.thickness_nm.into(),
            anisotropy: m.anisotropy.strength,
            anisotropy_direction: Vec2::from_angle(m.anisotropy.rotation),
            dispersion: m.dispersed_ior(),
            diffuse_transmission: m.diffuse_transmission.factor,
            diffuse_transmission_color: m.diffuse_transmission.color,
            first_texture,
            texture_count: self.infos.len() as u32 - first_texture,
            ..Default::default()
        }
    }
}

/// Combines the bits whose flags are set.
fn all_set(flags: &[(bool, u32)]) -> u32 {
    flags.iter().filter(|(is_set, _)| *is_set).fold(0, |all, (_, bit)| all | bit)
}

/// Lists a material's textures with their roles. Base colour and emission come first, since shaders also look them up
/// separately.
fn textures_in_order(m: &scene::Material) -> impl Iterator<Item = (scene::TextureRef, TextureRole)> {
    use TextureRole::*;
    let map = |map: Option<scene::NormalMap>| map.map(|map| map.texture);
    let all = [
        (m.base_color_texture, BaseColor),
        (m.emissive_texture, Emissive),
        (m.metallic_roughness_texture, MetallicRoughness),
        (map(m.normal_map), Normal),
        (m.specular_texture, Specular),
        (m.specular_color_texture, SpecularColor),
        (m.transmission_texture, Transmission),
        (m.clearcoat.factor_texture, Clearcoat),
        (m.clearcoat.roughness_texture, ClearcoatRoughness),
        (map(m.clearcoat.normal_map), ClearcoatNormal),
        (m.sheen.color_texture, SheenColor),
        (m.sheen.roughness_texture, SheenRoughness),
        (m.diffuse_transmission.factor_texture, DiffuseTransmission),
        (m.diffuse_transmission.color_texture, DiffuseTransmissionColor),
        (m.iridescence.factor_texture, Iridescence),
        (m.iridescence.thickness_texture, FilmThickness),
        (m.anisotropy.texture, Anisotropy),
    ];
    all.into_iter().filter_map(|(texture, role)| Some((texture?, role)))
}

/// Returns the absorption coefficient per scene unit, from `KHR_materials_volume` by the Beer–Lambert law. A colour of
/// 0 is raised slightly, so that the coefficient stays finite.
fn absorption(volume: scene::Volume) -> Vec3 {
    let color = volume.attenuation_color.clamp(Vec3::splat(1e-30), Vec3::ONE);
    -color.map(f32::ln) / volume.attenuation_distance.max(1e-30)
}
