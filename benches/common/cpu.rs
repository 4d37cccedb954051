//! Traversal of obvhs with its own triangle test, on all cores.

use std::sync::Mutex;

use diptych::accel::{Accel, Triangle};
use obvhs::cwbvh::CwBvh;
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;

use super::{BenchRay, Case};

/// Number of rays that a thread takes at once.
const CHUNK: usize = 1024;

pub struct Cpu {
    tree: CwBvh,
    triangles: Vec<RtTriangle>,
}

impl Cpu {
    pub fn new(accel: &Accel) -> Self {
        let tree = CwBvh { nodes: bytemuck::cast_slice(&accel.nodes).to_vec(), ..Default::default() };
        let triangle = |t: &Triangle| RtTriangle::new(t.v0.into(), t.v1.into(), t.v2.into());
        Self { tree, triangles: accel.triangles.iter().map(triangle).collect() }
    }

    /// Returns the bits of the distance and the triangle of each ray; for shadow rays, a hit flag and zero.
    pub fn trace(&self, rays: &[BenchRay], case: Case) -> Vec<[u32; 2]> {
        let mut hits = vec![[0, u32::MAX]; rays.len()];
        let chunks = Mutex::new(hits.chunks_mut(CHUNK).zip(rays.chunks(CHUNK)));
        let take = || chunks.lock().expect("no thread panics while it holds it").next();
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        std::thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    while let Some((hits, rays)) = take() {
                        for (hit, ray) in hits.iter_mut().zip(rays) {
                            *hit = self.trace_one(ray, case);
                        }
                    }
                });
            }
        });
        hits
    }

    fn trace_one(&self, ray: &BenchRay, case: Case) -> [u32; 2] {
        if ray.t_max == 0.0 {
            return [0, u32::MAX];
        }
        let from = Ray::new(ray.origin.into(), ray.direction.into(), 0.0, ray.t_max);
        let test = |ray: &Ray, i: usize| self.triangles[i].intersect(ray);
        if case == Case::Shadow {
            return [u32::from(!self.tree.ray_traverse_miss(from, test)), u32::MAX];
        }
        let mut hit = RayHit::none();
        self.tree.ray_traverse(from, &mut hit, test);
        [hit.t.to_bits(), hit.primitive_id]
    }
}
