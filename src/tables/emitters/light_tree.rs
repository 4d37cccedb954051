//! A bounding hierarchy that samples lights by their importance to a point: Conty Estevez & Kulla, "Importance Sampling
//! of Many Lights with Adaptive Tree Splitting", HPG 2018, with the cone arithmetic of Pharr, Jakob & Humphreys, PBRT
//! 4e, 12.6.3.
//!
//! Departures from both: a node stores a bounding sphere instead of a bounding box, since the importance only needs
//! the sphere. The two children of a node are adjacent and the axis is quantised, so that a node takes 32 bytes.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec3, Vec2, Vec3};

use crate::layout::{LIGHT_LEAF, LIGHT_LEVELS, LIGHT_TWO_SIDED};

const BINS: usize = 12;

/// Minimum power of a node relative to the total power. It keeps products with the power from underflowing in f32.
const LEAST_POWER: f64 = 1e-25;

/// Margin subtracted from the cosine of every bounding angle. It exceeds the rounding errors of the shader's f32
/// comparisons.
const SLACK: f64 = 4e-5;

/// A packed node. A tree over n lights has 2 n - 1 nodes.
pub(super) type Node = [u32; 8];

/// Cone of the normals of a light, and the angle around them into which it emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cone {
    pub axis: DVec3,
    /// Maximum angle between the axis and a normal, in radians. `emission` is the maximum angle between a normal and an
    /// emitted direction.
    pub normals: f64,
    pub emission: f64,
    /// Whether the opposite cone emits too.
    pub two_sided: bool,
}

impl Cone {
    /// A cone that emits in all directions.
    pub const ALL: Self = Self { axis: DVec3::Z, normals: PI, emission: FRAC_PI_2, two_sided: false };

    /// Returns a cone that contains both (PBRT 4e, 3.8.4).
    fn union(self, other: Self) -> Self {
        let (a, b) = if self.normals >= other.normals { (self, other) } else { (other, self) };
        let two_sided = a.two_sided || b.two_sided;
        let emission = a.emission.max(b.emission);
        // The nearer side of a two-sided cone suffices.
        let towards = if two_sided && a.axis.dot(b.axis) < 0.0 { -b.axis } else { b.axis };
        let between = angle(a.axis, towards);
        if (between + b.normals).min(PI) <= a.normals {
            return Self { emission, two_sided, ..a };
        }
        let normals = 0.5 * (a.normals + between + b.normals);
        let pivot = a.axis.cross(towards);
        if normals >= PI || pivot.length_squared() == 0.0 {
            return Self { axis: a.axis, normals: PI, emission, two_sided };
        }
        let axis = glam::DQuat::from_axis_angle(pivot.normalize(), normals - a.normals) * a.axis;
        Self { axis: axis.normalize(), normals, emission, two_sided }
    }

    /// Returns the lit solid angle, weighted by the cosine to the normals: M_Ω of Conty Estevez & Kulla, equation 1.
    fn measure(&self) -> f64 {
        let (o, w) = (self.normals, (self.normals + self.emission).min(PI));
        2.0 * PI * (1.0 - o.cos()) + FRAC_PI_2 * (2.0 * w * o.sin() - (o - 2.0 * w).cos() - 2.0 * o * o.sin() + o.cos())
    }

    /// Returns the maximum angle between `axis` and this cone's normals. If `two_sided`, the normals may be closer to
    /// the opposite of `axis`, and the smaller angle counts.
    fn widest_off(&self, axis: DVec3, two_sided: bool) -> f64 {
        let off = angle(axis, self.axis);
        (if two_sided { off.min(PI - off) } else { off }) + self.normals
    }
}

