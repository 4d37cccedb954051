//! Light sources as paths sample them: the table of lights, the light tree over local lights, the tree of spherical
//! lights that rays intersect, and the grid over an environment image.

mod env_grid;
mod light_tree;
mod sphere_tree;

use std::collections::HashMap;
use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec3, Vec3};

use self::env_grid::EnvGrid;
use self::light_tree::{Bounds, Cone, LightTree};
use super::alias;
use super::color::{linear_from_srgb, luminance};
use crate::accel::{Accel, Node, Triangle};
use crate::layout::{EnvCell, LIGHT_SPOT, LIGHT_TRIANGLE, Light, Lights};
use crate::scene::{self, AlphaMode, LightKind, Material, Scene};
use crate::wgsl::ROW_BYTES;

/// Light sources of a scene. `lights` holds spheres, then point and spot lights without a radius, emissive triangles,
/// and directional lights. The light tree holds all but the directional ones.
#[derive(Default)]
pub struct Emitters {
    pub lights: Vec<Light>,
    /// Cells of the grid over the environment image; empty without an image.
    pub env_cells: Vec<EnvCell>,
    /// Columns and rows of that grid; 0 without an image.
    pub env_size: [u32; 2],
    /// The shader constants that locate the lights.
    pub constants: Lights,
    /// Nodes of the sphere tree and of the light tree, to be appended to the table of nodes.
    pub trees: Vec<Node>,
}

/// Upper bounds of the memory needed to build the emitters, per light and per cell of the environment's grid, bytes.
const LIGHT_BYTES: u64 = 1500;
const CELL_BYTES: u64 = 64;

/// Returns an upper bound of the memory needed to build the emitters, bytes.
pub(super) fn making_bytes(scene: &Scene, accel: &Accel) -> u64 {
    let shines: Vec<bool> = scene.materials.iter().map(|m| m.emissive != Vec3::ZERO).collect();
    let shines = |t: &Triangle| shines.get(t.material as usize) == Some(&true);
    let triangles = accel.triangles.iter().enumerate();
    let lights = scene.lights.len() + triangles.filter(|(row, t)| t.is_first(*row) && shines(t)).count();
    let cells = match &scene.environment {
        scene::Environment::Map { image, .. } => image.pixels.len().min(env_grid::MOST_CELLS),
        _ => 0,
    };
    lights as u64 * LIGHT_BYTES + cells as u64 * CELL_BYTES
}

/// Mean reflectance of a clear coat for light from below: the cosine-weighted mean of Schlick's term.
const COAT_REFLECTANCE: f64 = 0.04 + 0.96 / 21.0;

/// Minimum coverage (mean alpha) assumed for sampling an emitter. Even if its texture has a mean alpha of 0, filtered
/// texels or vertex colours may let some light through.
const LEAST_COVERAGE: f64 = 1e-3;

/// Returns the fraction of rays that the material's alpha stops rather than lets pass, ignoring vertex colours.
fn mean_coverage(scene: &Scene, material: &Material) -> f64 {
    let coverage = |alpha: f32| match material.alpha_mode {
        AlphaMode::Opaque => 1.0,
        AlphaMode::Mask { cutoff } => f64::from(u8::from(alpha >= cutoff)),
        AlphaMode::Blend => f64::from(alpha.clamp(0.0, 1.0)),
    };
    let factor = material.base_color.w;
    match material.base_color_texture {
        Some(t) if material.alpha_mode != AlphaMode::Opaque => {
            let texels = &scene.images[scene.textures[t.texture].image].pixels;
            let sum: f64 = texels.iter().map(|texel| coverage(factor * f32::from(texel[3]) / 255.0)).sum();
            sum / texels.len().max(1) as f64
        }
        _ => coverage(factor),
    }
}

fn mean_color(image: &scene::TexelImage) -> Vec3 {
    let mut sum = [0.0f64; 3];
    for texel in &image.pixels {
        for (s, &code) in sum.iter_mut().zip(texel) {
            *s += f64::from(linear_from_srgb(code));
        }
    }
    Vec3::from_array(sum.map(|s| (s / image.pixels.len().max(1) as f64) as f32))
}

/// Properties of a scene's lights that do not depend on their positions.
pub struct Sources {
    /// One entry per material.
    materials: Vec<Source>,
    /// Total area, per material, of the triangles that may emit, in their pose at time 0; square scene units.
    areas: Vec<f64>,
    /// Indices in the triangle table of the triangles that may emit; split triangles occur once.
    pub triangles: Vec<u32>,
    /// Whether lights that are dark now stay listed, since they may emit at other times.
    keeps_dark: bool,
}

