//! Rays of a scene, and the CPU and GPU sides that trace them.

mod cpu;
mod gpu;

pub use cpu::Cpu;
pub use gpu::Gpu;

use bytemuck::{Pod, Zeroable};
use diptych::accel::{Accel, Layout};
use diptych::image::Extent;
use diptych::scene::Scene;
use diptych::scene::load::load_shot;
use diptych::scene::rig::Eye;
use diptych::tables::SceneTables;
use glam::{DVec3, Vec3};

/// `BenchRay` in `rays.wgsl`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct BenchRay {
    pub origin: Vec3,
    /// Length of the ray; 0 after the end of a path.
    pub t_max: f32,
    pub direction: Vec3,
    pub pad: f32,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Case {
    /// Rays through the centres of the left eye's pixels.
    Primary,
    /// Primary rays and up to five cosine-distributed bounces each.
    Paths,
    /// Shadow rays from each of the paths' surfaces back to the eye.
    Shadow,
}

impl Case {
    pub const ALL: [Self; 3] = [Self::Primary, Self::Paths, Self::Shadow];

    pub fn name(self) -> &'static str {
        match self {
            Self::Primary => "primary",
            Self::Paths => "paths",
            Self::Shadow => "shadow",
        }
    }

    pub fn segments(self) -> usize {
        if self == Self::Primary { 1 } else { SEGMENTS }
    }
}

const SEGMENTS: usize = 6;
const FAR: f32 = 3.0e38;

pub struct Workload {
    pub extent: Extent,
    /// Acceleration structure of the flattened scene.
    pub accel: Accel,
    scene: Scene,
    primary: Vec<BenchRay>,
}

/// Returns a number in [0, 1) per index (splitmix64).
fn random(index: u64) -> f64 {
    let mut z = index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 * 2f64.powi(-53)
}

impl Workload {
    /// # Panics
    /// If the shot cannot be read or built.
    pub fn load(shot: &str, extent: Extent) -> Self {
        let (parsed, scene) = load_shot(shot).unwrap_or_else(|e| panic!("{shot}: {e}"));
        let accel = Accel::build_with(&scene, Layout::Flat).unwrap_or_else(|e| panic!("{shot}: {e}"));
        let view = parsed.rig.view(0.0, Eye::LEFT);
        let mut primary = Vec::with_capacity(extent.area());
        for y in 0..extent.height {
            for x in 0..extent.width {
                let direction = view.ray_direction(f64::from(x) + 0.5, f64::from(y) + 0.5, extent).as_vec3();
                primary.push(BenchRay { origin: view.origin, t_max: FAR, direction, pad: 0.0 });
            }
        }
        Self { extent, accel, scene, primary }
    }

    /// # Panics
    /// If the scene cannot be laid out like that.
    pub fn tables(&self, layout: Layout) -> SceneTables {
        let accel = Accel::build_with(&self.scene, layout).expect("the scene can be laid out like that");
        SceneTables::new(&self.scene, accel).expect("the scene has tables")
    }

    /// Returns the rays of a case: one image of rays per segment, one after another.
    pub fn rays(&self, cpu: &Cpu, case: Case) -> Vec<BenchRay> {
        if case == Case::Primary {
            return self.primary.clone();
        }
        let mut all = Vec::new();
        let mut segment = self.primary.clone();
        for depth in 0..case.segments() {
            let hits = cpu.trace(&segment, Case::Primary);
            let pairs = segment.iter().zip(&hits).enumerate();
            let key = |i: usize| 2 * (depth * segment.len() + i) as u64;
            let next = pairs.map(|(i, (ray, &[t, prim]))| self.bounce(ray, f32::from_bits(t), prim, key(i))).collect();
            if case == Case::Paths {
                all.extend(&segment);
            } else {
                all.extend(segment.iter().zip(&next).map(|(from, ray): (_, &BenchRay)| self.back(from, ray)));
            }
            segment = next;
        }
        all
    }

    /// Returns the ray from a surface, which `next` leaves, back to the eye.
    fn back(&self, from: &BenchRay, next: &BenchRay) -> BenchRay {
        if next.t_max == 0.0 || from.t_max == 0.0 {
            return BenchRay::default();
        }
        let way = self.primary[0].origin - next.origin;
        let distance = way.length();
        BenchRay { origin: next.origin, t_max: distance * 0.999, direction: way / distance, pad: 0.0 }
    }

    fn bounce(&self, ray: &BenchRay, t: f32, prim: u32, key: u64) -> BenchRay {
        if ray.t_max == 0.0 || prim == u32::MAX {
            return BenchRay::default();
        }
        let triangle = &self.accel.triangles[prim as usize];
        let cross = (triangle.v1 - triangle.v0).cross(triangle.v2 - triangle.v0).as_dvec3().normalize();
        let normal = if cross.dot(ray.direction.as_dvec3()) > 0.0 { -cross } else { cross };
        let (z, phi) = (1.0 - 2.0 * random(key), std::f64::consts::TAU * random(key + 1));
        let r = (1.0 - z * z).max(0.0).sqrt();
        let direction = (normal + DVec3::new(r * phi.cos(), r * phi.sin(), z)).try_normalize().unwrap_or(normal);
        let hit = ray.origin.as_dvec3() + ray.direction.as_dvec3() * f64::from(t);
        let origin = hit + normal * (1e-5 * hit.abs().max_element().max(f64::from(t)));
        BenchRay { origin: origin.as_vec3(), t_max: FAR, direction: direction.as_vec3(), pad: 0.0 }
    }
}
