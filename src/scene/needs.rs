//! Shader features that a scene needs. All others are compiled out.

use super::{AlphaMode, Environment, Light, Material, Mesh, Scene, are_suns_hard};

/// Features of the tracing stages, as flags. Enabling more than needed changes only the time, not the picture, except
/// for `gloss`, `hard_lights`, `mirrors`, `polish` and `narrow_lobes`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SceneNeeds {
    pub textures: bool,
    /// Textures on the second set of texture coordinates.
    pub second_uvs: bool,
    pub normal_maps: bool,
    /// Microfacet reflection: metal, or a dielectric whose surface reflects.
    pub specular: bool,
    /// A specular lobe, which denoisers filter apart from the diffuse one. This flag changes the picture.
    pub gloss: bool,
    /// Surfaces that light passes, scattered or not.
    pub transmission: bool,
    pub diffuse_transmission: bool,
    /// Thin, smooth, transmissive surfaces together with lights that only shadow rays can find behind them.
    pub transparent_shadows: bool,
    pub clearcoat: bool,
    pub sheen: bool,
    pub iridescence: bool,
    pub anisotropy: bool,
    pub dispersion: bool,
    pub unlit: bool,
    pub vertex_colors: bool,
    pub alpha: bool,
    pub emissive: bool,
    /// Emissive surfaces that are masked or blended.
    pub alpha_emitters: bool,
    /// Emissive surfaces under a clearcoat.
    pub coated_emitters: bool,
    /// Point and spot lights.
    pub local_lights: bool,
    /// Sphere lights.
    pub spheres: bool,
    pub directional: bool,
    pub constant_environment: bool,
    pub environment_map: bool,
    /// One to four lights with hard shadows. Each can then be traced at the first surface. Like
    /// `gloss`, this flag changes the picture.
    pub hard_lights: bool,
    /// Perfect mirrors or clear glass. They can be replaced by the surfaces that they show. Like `gloss`, this flag
    /// changes the picture.
    pub mirrors: bool,
    /// Polished opaque surfaces, whose reflections are sampled by themselves if frames are denoised. Like `gloss`, this
    /// flag changes the picture.
    pub polish: bool,
    /// Surfaces that reflect mostly by narrow specular lobes, which filters would blur. Like `gloss`, this flag changes
    /// the picture.
    pub narrow_lobes: bool,
    /// Instances that rays traverse in local space. [`Self::of`] leaves this flag false; it is set according to the
    /// scene's tables.
    pub instances: bool,
}

/// Returns true if the material may have a specular lobe. Rough lobes count too: of a black and a white surface of rough
/// plastic, one reflects specular light alone, and a filter of both kinds as one would blend it with the other's diffuse
/// light.
fn has_gloss(m: &Material) -> bool {
    !m.unlit && (m.clearcoat.factor > 0.0 || m.metallic > 0.0 || m.specular > 0.0 || m.transmission > 0.0)
}

/// Roughness below which a lobe is narrow, as in `is_view_dependent` of `surface.inc.wgsl`.
const NARROW_ROUGHNESS: f32 = 0.25;

/// Returns true if the material may have a narrow specular lobe that is a significant part of its reflection.
fn has_narrow_lobes(m: &Material) -> bool {
    let is_narrow = m.roughness < NARROW_ROUGHNESS || m.metallic_roughness_texture.is_some();
    let reflects = m.metallic > 0.0 || m.specular > 0.0 || m.transmission > 0.0;
    !m.unlit && (m.clearcoat.factor > 0.0 || (is_narrow && reflects))
}

/// Returns true if parts of the surface may be thin, smooth and transmissive, so that light passes straight through.
fn is_pane(m: &Material) -> bool {
    m.enclosed_volume().is_none() && m.may_transmit_smoothly()
}

/// Returns true if the mesh is evenly translucent. Shadow rays pass it at random, so shadows would be noisy everywhere.
/// Textures, whose alpha is 0 or 1 nearly everywhere, do not count.
fn is_veil(mesh: &Mesh, m: &Material) -> bool {
    m.alpha_mode == AlphaMode::Blend && (m.base_color.w < 1.0 || mesh.colors.iter().any(|color| color.w < 1.0))
}

/// Largest number of lights with hard shadows that are traced at the first surface. Each costs a shadow ray per pixel.
const MOST_HARD_LIGHTS: usize = 4;

/// Returns true if the scene has lights with hard shadows, but at most [`MOST_HARD_LIGHTS`]. Suns count only if all of
/// them have hard shadows.
fn has_hard_lights(scene: &Scene) -> bool {
    let are_suns_hard = are_suns_hard(&scene.lights);
    let hard = scene.lights.iter().filter(|light| light.has_hard_shadows() && (are_suns_hard || !light.is_sun()));
    (1..=MOST_HARD_LIGHTS).contains(&hard.count())
}