/// Emission of a material, averaged over its textures.
struct Source {
    /// Mean colour of the texture that multiplies its emission.
    tint: Vec3,
    /// Mean fraction of emission that gets past alpha and clear coat.
    share: f64,
    two_sided: bool,
}

impl Sources {
    pub fn new(scene: &Scene, accel: &Accel) -> Self {
        let mut means = HashMap::new();
        let is_animated = |material: usize| scene.motion.emitters.iter().any(|e| e.index == material);
        let materials = scene.materials.iter().enumerate();
        let materials: Vec<_> = materials.map(|(i, m)| Source::new(scene, m, is_animated(i), &mut means)).collect();
        let emits = |t: &Triangle| materials.get(t.material as usize).is_some_and(|source| source.share > 0.0);
        // A scene without surfaces still stores a degenerate triangle, whose material may not exist.
        let rows = accel.triangles.iter().enumerate().filter(|(row, t)| t.is_first(*row) && emits(t));
        let mut areas = vec![0.0; materials.len()];
        let mut triangles = Vec::new();
        for (row, triangle) in rows {
            areas[triangle.material as usize] += f64::from(triangle.area());
            triangles.push(row as u32);
        }
        let motion = &scene.motion;
        let keeps_dark = !(motion.emitters.is_empty() && motion.lamps.is_empty() && accel.skins.is_empty());
        Self { materials, areas, triangles, keeps_dark }
    }

    /// Returns the power of each material's triangles and of each light. A directional light counts as if it fell on a
    /// unit square.
    fn powers(&self, scene: &Scene) -> Vec<f64> {
        let materials = scene.materials.iter().zip(&self.materials).zip(&self.areas);
        let glowing = materials.map(|((m, s), area)| PI * s.radiance(m) * area);
        let solid_angle = |light: &scene::Light| match light.kind {
            LightKind::Directional { .. } => 1.0,
            LightKind::Point { .. } => 4.0 * PI,
            LightKind::Spot { cos_outer, .. } => 2.0 * PI * f64::from(1.0 - cos_outer),
        };
        glowing.chain(scene.lights.iter().map(|l| solid_angle(l) * luminance(l.strength))).collect()
    }

    /// Returns the fraction of all power that changed from one frame to the next.
    pub fn change(&self, last: &Scene, now: &Scene) -> f64 {
        let (last, now) = (self.powers(last), self.powers(now));
        let pairs = || last.iter().zip(&now);
        let most: f64 = pairs().map(|(a, b)| a.max(*b)).sum();
        let change: f64 = pairs().map(|(a, b)| (a - b).abs()).sum();
        if most > 0.0 { change / most } else { 0.0 }
    }
}

impl Source {
    fn new(scene: &Scene, material: &Material, is_animated: bool, means: &mut HashMap<usize, Vec3>) -> Self {
        let two_sided = material.double_sided;
        if material.unlit || (material.emissive == Vec3::ZERO && !is_animated) {
            return Self { tint: Vec3::ZERO, share: 0.0, two_sided };
        }
        let mut mean = |image: usize| *means.entry(image).or_insert_with(|| mean_color(&scene.images[image]));
        let tint = material.emissive_texture.map_or(Vec3::ONE, |t| mean(scene.textures[t.texture].image));
        let passes = 1.0 - COAT_REFLECTANCE * f64::from(material.clearcoat.factor);
        let share = passes * mean_coverage(scene, material).max(LEAST_COVERAGE);
        Self { tint, share, two_sided }
    }

    /// Returns the mean radiance that the material emits now, as luminance.
    fn radiance(&self, material: &Material) -> f64 {
        luminance(material.emissive * self.tint) * self.share
    }
}

/// Minimum power that the light tree assigns to a light if dark lights stay listed ([`Sources::keeps_dark`]), since the
/// tree needs powers above 0.
const DARK: f64 = 1e-30;

