//! glTF's metallic-roughness material with its extensions.

use glam::{Vec3, Vec4};

use super::{AlphaMode, NormalMap, TextureRef};

/// Interior of a closed surface (`KHR_materials_volume`). Without it, a transmissive surface is infinitely thin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// Fraction of light left after `attenuation_distance`.
    pub attenuation_color: Vec3,
    /// Distance in world-space scene units, above 0; infinite for no attenuation.
    pub attenuation_distance: f32,
}

/// A dielectric coat (`KHR_materials_clearcoat`) with an index of refraction of 1.5.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Clearcoat {
    /// Coverage from 0 (none) to 1 (everywhere), multiplied by the texture's red.
    pub factor: f32,
    pub factor_texture: Option<TextureRef>,
    /// Roughness, multiplied by the texture's green.
    pub roughness: f32,
    pub roughness_texture: Option<TextureRef>,
    pub normal_map: Option<NormalMap>,
}

/// A sheen (`KHR_materials_sheen`): light that fibres, like those of velvet, scatter at grazing angles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sheen {
    /// Linear RGB; black for no sheen.
    pub color: Vec3,
    /// sRGB-encoded colour.
    pub color_texture: Option<TextureRef>,
    /// Roughness, multiplied by the texture's alpha.
    pub roughness: f32,
    pub roughness_texture: Option<TextureRef>,
}

impl Sheen {
    pub fn is_there(&self) -> bool {
        self.color != Vec3::ZERO
    }
}

/// Light that a thin sheet, such as a leaf or a lampshade, scatters to its other side
/// (`KHR_materials_diffuse_transmission`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DiffuseTransmission {
    /// Fraction of the diffuse light that leaves on the other side, multiplied by the texture's alpha.
    pub factor: f32,
    pub factor_texture: Option<TextureRef>,
    /// Linear RGB, in place of the base colour.
    pub color: Vec3,
    /// sRGB-encoded colour.
    pub color_texture: Option<TextureRef>,
}

impl Default for DiffuseTransmission {
    fn default() -> Self {
        Self { factor: 0.0, factor_texture: None, color: Vec3::ONE, color_texture: None }
    }
}

/// A thin film that tints the reflection by interference (`KHR_materials_iridescence`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iridescence {
    /// Coverage from 0 (none) to 1 (everywhere), multiplied by the texture's red.
    pub factor: f32,
    pub factor_texture: Option<TextureRef>,
    /// The film's index of refraction, at least 1.
    pub ior: f32,
    /// Thicknesses in nanometres where the texture's green is 0 and 1. Without a texture, the second one.
    pub thickness_nm: [f32; 2],
    pub thickness_texture: Option<TextureRef>,
}

impl Default for Iridescence {
    fn default() -> Self {
        let thickness_nm = [100.0, 400.0];
        Self { factor: 0.0, factor_texture: None, ior: 1.3, thickness_nm, thickness_texture: None }
    }
}

/// Roughness that depends on the direction, like that of brushed metal (`KHR_materials_anisotropy`). It needs tangents.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Anisotropy {
    /// How much rougher the surface is along the direction than across, from 0 (as rough) to 1 (fully rough), multiplied
    /// by the texture's blue.
    pub strength: f32,
    /// Angle of the direction with the tangent, radians, counter-clockwise. It turns the texture's directions as well.
    pub rotation: f32,
    /// Red and green hold the direction along tangent and bitangent, from -1 to 1.
    pub texture: Option<TextureRef>,
}

/// Roughness below which facets reflect like a mirror: slightly above the square root of the shaders' lower bound on
/// GGX alpha.
const SMOOTH_ROUGHNESS: f32 = 0.0101;
/// Roughness below which facets certainly are mirror-like.
const MIRROR_ROUGHNESS: f32 = 0.0099;

/// Least index of refraction of any colour in a volume with dispersion.
const LEAST_DISPERSED_IOR: f32 = 1.002;

