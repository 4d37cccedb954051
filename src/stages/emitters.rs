//! The table of lights that paths choose from: emissive triangles, local lights (spheres first), directional lights,
//! each picked in proportion to its power, and the grid over an environment image.

use glam::{DVec3, Vec3};

use super::alias;
use super::layout::{LIGHT_SPOT, Light};
use crate::accel::Accel;
use crate::image::RgbImage;
use crate::scene::{self, LightKind, Material, Scene};

/// Cells of the grid over an environment image; `ENV_GRID` in `lights.inc.wgsl`.
const ENV_GRID: [usize; 2] = [512, 256];

pub struct Emitters {
    pub lights: Vec<Light>,
    /// First light and number of lights per group.
    pub group_begin: [u32; 4],
    pub group_count: [u32; 4],
    pub sphere_count: u32,
    /// Groups that are not empty.
    pub groups: u32,
    /// Per material: density per area of picking a point on one of its triangles.
    pub light_pdf: Vec<f32>,
    /// (keep, alias, relative density, 0) per cell, or none.
    pub env_alias: Vec<[f32; 4]>,
}

/// Rec. 709 luminance.
fn luminance(c: Vec3) -> f64 {
    f64::from(c.x) * 0.2126 + f64::from(c.y) * 0.7152 + f64::from(c.z) * 0.0722
}

/// Power per area that a material sends out, up to a factor common to all.
fn emitted(scene: &Scene, material: &Material) -> f64 {
    let tint =
        material.emissive_texture.map_or(Vec3::ONE, |t| mean_color(&scene.images[scene.textures[t.texture].image]));
    luminance(material.emissive * tint) * if material.double_sided { 2.0 } else { 1.0 }
}

fn mean_color(image: &scene::TexelImage) -> Vec3 {
    let mut sum = [0.0f64; 3];
    for texel in &image.pixels {
        for (s, &code) in sum.iter_mut().zip(texel) {
            *s += f64::from(super::scene_tables::linear_from_srgb(code));
        }
    }
    Vec3::from_array(sum.map(|s| (s / image.pixels.len().max(1) as f64) as f32))
}

impl Emitters {
    pub fn new(scene: &Scene, accel: &Accel) -> Self {
        let per_area: Vec<f64> = scene.materials.iter().map(|m| emitted(scene, m)).collect();
        let mut triangles = Vec::new();
        let mut power = Vec::new();
        for (prim, t) in accel.triangles.iter().enumerate() {
            let weight = f64::from(t.area()) * per_area[t.material as usize];
            if weight > 0.0 {
                triangles.push(Light { prim: prim as u32, ..Light::default() });
                power.push(weight);
            }
        }
        let total: f64 = power.iter().sum();
        let light_pdf = per_area.iter().map(|p| if total > 0.0 { (p / total) as f32 } else { 0.0 }).collect();
        let (mut spheres, mut points, mut directional) = (Vec::new(), Vec::new(), Vec::new());
        for light in scene.lights.iter().filter(|l| l.strength != Vec3::ZERO) {
            match light.kind {
                LightKind::Directional { .. } => directional.push(gpu_light(light, accel.origin)),
                _ if radius(light) > 0.0 => spheres.push(gpu_light(light, accel.origin)),
                _ => points.push(gpu_light(light, accel.origin)),
            }
        }
        let sphere_count = spheres.len() as u32;
        spheres.extend(points);
        let groups = [triangles, with_picks(spheres, local_area), with_picks(directional, |_| 1.0)];
        Self::assemble(scene, groups, power, light_pdf, sphere_count)
    }

    fn assemble(
        scene: &Scene,
        mut groups: [Vec<Light>; 3],
        power: Vec<f64>,
        light_pdf: Vec<f32>,
        sphere_count: u32,
    ) -> Self {
        set_picks(&mut groups[0], &power);
        let mut out = Self {
            lights: Vec::new(),
            group_begin: [0; 4],
            group_count: [0; 4],
            sphere_count,
            groups: 0,
            light_pdf,
            env_alias: Vec::new(),
        };
        for (i, group) in groups.into_iter().enumerate() {
            out.group_begin[i] = out.lights.len() as u32;
            out.group_count[i] = group.len() as u32;
            out.groups += u32::from(!group.is_empty());
            out.lights.extend(group);
            // Aliases count from the table's beginning.
            for light in &mut out.lights[out.group_begin[i] as usize..] {
                light.alias += out.group_begin[i];
            }
        }
        if let scene::Environment::Map { image, .. } = &scene.environment {
            out.env_alias = env_grid(image);
            out.groups += u32::from(!out.env_alias.is_empty());
        }
        out
    }
}