fn angle(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

/// Spatial, directional and power bounds of one light, from which the tree is built.
#[derive(Clone, Copy, Debug)]
pub(super) struct Bounds {
    /// Corners of a triangle. Every point of the light is at most `radius` away from it.
    pub corners: [DVec3; 3],
    pub radius: f64,
    pub cone: Cone,
    /// Upper bound of the radiant intensity, as luminance; above 0.
    pub power: f64,
}

impl Bounds {
    fn low(&self) -> DVec3 {
        self.corners.iter().fold(DVec3::INFINITY, |low, &c| low.min(c)) - self.radius
    }

    fn high(&self) -> DVec3 {
        self.corners.iter().fold(DVec3::NEG_INFINITY, |high, &c| high.max(c)) + self.radius
    }

    fn centre(&self) -> DVec3 {
        0.5 * (self.low() + self.high())
    }
}

/// Bounds of a set of lights.
#[derive(Clone, Copy)]
struct Cluster {
    low: DVec3,
    high: DVec3,
    cone: Option<Cone>,
    power: f64,
}

impl Cluster {
    const NONE: Self = Self { low: DVec3::INFINITY, high: DVec3::NEG_INFINITY, cone: None, power: 0.0 };

    fn of<'a>(lights: impl IntoIterator<Item = &'a Bounds>) -> Self {
        lights.into_iter().fold(Self::NONE, |all, l| {
            let one = Self { low: l.low(), high: l.high(), cone: Some(l.cone), power: l.power };
            all.with(&one)
        })
    }

    fn with(&self, other: &Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            cone: match (self.cone, other.cone) {
                (Some(a), Some(b)) => Some(a.union(b)),
                (a, b) => a.or(b),
            },
            power: self.power + other.power,
        }
    }

    /// Returns the cost by which splits are compared: the product of power, lit solid angle and surface of the bounding
    /// sphere. `None` without lights.
    fn cost(&self) -> Option<f64> {
        Some(self.power * self.cone?.measure() * (self.high - self.low).length_squared())
    }
}

/// The tree, root first, and the path to each light: bit k is set if the path takes the second child at level k.
#[derive(Debug, Default)]
pub(super) struct LightTree {
    pub nodes: Vec<Node>,
    pub trails: Vec<u32>,
}

/// A node whose children have not been built yet.
struct Open {
    node: usize,
    first: usize,
    last: usize,
    depth: u32,
    trail: u32,
}

/// Builds the tree. The same lights give the same tree.
pub(super) fn build(lights: &[Bounds]) -> LightTree {
    if lights.is_empty() {
        return LightTree::default();
    }
    let total: f64 = lights.iter().map(|l| l.power).sum();
    let mut order: Vec<usize> = (0..lights.len()).collect();
    let mut tree = LightTree { nodes: vec![[0; 8]], trails: vec![0; lights.len()] };
    let mut open = vec![Open { node: 0, first: 0, last: lights.len(), depth: 0, trail: 0 }];
    while let Some(o) = open.pop() {
        let members = &mut order[o.first..o.last];
        if let [light] = *members {
            tree.nodes[o.node] = pack(lights, members, total, LIGHT_LEAF | light as u32);
            tree.trails[light] = o.trail;
            continue;
        }
        let child = tree.nodes.len();
        tree.nodes[o.node] = pack(lights, members, total, child as u32);
        tree.nodes.extend([[0; 8]; 2]);
        let middle = o.first + split(lights, members, LIGHT_LEVELS - 1 - o.depth);
        let depth = o.depth + 1;
        open.push(Open { node: child + 1, first: middle, last: o.last, depth, trail: o.trail | 1 << o.depth });
        open.push(Open { node: child, first: o.first, last: middle, depth, trail: o.trail });
    }
    tree
}

/// Partitions `members` into two children and returns the size of the first. Neither child is empty or has more than
/// 2^`levels` lights.
fn split(lights: &[Bounds], members: &mut [usize], levels: u32) -> usize {
    let centres = members.iter().map(|&i| lights[i].centre());
    let (low, high) = centres.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), c| (low.min(c), high.max(c)));
    let extent = high - low;
    if let Some((axis, bin)) = cheapest(lights, members, low, extent) {
        let (mut left, right): (Vec<_>, Vec<_>) =
            members.iter().partition(|&&i| bin_of(lights[i].centre()[axis], low[axis], extent[axis]) <= bin);
        let middle = left.len();
        if (middle.max(right.len()) as u64) <= 1u64 << levels.min(63) {
            left.extend(right);
            members.copy_from_slice(&left);
            return middle;
        }
    }
    let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
    let key = |i: &usize| lights[*i].centre()[axis];
    let middle = members.len() / 2;
    members.select_nth_unstable_by(middle, |a, b| key(a).total_cmp(&key(b)).then(a.cmp(b)));
    middle
}

fn bin_of(at: f64, low: f64, extent: f64) -> usize {
    ((BINS as f64 * (at - low) / extent) as usize).min(BINS - 1)
}

