//! Materials: glTF's metallic-roughness model and its textures.

use std::sync::Arc;

use ::gltf::json::extensions::material::Material as JsonExtensions;
use ::gltf::json::material::{AlphaMode as JsonAlphaMode, Material as JsonMaterial, NormalTexture};
use ::gltf::json::texture::Info;
use ::gltf::json::validation::Checked;
use glam::{Vec3, Vec4};
use serde_json::Value;

use super::buffers::Buffers;
use super::fault::{Fault, Outcome, Warnings, Within, label};
use super::textures::TextureTable;
use crate::scene::{AlphaMode, Material, NormalMap, TexelImage, Texture, TextureRef};

/// Materials in the file's order, with their textures and images.
pub struct Surfaces {
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    pub images: Vec<Arc<TexelImage>>,
}

pub fn read(buffers: &Buffers, warnings: &mut Warnings) -> Outcome<Surfaces> {
    let mut table = TextureTable::new(buffers);
    let mut materials = Vec::with_capacity(buffers.root.materials.len() + 1);
    for (index, json) in buffers.root.materials.iter().enumerate() {
        let place = label("material", index, &json.name);
        let material = Reader { table: &mut table, warnings, place: &place }.read(json);
        materials.push(material.within(|| place.clone())?);
    }
    let TextureTable { textures, images, .. } = table;
    Ok(Surfaces { materials, textures, images })
}

/// Converts one glTF material, adds its textures to the table and collects warnings.
pub(super) struct Reader<'r, 'a, 'b> {
    pub table: &'r mut TextureTable<'a, 'b>,
    pub warnings: &'r mut Warnings,
    pub place: &'r str,
}