impl Emitters {
    /// Builds the emitters and appends their trees to the nodes of `accel`. Stores in each emissive triangle of `accel`
    /// the index of its light.
    pub fn new(scene: &Scene, sources: &Sources, accel: &mut Accel) -> Self {
        let triangles = sources.triangles.iter().map(|&prim| (prim, accel.triangles[prim as usize]));
        let mut out = Self::placed(scene, sources, accel.origin, triangles, rows(&accel.nodes));
        accel.nodes.extend(&out.trees);
        for (number, light) in (0..).zip(&out.lights).filter(|(_, light)| light.kind == LIGHT_TRIANGLE) {
            accel.triangles[light.prim as usize].light = number;
        }
        if let scene::Environment::Map { image, .. } = &scene.environment
            && let Some(EnvGrid { width, height, cells }) = env_grid::build(image)
        {
            out.env_size = [width, height];
            out.env_cells = cells;
            out.constants.group_count += 1;
        }
        out
    }

    /// Builds the lights and trees from the lights and materials of `scene` and from `triangles`, those that may emit,
    /// at their current positions. `first_row` is the first row of the trees in the table of nodes.
    pub fn placed(
        scene: &Scene,
        sources: &Sources,
        origin: DVec3,
        triangles: impl Iterator<Item = (u32, Triangle)>,
        first_row: u32,
    ) -> Self {
        let (mut out, mut constants) = (Self::default(), Lights::default());
        let dark = if sources.keeps_dark { DARK } else { 0.0 };
        let (mut spheres, mut local, mut directional) = (Vec::new(), Vec::new(), Vec::new());
        for light in scene.lights.iter().filter(|l| sources.keeps_dark || luminance(l.strength) > 0.0) {
            let light = told_from_a_point(relative_to(origin, light));
            match light.kind {
                LightKind::Directional { .. } => directional.push(gpu_light(&light)),
                _ if radius(&light) > 0.0 => spheres.push((gpu_light(&light), local_bounds(&light))),
                _ => local.push((gpu_light(&light), local_bounds(&light))),
            }
        }
        // Point and spot lights without a radius, whose shadows are hard, follow the spheres.
        [constants.first_hard, constants.hard_count] = [spheres.len(), local.len()].map(|count| count as u32);
        constants.has_hard_suns = (!directional.is_empty() && scene::are_suns_hard(&scene.lights)).into();
        let balls: Vec<_> = spheres.iter().map(|(l, _)| (l.position, l.radius)).collect();
        spheres.extend(local);
        for (prim, t) in triangles {
            let (source, material) = (&sources.materials[t.material as usize], &scene.materials[t.material as usize]);
            let (light, bounds) = triangle_light(prim, &t, source.radiance(material), source.two_sided);
            if sources.keeps_dark || bounds.power > 0.0 {
                spheres.push((light, bounds));
            }
        }
        spheres.iter_mut().for_each(|(_, bounds)| bounds.power = bounds.power.max(dark));
        let (mut lights, bounds): (Vec<_>, Vec<_>) = spheres.into_iter().unzip();
        [constants.local_count, constants.directional_count] = [lights.len(), directional.len()].map(|n| n as u32);
        constants.group_count = u32::from(!lights.is_empty()) + u32::from(!directional.is_empty());
        let nodes = sphere_tree::build(&balls, first_row);
        constants.sphere_tree = first_row;
        constants.sphere_tree_end = first_row + sphere_tree::ROWS * nodes.len() as u32;
        append(&mut out.trees, nodes.as_flattened());
        let LightTree { nodes, trails } = light_tree::build(&bounds);
        constants.tree = first_row + rows(&out.trees);
        append(&mut out.trees, nodes.as_flattened());
        lights.iter_mut().zip(trails).for_each(|(light, trail)| light.trail = trail);
        set_picks(&mut directional, constants.local_count);
        lights.extend(directional);
        (out.lights, out.constants) = (lights, constants);
        out
    }

    /// Returns the first row of the trees in the table of nodes.
    pub fn first_row(&self) -> u32 {
        self.constants.sphere_tree
    }
}

/// Returns the radius of a light; 0 for a directional light.
fn radius(light: &scene::Light) -> f32 {
    light.radius().unwrap_or(0.0)
}

fn relative_to(origin: DVec3, light: &scene::Light) -> scene::Light {
    let mut light = *light;
    match &mut light.kind {
        LightKind::Point { position, .. } | LightKind::Spot { position, .. } => {
            *position = (position.as_dvec3() - origin).as_vec3();
        }
        LightKind::Directional { .. } => {}
    }
    light
}

/// Least radius of a sphere. The square of a smaller one underflows in shaders, or nearly so.
const SMALLEST_RADIUS: f32 = 1e-15;