/// Returns the cheapest split (surface area orientation heuristic): its axis, and the last bin of the first child. To
/// penalise thin slices, the cost is multiplied by the ratio of the box's longest side to the side that is split.
fn cheapest(lights: &[Bounds], members: &[usize], low: DVec3, extent: DVec3) -> Option<(usize, usize)> {
    let mut best: Option<(f64, usize, usize)> = None;
    for axis in (0..3).filter(|&axis| extent[axis] > 0.0) {
        let mut bins = [Cluster::NONE; BINS];
        for &i in members {
            let bin = &mut bins[bin_of(lights[i].centre()[axis], low[axis], extent[axis])];
            *bin = bin.with(&Cluster::of([&lights[i]]));
        }
        let mut above = [Cluster::NONE; BINS];
        for i in (0..BINS - 1).rev() {
            above[i] = above[i + 1].with(&bins[i + 1]);
        }
        let mut below = Cluster::NONE;
        for i in 0..BINS - 1 {
            below = below.with(&bins[i]);
            let (Some(a), Some(b)) = (below.cost(), above[i].cost()) else { continue };
            let cost = (a + b) * extent.max_element() / extent[axis];
            if best.is_none_or(|(least, ..)| cost < least) {
                best = Some((cost, axis, i));
            }
        }
    }
    best.map(|(_, axis, bin)| (axis, bin))
}

/// Packs a node for the shader: centre, radius, power, axis, cosines, and the first child or the light.
fn pack(lights: &[Bounds], members: &[usize], total: f64, next: u32) -> Node {
    let cluster = Cluster::of(members.iter().map(|&i| &lights[i]));
    let cone = cluster.cone.unwrap_or(Cone::ALL);
    let centre = (0.5 * (cluster.low + cluster.high)).as_vec3();
    let axis = pack_axis(cone.axis.as_vec3());
    let (mut radius, mut normals) = (0.0f64, 0.0f64);
    for light in members.iter().map(|&i| &lights[i]) {
        for corner in light.corners {
            radius = radius.max(centre.as_dvec3().distance(corner) + light.radius);
        }
        normals = normals.max(light.cone.widest_off(unpack_axis(axis), cone.two_sided));
    }
    let cosine = |angle: f64| (angle.min(PI).cos() - SLACK).max(-1.0);
    let two_sided = if cone.two_sided { LIGHT_TWO_SIDED } else { 0 };
    [
        centre.x.to_bits(),
        centre.y.to_bits(),
        centre.z.to_bits(),
        // A radius too small for f32 must not become 0.
        ((radius * (1.0 + 1e-6)).max(if radius > 0.0 { f64::from(f32::MIN_POSITIVE) } else { 0.0 }) as f32).to_bits(),
        ((cluster.power / total).max(LEAST_POWER) as f32).to_bits(),
        axis,
        floor_snorm(cosine(normals)) | floor_snorm(cosine(cone.emission)) << 16,
        next | two_sided,
    ]
}

/// Rounds down to a 16-bit signed normalised number.
fn floor_snorm(value: f64) -> u32 {
    u32::from((value * 32767.0).floor().clamp(-32767.0, 32767.0) as i16 as u16)
}

/// Packs an axis octahedrally into two 16-bit signed normalised numbers (Cigolle et al., JCGT 3(2), 2014).
fn pack_axis(axis: Vec3) -> u32 {
    let on_face = axis.truncate() / (axis.x.abs() + axis.y.abs() + axis.z.abs());
    let folded = if axis.z >= 0.0 { on_face } else { (1.0 - Vec2::new(on_face.y, on_face.x).abs()) * signs(on_face) };
    let [x, y] = (folded * 32767.0).round().to_array().map(|v| u32::from(v.clamp(-32767.0, 32767.0) as i16 as u16));
    x | y << 16
}

fn unpack_axis(packed: u32) -> DVec3 {
    let [x, y] = [packed, packed >> 16].map(|v| f64::from(v as u16 as i16) / 32767.0);
    let z = 1.0 - x.abs() - y.abs();
    let fold = (-z).max(0.0);
    DVec3::new(x - fold.copysign(x), y - fold.copysign(y), z).normalize()
}

