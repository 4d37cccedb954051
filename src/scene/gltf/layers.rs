//! Material extensions: specular reflection of dielectrics, transmission and volume, clearcoat, sheen, diffuse
//! transmission, iridescence, anisotropy, dispersion, and the older specular-glossiness model.

use ::gltf::json::extensions::material::{
    Ior, Material as JsonExtensions, PbrSpecularGlossiness, Specular, Transmission, Volume as JsonVolume,
};
use ::gltf::json::material::NormalTexture;
use ::gltf::json::texture::Info;
use glam::{Vec3, Vec4};

use super::fault::{Fault, Outcome};
use super::materials::Reader;
use crate::scene::{Anisotropy, Clearcoat, DiffuseTransmission, Iridescence, Material, Sheen, Volume};

const CLEARCOAT: &str = "KHR_materials_clearcoat";
const SHEEN: &str = "KHR_materials_sheen";
const IRIDESCENCE: &str = "KHR_materials_iridescence";
const ANISOTROPY: &str = "KHR_materials_anisotropy";
const DISPERSION: &str = "KHR_materials_dispersion";
const DIFFUSE_TRANSMISSION: &str = "KHR_materials_diffuse_transmission";

/// Maximum thickness of a film, nanometres. The interference of a thicker one has no visible colour.
const MOST_FILM_NM: f32 = 1e5;

/// JSON of `KHR_materials_clearcoat`.
#[derive(Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct JsonClearcoat {
    clearcoat_factor: f32,
    clearcoat_texture: Option<Info>,
    clearcoat_roughness_factor: f32,
    clearcoat_roughness_texture: Option<Info>,
    clearcoat_normal_texture: Option<NormalTexture>,
}

/// JSON of `KHR_materials_sheen`.
#[derive(Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct JsonSheen {
    sheen_color_factor: [f32; 3],
    sheen_color_texture: Option<Info>,
    sheen_roughness_factor: f32,
    sheen_roughness_texture: Option<Info>,
}

/// JSON of `KHR_materials_diffuse_transmission`.
#[derive(serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct JsonDiffuseTransmission {
    diffuse_transmission_factor: f32,
    diffuse_transmission_texture: Option<Info>,
    diffuse_transmission_color_factor: [f32; 3],
    diffuse_transmission_color_texture: Option<Info>,
}

impl Default for JsonDiffuseTransmission {
    fn default() -> Self {
        Self {
            diffuse_transmission_factor: 0.0,
            diffuse_transmission_texture: None,
            diffuse_transmission_color_factor: [1.0; 3],
            diffuse_transmission_color_texture: None,
        }
    }
}

/// JSON of `KHR_materials_iridescence`.
#[derive(serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct JsonIridescence {
    iridescence_factor: f32,
    iridescence_texture: Option<Info>,
    iridescence_ior: f32,
    iridescence_thickness_minimum: f32,
    iridescence_thickness_maximum: f32,
    iridescence_thickness_texture: Option<Info>,
}

impl Default for JsonIridescence {
    fn default() -> Self {
        let Iridescence { factor, ior, thickness_nm: [least, most], .. } = Iridescence::default();
        Self {
            iridescence_factor: factor,
            iridescence_texture: None,
            iridescence_ior: ior,
            iridescence_thickness_minimum: least,
            iridescence_thickness_maximum: most,
            iridescence_thickness_texture: None,
        }
    }
}

/// JSON of `KHR_materials_anisotropy`.
#[derive(Default, serde::Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct JsonAnisotropy {
    anisotropy_strength: f32,
    anisotropy_rotation: f32,
    anisotropy_texture: Option<Info>,
}

/// JSON of `KHR_materials_dispersion`.
#[derive(Default, serde::Deserialize)]
#[serde(default)]
struct JsonDispersion {
    dispersion: f32,
}

/// Parses an extension that the parser of the file leaves as JSON.
fn parsed<T: serde::de::DeserializeOwned>(json: &JsonExtensions, name: &str) -> Outcome<Option<T>> {
    let parse = |value: &serde_json::Value| serde_json::from_value(value.clone());
    json.others.get(name).map(parse).transpose().map_err(|e| Fault::Invalid(format!("its {name}: {e}")))
}