/// glTF 2.0 metallic-roughness material with the extensions that change scattering.
///
/// Textures hold encoded values: colours are sRGB-encoded, all others linear. A texture multiplies its factor.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    pub name: String,
    /// Linear RGB and alpha factor.
    pub base_color: Vec4,
    /// sRGB-encoded colour with linear alpha.
    pub base_color_texture: Option<TextureRef>,
    pub metallic: f32,
    /// Perceptual roughness, 0 to 1.
    pub roughness: f32,
    /// Green multiplies roughness; blue multiplies metalness.
    pub metallic_roughness_texture: Option<TextureRef>,
    pub normal_map: Option<NormalMap>,
    /// Emitted radiance in W/(m² sr): emissive factor times emissive strength. Only the front emits, or both sides of a
    /// double-sided material.
    pub emissive: Vec3,
    /// sRGB-encoded colour.
    pub emissive_texture: Option<TextureRef>,
    pub alpha_mode: AlphaMode,
    pub double_sided: bool,
    /// `KHR_materials_ior`: at least 1, or 0 for a Fresnel term of 1.
    pub ior: f32,
    /// `KHR_materials_specular`: strength of the dielectric's reflection. The texture's alpha multiplies it.
    pub specular: f32,
    pub specular_texture: Option<TextureRef>,
    /// Tint of the dielectric's reflection at normal incidence. It may exceed 1.
    pub specular_color: Vec3,
    /// sRGB-encoded colour.
    pub specular_color_texture: Option<TextureRef>,
    /// `KHR_materials_transmission`: fraction of the dielectric's base that transmits light, multiplied by the
    /// texture's red.
    pub transmission: f32,
    pub transmission_texture: Option<TextureRef>,
    pub volume: Option<Volume>,
    /// `KHR_materials_dispersion`: 20 over the Abbe number of the volume; 0 for no dispersion.
    pub dispersion: f32,
    pub clearcoat: Clearcoat,
    pub sheen: Sheen,
    pub diffuse_transmission: DiffuseTransmission,
    pub iridescence: Iridescence,
    pub anisotropy: Anisotropy,
    /// `KHR_materials_unlit`: the base colour is the radiance, and nothing is scattered.
    pub unlit: bool,
}

impl Default for Material {
    /// Returns a white Lambertian: no metal, and no reflection from the dielectric's surface (`specular` 0). Materials
    /// of a glTF file start from `specular` 1 instead.
    fn default() -> Self {
        Self {
            name: String::new(),
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 0.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_map: None,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            alpha_mode: AlphaMode::Opaque,
            double_sided: false,
            ior: 1.5,
            specular: 0.0,
            specular_texture: None,
            specular_color: Vec3::ONE,
            specular_color_texture: None,
            transmission: 0.0,
            transmission_texture: None,
            volume: None,
            dispersion: 0.0,
            clearcoat: Clearcoat::default(),
            sheen: Sheen::default(),
            diffuse_transmission: DiffuseTransmission::default(),
            iridescence: Iridescence::default(),
            anisotropy: Anisotropy::default(),
            unlit: false,
        }
    }
}

impl Material {
    /// Returns the references to all textures of the material.
    pub fn textures(&self) -> impl Iterator<Item = TextureRef> {
        let normal = |map: Option<NormalMap>| map.map(|m| m.texture);
        [
            self.base_color_texture,
            self.metallic_roughness_texture,
            normal(self.normal_map),
            self.emissive_texture,
            self.specular_texture,
            self.specular_color_texture,
            self.transmission_texture,
            self.clearcoat.factor_texture,
            self.clearcoat.roughness_texture,
            normal(self.clearcoat.normal_map),
            self.sheen.color_texture,
            self.sheen.roughness_texture,
            self.diffuse_transmission.factor_texture,
            self.diffuse_transmission.color_texture,
            self.iridescence.factor_texture,
            self.iridescence.thickness_texture,
            self.anisotropy.texture,
        ]
        .into_iter()
        .flatten()
    }