/// Turns a sphere that is too small or too bright for f32 into a point light. It would be too small to see anyway.
fn told_from_a_point(mut light: scene::Light) -> scene::Light {
    let is_told = radius(&light) >= SMALLEST_RADIUS && sphere_radiance(&light).is_finite();
    if let LightKind::Point { radius, .. } | LightKind::Spot { radius, .. } = &mut light.kind
        && !is_told
    {
        *radius = 0.0;
    }
    light
}

fn sphere_radiance(light: &scene::Light) -> Vec3 {
    let r = radius(light);
    light.strength / (std::f32::consts::PI * r * r)
}

fn gpu_light(light: &scene::Light) -> Light {
    let base = Light { strength: light.strength, radius: radius(light), ..Light::default() };
    let strength = if radius(light) > 0.0 { sphere_radiance(light) } else { light.strength };
    match light.kind {
        LightKind::Point { position, .. } => Light { position, strength, ..base },
        LightKind::Spot { position, direction, cos_inner, cos_outer, .. } => Light {
            position,
            strength,
            kind: LIGHT_SPOT,
            axis: direction,
            cos_outer,
            cone_scale: 1.0 / (cos_inner - cos_outer).max(0.001),
            ..base
        },
        LightKind::Directional { direction, angle_rad } => {
            // 1 - cos, without cancellation.
            let half = (0.5 * f64::from(angle_rad)).sin();
            let lift = 2.0 * half * half;
            // Directions are sampled uniformly over the disc, whose mean cosine to its centre is 1 - lift / 2. A
            // surface that faces the centre must receive the given irradiance.
            let strength = light.strength * (1.0 / (1.0 - 0.5 * lift)) as f32;
            Light { position: -direction, radius: lift as f32, strength, ..base }
        }
    }
}

/// Bounds the position and the emission cone of a point, spot or sphere light.
fn local_bounds(light: &scene::Light) -> Bounds {
    let (position, cone) = match light.kind {
        LightKind::Spot { position, direction, cos_inner, cos_outer, .. } => {
            let [inner, outer] = [cos_inner, cos_outer].map(|c| f64::from(c).clamp(-1.0, 1.0).acos());
            let emission = (outer - inner).clamp(0.0, FRAC_PI_2);
            // The emission angle is at most a right angle, and the cone of normals takes the rest.
            let normals = (outer - emission).max(0.0);
            (position, Cone { axis: direction.as_dvec3().normalize(), normals, emission, two_sided: false })
        }
        LightKind::Point { position, .. } | LightKind::Directional { direction: position, .. } => (position, Cone::ALL),
    };
    let radius = f64::from(radius(light));
    Bounds { corners: [position.as_dvec3(); 3], radius, cone, power: luminance(light.strength) }
}

/// Returns the light and the bounds of an emissive triangle. Normal and area are computed in f64, since f32 loses those
/// of slivers.
fn triangle_light(prim: u32, t: &Triangle, radiance: f64, two_sided: bool) -> (Light, Bounds) {
    let corners = [t.v0, t.v1, t.v2].map(|v| v.as_dvec3());
    let cross = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let area = 0.5 * cross.length();
    let axis = cross.try_normalize().unwrap_or(DVec3::Z);
    let cone = Cone { axis, normals: 0.0, emission: FRAC_PI_2, two_sided };
    let light = Light { kind: LIGHT_TRIANGLE, prim, axis: axis.as_vec3(), radius: area as f32, ..Light::default() };
    (light, Bounds { corners, radius: 0.0, cone, power: area * radiance })
}

/// Fills in the alias table over directional lights, weighted by irradiance. `first` is the index of the first of them
/// among all lights.
fn set_picks(lights: &mut [Light], first: u32) {
    let power: Vec<f64> = lights.iter().map(|l| luminance(l.strength)).collect();
    let total: f64 = power.iter().sum();
    if total.is_nan() || total <= 0.0 {
        return;
    }
    for ((light, entry), p) in lights.iter_mut().zip(alias::table(&power)).zip(&power) {
        light.keep = entry.keep;
        light.alias_index = first + entry.alias;
        light.pick = (p / total) as f32;
    }
}

/// Returns the number of table rows that nodes take.
pub(super) fn rows(nodes: &[Node]) -> u32 {
    (size_of_val(nodes) / ROW_BYTES) as u32
}

/// Appends 32-bit words to a table of nodes, padded to whole nodes.
pub(super) fn append(table: &mut Vec<Node>, words: &[u32]) {
    for words in words.chunks(size_of::<Node>() / 4) {
        let mut whole = Node::default();
        whole[..words.len()].copy_from_slice(words);
        table.push(whole);
    }
}