impl Reader<'_, '_, '_> {
    pub(super) fn extensions(&mut self, json: &JsonExtensions, material: &mut Material) -> Outcome<()> {
        if let Some(ior) = &json.ior {
            self.ior(ior, material)?;
        }
        if let Some(specular) = &json.specular {
            self.specular(specular, material)?;
        }
        if let Some(transmission) = &json.transmission {
            self.transmission(transmission, material)?;
        }
        if let Some(volume) = &json.volume {
            material.volume = self.volume(volume)?;
        }
        if let Some(clearcoat) = parsed(json, CLEARCOAT)? {
            material.clearcoat = self.clearcoat(&clearcoat)?;
        }
        if let Some(sheen) = parsed(json, SHEEN)? {
            material.sheen = self.sheen(&sheen)?;
        }
        if let Some(transmission) = parsed(json, DIFFUSE_TRANSMISSION)? {
            material.diffuse_transmission = self.diffuse_transmission(&transmission)?;
        }
        if let Some(film) = parsed(json, IRIDESCENCE)? {
            material.iridescence = self.iridescence(&film)?;
        }
        if let Some(brushed) = parsed(json, ANISOTROPY)? {
            material.anisotropy = self.anisotropy(&brushed)?;
        }
        if let Some(JsonDispersion { dispersion }) = parsed(json, DISPERSION)? {
            material.dispersion = self.color([dispersion; 3], f32::MAX, "dispersion")?.x;
        }
        if let Some(specular) = &json.pbr_specular_glossiness {
            self.specular_glossiness(specular, material)?;
        }
        Ok(())
    }

    fn ior(&mut self, json: &Ior, material: &mut Material) -> Outcome<()> {
        let ior = json.ior.0;
        if !ior.is_finite() {
            return Err(Fault::Invalid("its index of refraction is not finite".into()));
        }
        material.ior = if ior == 0.0 { 0.0 } else { ior.max(1.0) };
        if material.ior != ior {
            self.warnings.note("indices of refraction below 1 are taken as 1", self.place);
        }
        Ok(())
    }

    fn specular(&mut self, json: &Specular, material: &mut Material) -> Outcome<()> {
        material.specular = self.unit(json.specular_factor.0, "specular reflection")?;
        material.specular_texture = self.texture(json.specular_texture.as_ref())?;
        material.specular_color = self.color(json.specular_color_factor.0, f32::MAX, "specular colour")?;
        material.specular_color_texture = self.texture(json.specular_color_texture.as_ref())?;
        Ok(())
    }

    fn transmission(&mut self, json: &Transmission, material: &mut Material) -> Outcome<()> {
        material.transmission = self.unit(json.transmission_factor.0, "transmission")?;
        let info = json.transmission_texture.as_ref().filter(|_| material.transmission > 0.0);
        material.transmission_texture = self.texture(info)?;
        if info.is_some() && material.transmission_texture.is_none() {
            // Without its texture, the parts that the texture keeps opaque would transmit.
            material.transmission = 0.0;
        }
        Ok(())
    }

    /// Reads the volume. Returns `None` if its thickness is 0, which means that the surface is infinitely thin.
    fn volume(&mut self, json: &JsonVolume) -> Outcome<Option<Volume>> {
        let thickness = self.color([json.thickness_factor.0; 3], f32::MAX, "thickness")?.x;
        let attenuation_color = self.color(json.attenuation_color.0, 1.0, "attenuation colour")?;
        if thickness == 0.0 {
            return Ok(None);
        }
        if json.thickness_texture.is_some() {
            self.warnings.note("thickness textures are left out: the geometry defines the thickness", self.place);
        }
        let mut attenuation_distance = json.attenuation_distance.0;
        if attenuation_distance <= 0.0 {
            // Files write 0 to mean the default, and other renderers accept that.
            self.warnings.note("attenuation distances that are not above 0 are taken as infinite", self.place);
            attenuation_distance = f32::INFINITY;
        }
        Ok(Some(Volume { attenuation_color, attenuation_distance }))
    }

    fn clearcoat(&mut self, json: &JsonClearcoat) -> Outcome<Clearcoat> {
        let factor = self.unit(json.clearcoat_factor, "clearcoat")?;
        let roughness = self.unit(json.clearcoat_roughness_factor, "clearcoat roughness")?;
        if factor == 0.0 {
            return Ok(Clearcoat::default());
        }
        Ok(Clearcoat {
            factor,
            factor_texture: self.texture(json.clearcoat_texture.as_ref())?,
            roughness,
            roughness_texture: self.texture(json.clearcoat_roughness_texture.as_ref())?,
            normal_map: self.normal_map(json.clearcoat_normal_texture.as_ref())?,
        })
    }

    fn sheen(&mut self, json: &JsonSheen) -> Outcome<Sheen> {
        let color = self.color(json.sheen_color_factor, 1.0, "sheen colour")?;
        let roughness = self.unit(json.sheen_roughness_factor, "sheen roughness")?;
        if color == Vec3::ZERO {
            return Ok(Sheen::default());
        }
        let color_texture = self.texture(json.sheen_color_texture.as_ref())?;
        if json.sheen_color_texture.is_some() && color_texture.is_none() {
            // Without its texture, the parts that the texture keeps black would have a sheen.
            return Ok(Sheen::default());
        }
        let roughness_texture = self.texture(json.sheen_roughness_texture.as_ref())?;
        Ok(Sheen { color, color_texture, roughness, roughness_texture })
    }

    fn diffuse_transmission(&mut self, json: &JsonDiffuseTransmission) -> Outcome<DiffuseTransmission> {
        let factor = self.unit(json.diffuse_transmission_factor, "diffuse transmission")?;
        let color = self.color(json.diffuse_transmission_color_factor, 1.0, "diffuse transmission colour")?;
        if factor == 0.0 {
            return Ok(DiffuseTransmission::default());
        }
        let factor_texture = self.texture(json.diffuse_transmission_texture.as_ref())?;
        if json.diffuse_transmission_texture.is_some() && factor_texture.is_none() {
            // Without its texture, the parts that the texture keeps opaque would transmit.
            return Ok(DiffuseTransmission::default());
        }
        let color_texture = self.texture(json.diffuse_transmission_color_texture.as_ref())?;
        Ok(DiffuseTransmission { factor, factor_texture, color, color_texture })
    }

    fn iridescence(&mut self, json: &JsonIridescence) -> Outcome<Iridescence> {
        let factor = self.unit(json.iridescence_factor, "iridescence")?;
        let mut thickness = |nm: f32| self.color([nm; 3], MOST_FILM_NM, "iridescence thickness").map(|nm| nm.x);
        let thickness_nm =
            [thickness(json.iridescence_thickness_minimum)?, thickness(json.iridescence_thickness_maximum)?];
        if !json.iridescence_ior.is_finite() {
            return Err(Fault::Invalid("the index of refraction of its iridescence is not finite".into()));
        }
        let ior = json.iridescence_ior.max(1.0);
        if ior != json.iridescence_ior {
            self.warnings.note("indices of refraction below 1 are taken as 1", self.place);
        }
        if factor == 0.0 {
            return Ok(Iridescence::default());
        }
        Ok(Iridescence {
            factor,
            factor_texture: self.texture(json.iridescence_texture.as_ref())?,
            ior,
            thickness_nm,
            thickness_texture: self.texture(json.iridescence_thickness_texture.as_ref())?,
        })
    }

    fn anisotropy(&mut self, json: &JsonAnisotropy) -> Outcome<Anisotropy> {
        let strength = self.unit(json.anisotropy_strength, "anisotropy")?;
        let rotation = json.anisotropy_rotation;
        if !rotation.is_finite() {
            return Err(Fault::Invalid("the rotation of its anisotropy is not finite".into()));
        }
        if strength == 0.0 {
            return Ok(Anisotropy::default());
        }
        let texture = self.texture(json.anisotropy_texture.as_ref())?;
        Ok(Anisotropy { strength, rotation, texture })
    }

    /// Converts `KHR_materials_pbrSpecularGlossiness` to `KHR_materials_ior` and `KHR_materials_specular`. These were
    /// designed to allow this conversion: with an index of refraction of 0, the specular colour is the reflectance at
    /// normal incidence. Overrides the metallic-roughness values, as the archived extension requires.
    fn specular_glossiness(&mut self, json: &PbrSpecularGlossiness, material: &mut Material) -> Outcome<()> {
        material.base_color = self.clamp(Vec4::from_array(json.diffuse_factor.0), 1.0, "diffuse colour")?;
        material.base_color_texture = self.texture(json.diffuse_texture.as_ref())?;
        material.metallic = 0.0;
        material.ior = 0.0;
        material.specular = 1.0;
        material.specular_texture = None;
        material.specular_color = self.color(json.specular_factor.0, 1.0, "specular colour")?;
        material.specular_color_texture = self.texture(json.specular_glossiness_texture.as_ref())?;
        let glossiness = self.unit(json.glossiness_factor.0, "glossiness")?;
        material.metallic_roughness_texture =
            material.specular_color_texture.map(|t| self.table.roughness_of(t, glossiness)).transpose()?;
        material.roughness = if material.metallic_roughness_texture.is_some() { 1.0 } else { 1.0 - glossiness };
        Ok(())
    }
}
