//! Material extensions: specular reflection of dielectrics, transmission and volume, clearcoat, and the older
//! specular-glossiness model.

use ::gltf::json::extensions::material::{
    Ior, Material as JsonExtensions, PbrSpecularGlossiness, Specular, Transmission, Volume as JsonVolume,
};
use ::gltf::json::material::NormalTexture;
use ::gltf::json::texture::Info;
use glam::Vec4;

use super::fault::{Fault, Outcome};
use super::materials::Reader;
use crate::scene::{Clearcoat, Material, Volume};

const CLEARCOAT: &str = "KHR_materials_clearcoat";

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
        if let Some(clearcoat) = json.others.get(CLEARCOAT) {
            let clearcoat = serde_json::from_value(clearcoat.clone());
            let clearcoat = clearcoat.map_err(|e| Fault::Invalid(format!("its {CLEARCOAT}: {e}")))?;
            material.clearcoat = self.clearcoat(&clearcoat)?;
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