fn signs(v: Vec2) -> Vec2 {
    Vec2::new(1f32.copysign(v.x), 1f32.copysign(v.y))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns `n` one-sided, two-sided and omnidirectional lights at deterministic scattered positions.
    fn lights(n: usize, spread: f64) -> Vec<Bounds> {
        let strewn = |i: usize, k: u64| ((i as u64 * 2654435761 + k * 40503) % 1009) as f64 / 1009.0 - 0.5;
        let light = |i| {
            let at = DVec3::new(strewn(i, 1), strewn(i, 7), strewn(i, 13)) * spread;
            let axis = DVec3::new(strewn(i, 3), strewn(i, 4), strewn(i, 5) + 0.01).normalize();
            let cone = Cone { axis, normals: 0.0, emission: FRAC_PI_2, two_sided: i % 5 == 0 };
            let cone = if i % 3 == 0 { Cone::ALL } else { cone };
            let corners = [at, at + DVec3::X * 0.1, at + DVec3::Y * 0.1];
            Bounds { corners, radius: 0.01 * (i % 2) as f64, cone, power: 0.1 + (i % 7) as f64 }
        };
        (0..n).map(light).collect()
    }

    fn float(word: u32) -> f64 {
        f64::from(f32::from_bits(word))
    }

    /// Checks that each light's trail leads to it through nodes that bound it.
    fn check(lights: &[Bounds]) {
        let tree = build(lights);
        assert_eq!(tree.nodes.len(), 2 * lights.len() - 1);
        for (i, light) in lights.iter().enumerate() {
            let (mut at, mut level) = (0usize, 0);
            loop {
                let node = tree.nodes[at];
                let centre = DVec3::from_array([0, 1, 2].map(|k| float(node[k])));
                let reach = light.corners.map(|c| centre.distance(c) + light.radius).into_iter().fold(0.0, f64::max);
                assert!(reach <= float(node[3]), "light {i}, level {level}: {reach} > {}", float(node[3]));
                let cosine = |word: u32| f64::from(word as u16 as i16) / 32767.0;
                let two_sided = node[7] & LIGHT_TWO_SIDED != 0;
                let widest = light.cone.widest_off(unpack_axis(node[5]), two_sided).min(PI);
                assert!(two_sided || !light.cone.two_sided);
                assert!(cosine(node[6]) <= widest.cos() && cosine(node[6] >> 16) <= light.cone.emission.cos());
                if node[7] & LIGHT_LEAF != 0 {
                    assert_eq!((node[7] & !(LIGHT_LEAF | LIGHT_TWO_SIDED)) as usize, i);
                    break;
                }
                at = (node[7] & !LIGHT_TWO_SIDED) as usize + (tree.trails[i] >> level & 1) as usize;
                level += 1;
                assert!(level <= LIGHT_LEVELS);
            }
        }
    }

    #[test]
    fn trails_lead_to_lights_through_their_bounds() {
        for n in [1, 2, 3, 50, 3000] {
            check(&lights(n, 10.0));
        }
        check(&lights(300, 1e9));
    }

    #[test]
    fn coincident_lights_make_no_deep_tree() {
        check(&lights(3000, 0.0));
        let steps: Vec<_> = lights(200, 0.0)
            .into_iter()
            .enumerate()
            .map(|(i, l)| Bounds { corners: [DVec3::X * 0.5f64.powi(i as i32); 3], radius: 0.0, ..l })
            .collect();
        check(&steps);
    }

    #[test]
    fn axes_survive_packing() {
        for i in 0..500 {
            let axis = lights(500, 1.0)[i].cone.axis;
            assert!(angle(axis, unpack_axis(pack_axis(axis.as_vec3()))) < 1e-4);
        }
        for axis in [Vec3::X, Vec3::NEG_Z, Vec3::NEG_Y] {
            assert!(angle(axis.as_dvec3(), unpack_axis(pack_axis(axis))) < 1e-6);
        }
    }

    #[test]
    fn unions_hold_both_cones() {
        let some = lights(60, 1.0);
        for a in &some {
            for b in &some {
                let both = a.cone.union(b.cone);
                for part in [a.cone, b.cone] {
                    assert!(part.widest_off(both.axis, both.two_sided).min(PI) <= both.normals + 1e-9);
                    assert!(part.emission <= both.emission);
                }
            }
        }
    }
}