impl Reader<'_, '_, '_> {
    fn read(&mut self, json: &JsonMaterial) -> Outcome<Material> {
        let none = JsonExtensions::default();
        let extensions = json.extensions.as_ref().unwrap_or(&none);
        let mut material = self.coverage(json)?;
        if extensions.unlit.is_some() {
            // The extension overrides all other properties.
            material.unlit = true;
            return Ok(material);
        }
        material.specular = 1.0;
        if extensions.pbr_specular_glossiness.is_none() {
            self.metallic_roughness(json, &mut material)?;
        }
        self.normal_and_emission(json, extensions, &mut material)?;
        self.extensions(extensions, &mut material)?;
        Ok(material)
    }

    /// Reads the properties that lit and unlit materials share: name, base colour, alpha and sidedness.
    fn coverage(&mut self, json: &JsonMaterial) -> Outcome<Material> {
        let pbr = &json.pbr_metallic_roughness;
        Ok(Material {
            name: json.name.clone().unwrap_or_default(),
            base_color: self.clamp(Vec4::from_array(pbr.base_color_factor.0), 1.0, "base colour")?,
            base_color_texture: self.texture(pbr.base_color_texture.as_ref())?,
            alpha_mode: self.alpha_mode(json)?,
            double_sided: json.double_sided,
            ..Material::default()
        })
    }

    /// Reads how alpha is used. A mode that glTF does not know counts as OPAQUE, with a warning.
    fn alpha_mode(&mut self, json: &JsonMaterial) -> Outcome<AlphaMode> {
        match json.alpha_mode {
            Checked::Valid(JsonAlphaMode::Opaque) => Ok(AlphaMode::Opaque),
            Checked::Valid(JsonAlphaMode::Blend) => Ok(AlphaMode::Blend),
            Checked::Valid(JsonAlphaMode::Mask) => {
                let cutoff = json.alpha_cutoff.unwrap_or_default().0;
                if cutoff.is_finite() && cutoff >= 0.0 {
                    Ok(AlphaMode::Mask { cutoff })
                } else {
                    Err(Fault::Invalid(format!("its alphaCutoff {cutoff} is negative or not finite")))
                }
            }
            Checked::Invalid => {
                self.warnings
                    .note("materials whose alphaMode is none of OPAQUE, MASK and BLEND are opaque", self.place);
                Ok(AlphaMode::Opaque)
            }
        }
    }

    fn metallic_roughness(&mut self, json: &JsonMaterial, material: &mut Material) -> Outcome<()> {
        let pbr = &json.pbr_metallic_roughness;
        material.metallic = self.unit(pbr.metallic_factor.0, "metalness")?;
        material.roughness = self.unit(pbr.roughness_factor.0, "roughness")?;
        let info = pbr.metallic_roughness_texture.as_ref();
        material.metallic_roughness_texture = self.texture(info)?;
        if info.is_some() && material.metallic_roughness_texture.is_none() {
            // A texture may make parts non-metallic, so without it nothing is metallic.
            material.metallic = 0.0;
        }
        Ok(())
    }

    fn normal_and_emission(
        &mut self,
        json: &JsonMaterial,
        extensions: &JsonExtensions,
        material: &mut Material,
    ) -> Outcome<()> {
        material.normal_map = self.normal_map(json.normal_texture.as_ref())?;
        if json.occlusion_texture.is_some() {
            self.warnings.note("occlusion maps are left out: path tracing finds occlusion itself", self.place);
        }
        let strength = extensions.emissive_strength.as_ref().map_or(1.0, |s| s.emissive_strength.0);
        let emissive = json.emissive_factor.0.map(|c| c * strength);
        material.emissive = self.color(emissive, f32::MAX, "emission")?;
        material.emissive_texture = self.texture(json.emissive_texture.as_ref())?;
        if json.emissive_texture.is_some() && material.emissive_texture.is_none() {
            // Without its texture, the parts that the texture keeps dark would emit.
            material.emissive = Vec3::ZERO;
        }
        Ok(())
    }

    /// Returns the texture reference; `None` if there is none or, with a warning, if it cannot be used.
    pub fn texture(&mut self, info: Option<&Info>) -> Outcome<Option<TextureRef>> {
        info.map_or(Ok(None), |info| self.table.refer(info, self.place, self.warnings))
    }

    pub fn normal_map(&mut self, json: Option<&NormalTexture>) -> Outcome<Option<NormalMap>> {
        let Some(json) = json else { return Ok(None) };
        if !json.scale.is_finite() {
            return Err(Fault::Invalid("the scale of its normal map is not finite".into()));
        }
        let info = info_of(json)?;
        Ok(self.texture(Some(&info))?.map(|texture| NormalMap { texture, scale: json.scale }))
    }

    /// Clamps a factor to 0 … 1. Warns if that changes it.
    pub fn unit(&mut self, value: f32, what: &str) -> Outcome<f32> {
        Ok(self.clamp(Vec4::splat(value), 1.0, what)?.x)
    }

    /// Clamps a colour's channels to 0 … `max`. Warns if that changes them.
    pub fn color(&mut self, value: [f32; 3], max: f32, what: &str) -> Outcome<Vec3> {
        Ok(self.clamp(Vec3::from_array(value).extend(0.0), max, what)?.truncate())
    }

    /// Clamps a factor's components to 0 … `max`. Warns if that changes them.
    pub fn clamp(&mut self, value: Vec4, max: f32, what: &str) -> Outcome<Vec4> {
        if !value.is_finite() {
            return Err(Fault::Invalid(format!("its {what} is not finite")));
        }
        let clamped = value.clamp(Vec4::ZERO, Vec4::splat(max));
        if clamped != value {
            self.warnings.note(&format!("{what} factors out of range are clamped"), self.place);
        }
        Ok(clamped)
    }
}

/// Converts a normal map's texture reference, whose extensions the parser does not read.
fn info_of(json: &NormalTexture) -> Outcome<Info> {
    let parse = |others: &serde_json::Map<String, Value>| serde_json::from_value(Value::Object(others.clone()));
    let extensions = json.extensions.as_ref().map(|e| parse(&e.others)).transpose();
    let extensions = extensions.map_err(|e| Fault::Invalid(format!("the extensions of its normal map: {e}")))?;
    Ok(Info { index: json.index, tex_coord: json.tex_coord, extensions, extras: Default::default() })
}