fn radius(light: &scene::Light) -> f32 {
    match light.kind {
        LightKind::Point { radius, .. } | LightKind::Spot { radius, .. } => radius,
        LightKind::Directional { .. } => 0.0,
    }
}

fn gpu_light(light: &scene::Light, origin: DVec3) -> Light {
    let near = |position: Vec3| (position.as_dvec3() - origin).as_vec3();
    let base = Light { strength: light.strength, radius: radius(light), ..Light::default() };
    let strength = match radius(light) {
        r if r > 0.0 => light.strength / (std::f32::consts::PI * r * r),
        _ => light.strength,
    };
    match light.kind {
        LightKind::Point { position, .. } => Light { position: near(position), strength, ..base },
        LightKind::Spot { position, direction, cos_inner, cos_outer, .. } => Light {
            position: near(position),
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
            // Directions are drawn evenly over the disc, which a surface that faces its middle sees at a mean cosine of
            // 1 - lift / 2: that surface is to have the given irradiance.
            let strength = light.strength * (1.0 / (1.0 - 0.5 * lift)) as f32;
            Light { position: -direction, radius: lift as f32, strength, ..base }
        }
    }
}

/// Sets picks by power; `area` turns a light's strength into it.
fn with_picks(mut lights: Vec<Light>, area: fn(&Light) -> f64) -> Vec<Light> {
    let power: Vec<f64> = lights.iter().map(|l| luminance(l.strength) * area(l)).collect();
    set_picks(&mut lights, &power);
    lights
}

/// Radiant intensity per strength, times the share of the sphere that a spot lights.
fn local_area(l: &Light) -> f64 {
    let disc = if l.radius > 0.0 { std::f64::consts::PI * f64::from(l.radius).powi(2) } else { 1.0 };
    let cone = if l.kind == LIGHT_SPOT { 0.5 * (1.0 - f64::from(l.cos_outer)) } else { 1.0 };
    disc * cone
}

fn set_picks(lights: &mut [Light], power: &[f64]) {
    let total: f64 = power.iter().sum();
    if lights.is_empty() || total <= 0.0 {
        return;
    }
    for ((light, entry), p) in lights.iter_mut().zip(alias::table(power)).zip(power) {
        light.keep = entry.keep;
        light.alias = entry.alias;
        light.pick = (p / total) as f32;
    }
}

/// Weights by the luminance that the image holds in each cell, times the cell's solid angle.
fn env_grid(image: &RgbImage) -> Vec<[f32; 4]> {
    let [gw, gh] = ENV_GRID;
    let (w, h) = (image.extent.width as usize, image.extent.height as usize);
    let mut weights = vec![0.0f64; gw * gh];
    // Twice the finer of the two resolutions, so that neither texels nor cells are missed.
    let (sx, sy) = ((2 * w.max(gw)).div_ceil(gw) * gw, (2 * h.max(gh)).div_ceil(gh) * gh);
    for y in 0..sy {
        let sin_theta = (std::f64::consts::PI * (y as f64 + 0.5) / sy as f64).sin();
        for x in 0..sx {
            let texel = image.pixels[(y * h / sy) * w + x * w / sx];
            let l = luminance(Vec3::from_array(texel)).max(0.0);
            weights[(y * gh / sy) * gw + x * gw / sx] += l * sin_theta;
        }
    }
    let total: f64 = weights.iter().sum();
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    let density = weights.len() as f64 / total;
    let entries = alias::table(&weights);
    entries.iter().zip(&weights).map(|(e, w)| [e.keep, e.alias as f32, (w * density) as f32, 0.0]).collect()
}
