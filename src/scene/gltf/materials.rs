//! Materials, with the textures they refer to.

use std::path::Path;

use ::gltf::json::material::{AlphaMode as JsonAlphaMode, Material as JsonMaterial, PbrMetallicRoughness};
use ::gltf::json::validation::Checked;
use glam::{Vec3, Vec4};

use super::buffers::Buffers;
use super::fault::{Fault, Outcome, Warnings, Within, label};
use super::textures::TextureTable;
use crate::scene::{AlphaMode, Material, TexelImage, Texture};

/// What surfaces look like. The materials stand in the file's order, the default material last where it is used.
pub struct Surfaces {
    pub materials: Vec<Material>,
    pub textures: Vec<Texture>,
    pub images: Vec<TexelImage>,
}

pub fn read(buffers: &Buffers, base: &Path, with_default: bool, warnings: &mut Warnings) -> Outcome<Surfaces> {
    let mut table = TextureTable::new(buffers, base);
    let mut materials = Vec::with_capacity(buffers.root.materials.len() + 1);
    for (index, json) in buffers.root.materials.iter().enumerate() {
        let place = label("material", index, &json.name);
        let material = Reader { table: &mut table, warnings, place: &place }.read(json);
        materials.push(material.within(|| place.clone())?);
    }
    if with_default || materials.is_empty() {
        materials.push(Material::default());
    }
    let TextureTable { textures, images, .. } = table;
    Ok(Surfaces { materials, textures, images })
}

struct Reader<'r, 'a> {
    table: &'r mut TextureTable<'a>,
    warnings: &'r mut Warnings,
    place: &'r str,
}

impl Reader<'_, '_> {
    fn read(&mut self, json: &JsonMaterial) -> Outcome<Material> {
        let mut material = self.base(json)?;
        material.name = json.name.clone().unwrap_or_default();
        material.alpha_mode = alpha_mode(json)?;
        material.double_sided = json.double_sided;
        let strength = json.extensions.as_ref().and_then(|e| e.emissive_strength.as_ref());
        let emissive = Vec3::from_array(json.emissive_factor.0) * strength.map_or(1.0, |s| s.emissive_strength.0);
        material.emissive = self.clamp(emissive.extend(0.0), f32::MAX, "emission")?.truncate();
        if let Some(info) = &json.emissive_texture {
            material.emissive_texture = self.table.refer(info, self.place, self.warnings)?;
            // Without its texture, everything that the texture keeps dark would shine.
            if material.emissive_texture.is_none() {
                material.emissive = Vec3::ZERO;
            }
        }
        if json.normal_texture.is_some() {
            self.warnings.note("normal maps are left out", self.place);
        }
        if json.occlusion_texture.is_some() {
            self.warnings.note("occlusion maps are left out", self.place);
        }
        Ok(material)
    }

    /// Base colour, metalness and roughness.
    fn base(&mut self, json: &JsonMaterial) -> Outcome<Material> {
        let pbr = &json.pbr_metallic_roughness;
        let extensions = json.extensions.as_ref();
        if let Some(specular) = extensions.and_then(|e| e.pbr_specular_glossiness.as_ref()) {
            self.warnings.note("KHR_materials_pbrSpecularGlossiness is only approximated", self.place);
            if is_unset(pbr) {
                let base_color = Vec4::from_array(specular.diffuse_factor.0);
                let gloss = specular.glossiness_factor.0;
                return self.surface(base_color, specular.diffuse_texture.as_ref(), 0.0, 1.0 - gloss);
            }
        }
        let (mut metallic, mut roughness) = (pbr.metallic_factor.0, pbr.roughness_factor.0);
        if let Some(info) = &pbr.metallic_roughness_texture {
            self.warnings.note("textures of metalness and roughness are averaged", self.place);
            if let Some(mean) = self.table.mean(info, self.place, self.warnings)? {
                metallic *= mean.z;
                roughness *= mean.y;
            }
        }
        let base_color = Vec4::from_array(pbr.base_color_factor.0);
        self.surface(base_color, pbr.base_color_texture.as_ref(), metallic, roughness)
    }

    fn surface(
        &mut self,
        base_color: Vec4,
        texture: Option<&::gltf::json::texture::Info>,
        metallic: f32,
        roughness: f32,
    ) -> Outcome<Material> {
        let factors = self.clamp(Vec4::new(metallic, roughness, 0.0, 0.0), 1.0, "metalness or roughness")?;
        Ok(Material {
            base_color: self.clamp(base_color, 1.0, "base colour")?,
            base_color_texture: match texture {
                Some(info) => self.table.refer(info, self.place, self.warnings)?,
                None => None,
            },
            metallic: factors.x,
            roughness: factors.y,
            specular: 1.0,
            ..Material::default()
        })
    }

    fn clamp(&mut self, value: Vec4, max: f32, what: &str) -> Outcome<Vec4> {
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

fn alpha_mode(json: &JsonMaterial) -> Outcome<AlphaMode> {
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
        Checked::Invalid => Err(Fault::Invalid("its alphaMode is none of OPAQUE, MASK and BLEND".into())),
    }
}

/// Whether the file leaves all of it out, or might as well.
fn is_unset(pbr: &PbrMetallicRoughness) -> bool {
    pbr.base_color_texture.is_none()
        && pbr.metallic_roughness_texture.is_none()
        && pbr.base_color_factor.0 == [1.0; 4]
        && pbr.metallic_factor.0 == 1.0
        && pbr.roughness_factor.0 == 1.0
}