    /// Returns the volume behind the surface, or `None` if the surface is opaque and hides it.
    pub fn enclosed_volume(&self) -> Option<Volume> {
        self.volume.filter(|_| self.is_translucent())
    }

    /// Returns the difference between the indices of refraction of red or blue light and of green light. It is 0 for
    /// surfaces that refract all colours alike.
    pub fn dispersed_ior(&self) -> f32 {
        let is_refracting = self.transmission > 0.0 && self.volume.is_some();
        let spread = (self.ior - 1.0) * 0.025 * self.dispersion;
        if is_refracting { spread.min(self.ior - LEAST_DISPERSED_IOR).max(0.0) } else { 0.0 }
    }

    /// Returns true if the surface refracts each colour by another angle.
    pub fn is_dispersive(&self) -> bool {
        self.dispersed_ior() > 0.0
    }

    pub fn is_anisotropic(&self) -> bool {
        self.anisotropy.strength > 0.0
    }

    /// Returns true if light may pass the surface, scattered or not.
    pub fn is_translucent(&self) -> bool {
        self.transmission > 0.0 || self.diffuse_transmission.factor > 0.0
    }

    /// Returns true if parts of the surface may transmit light through mirror-like facets, which light sampling cannot
    /// find. A roughness texture counts as smooth, since it can only lower the roughness.
    pub fn may_transmit_smoothly(&self) -> bool {
        let is_smooth = self.roughness < SMOOTH_ROUGHNESS || self.metallic_roughness_texture.is_some();
        is_smooth && self.transmission > 0.0 && !self.unlit
    }

    /// Returns true if the facets are mirror-like everywhere.
    fn is_smooth(&self) -> bool {
        self.roughness < MIRROR_ROUGHNESS && self.metallic_roughness_texture.is_none() && !self.is_anisotropic()
    }

    /// Returns true if specular reflection and transmission are delta functions and the normals have no detail.
    fn is_delta(&self) -> bool {
        let is_bare =
            self.normal_map.is_none() && self.clearcoat.factor <= 0.0 && !self.sheen.is_there() && !self.unlit;
        self.is_smooth() && is_bare && self.alpha_mode == AlphaMode::Opaque
    }

    /// Returns true if the material is a perfect mirror: its only lobe reflects, and is a delta function.
    pub fn is_mirror(&self) -> bool {
        self.is_delta() && self.metallic >= 1.0 && self.transmission <= 0.0
    }

    /// Returns true if the material is clear glass: it has no lobes but reflection and transmission, which are delta
    /// functions of one direction for all colours.
    pub fn is_clear_glass(&self) -> bool {
        let is_transparent = self.transmission >= 1.0 && self.transmission_texture.is_none();
        self.is_delta() && self.metallic <= 0.0 && is_transparent && !self.is_dispersive()
    }

    /// Returns true if the material is a perfect mirror or clear glass.
    pub fn is_link(&self) -> bool {
        self.is_mirror() || self.is_clear_glass()
    }

    /// Returns true if the material is opaque and reflects by delta functions beside its other lobes, like smooth paint
    /// or a smooth coat, and its normals have no detail.
    pub fn is_polished(&self) -> bool {
        let coat = &self.clearcoat;
        let is_bare = self.normal_map.is_none() && coat.normal_map.is_none() && !self.sheen.is_there() && !self.unlit;
        let is_opaque = self.alpha_mode == AlphaMode::Opaque && !self.is_translucent();
        let reflects = self.metallic > 0.0 || self.specular > 0.0;
        let is_smooth = reflects && self.is_smooth();
        let has_smooth_coat =
            coat.factor > 0.0 && coat.roughness < MIRROR_ROUGHNESS && coat.roughness_texture.is_none();
        is_bare && is_opaque && !self.is_mirror() && (is_smooth || has_smooth_coat)
    }

    /// Returns true if one of the material's textures uses texture coordinate set `set`.
    pub fn uses_uv_set(&self, set: usize) -> bool {
        self.textures().any(|t| t.uv_set == set)
    }
}