impl SceneNeeds {
    /// Enables all features, for comparison.
    pub const ALL: Self = Self {
        textures: true,
        second_uvs: true,
        normal_maps: true,
        specular: true,
        gloss: true,
        transmission: true,
        diffuse_transmission: true,
        transparent_shadows: true,
        clearcoat: true,
        sheen: true,
        iridescence: true,
        anisotropy: true,
        dispersion: true,
        unlit: true,
        vertex_colors: true,
        alpha: true,
        emissive: true,
        alpha_emitters: true,
        coated_emitters: true,
        local_lights: true,
        spheres: true,
        directional: true,
        constant_environment: true,
        environment_map: true,
        hard_lights: true,
        mirrors: true,
        polish: true,
        narrow_lobes: true,
        instances: true,
    };

    /// Returns these needs with all features added that do not change the picture, for comparison.
    pub fn widened(self) -> Self {
        let Self { gloss, hard_lights, mirrors, polish, narrow_lobes, .. } = self;
        Self { gloss, hard_lights, mirrors, polish, narrow_lobes, ..Self::ALL }
    }

    pub fn of(scene: &Scene) -> Self {
        let used = || scene.instances.iter().map(|i| &scene.meshes[i.mesh]);
        let materials = || used().map(|m| &scene.materials[m.material]);
        let is_animated = |material: usize| scene.motion.emitters.iter().any(|e| e.index == material);
        let shines = |m: &&Mesh| scene.materials[m.material].emissive != glam::Vec3::ZERO || is_animated(m.material);
        let emitters = || used().filter(shines).map(|m| &scene.materials[m.material]);
        Self {
            textures: materials().any(|m| m.textures().next().is_some()),
            second_uvs: materials().any(|m| m.uses_uv_set(1)),
            normal_maps: materials().any(|m| m.normal_map.is_some() || m.clearcoat.normal_map.is_some()),
            specular: materials().any(|m| m.metallic > 0.0 || m.specular > 0.0),
            gloss: materials().any(has_gloss),
            transmission: materials().any(Material::is_translucent),
            diffuse_transmission: materials().any(|m| m.diffuse_transmission.factor > 0.0),
            transparent_shadows: materials().any(is_pane) && scene.lights.iter().any(Light::is_delta),
            clearcoat: materials().any(|m| m.clearcoat.factor > 0.0),
            sheen: materials().any(|m| m.sheen.is_there()),
            iridescence: materials().any(|m| m.iridescence.factor > 0.0),
            anisotropy: materials().any(Material::is_anisotropic),
            dispersion: materials().any(Material::is_dispersive),
            unlit: materials().any(|m| m.unlit),
            vertex_colors: used().any(|m| !m.colors.is_empty()),
            alpha: materials().any(|m| m.alpha_mode != AlphaMode::Opaque),
            emissive: emitters().next().is_some(),
            alpha_emitters: emitters().any(|m| m.alpha_mode != AlphaMode::Opaque),
            coated_emitters: emitters().any(|m| m.clearcoat.factor > 0.0),
            local_lights: scene.lights.iter().any(|l| !l.is_sun()),
            spheres: scene.lights.iter().any(|l| l.radius().is_some_and(|r| r > 0.0)),
            directional: scene.lights.iter().any(Light::is_sun),
            constant_environment: matches!(scene.environment, Environment::Constant(c) if c != glam::Vec3::ZERO),
            environment_map: matches!(scene.environment, Environment::Map { .. }),
            hard_lights: has_hard_lights(scene) && !used().any(|mesh| is_veil(mesh, &scene.materials[mesh.material])),
            mirrors: materials().any(Material::is_link),
            polish: materials().any(Material::is_polished),
            narrow_lobes: materials().any(has_narrow_lobes),
            instances: false,
        }
    }

    /// Returns names and values of the shaders' override constants, except those of `gloss`, `hard_lights`,
    /// `mirrors`, `polish` and `narrow_lobes`, which also depend on the denoiser.
    pub fn constants(&self) -> [(&'static str, bool); 24] {
        [
            ("HAS_TEXTURES", self.textures),
            ("HAS_SECOND_UVS", self.second_uvs),
            ("HAS_NORMAL_MAPS", self.normal_maps),
            ("HAS_SPECULAR", self.specular),
            ("HAS_TRANSMISSION", self.transmission),
            ("HAS_DIFFUSE_TRANSMISSION", self.diffuse_transmission),
            ("HAS_TRANSPARENT_SHADOWS", self.transparent_shadows),
            ("HAS_CLEARCOAT", self.clearcoat),
            ("HAS_SHEEN", self.sheen),
            ("HAS_IRIDESCENCE", self.iridescence),
            ("HAS_ANISOTROPY", self.anisotropy),
            ("HAS_DISPERSION", self.dispersion),
            ("HAS_UNLIT", self.unlit),
            ("HAS_VERTEX_COLORS", self.vertex_colors),
            ("HAS_ALPHA", self.alpha),
            ("HAS_EMISSIVE", self.emissive),
            ("HAS_ALPHA_EMITTERS", self.alpha_emitters),
            ("HAS_COATED_EMITTERS", self.coated_emitters),
            ("HAS_LOCAL_LIGHTS", self.local_lights),
            ("HAS_SPHERES", self.spheres),
            ("HAS_DIRECTIONAL", self.directional),
            ("HAS_CONSTANT_ENV", self.constant_environment),
            ("HAS_ENV_MAP", self.environment_map),
            ("HAS_INSTANCES", self.instances),
        ]
    }
}
