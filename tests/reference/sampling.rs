//! Random numbers, and directions sampled with them.

use std::f64::consts::TAU;

use glam::DVec3;

const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Output function of SplitMix64 (Steele, Lea & Flood 2014).
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn unit_from_bits(bits: u64) -> f64 {
    (bits >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
}

/// SplitMix64, one generator per (seed, stream); a stream is a pixel.
pub struct Rng {
    state: u64,
    point: Option<LatticePoint>,
}

/// A point of a lattice, whose coordinates are drawn one after another.
struct LatticePoint {
    /// Van der Corput's radical inverse of the point's number, in units of 2^-64.
    step: u64,
    shift: u64,
    drawn: usize,
}

/// Generating vector of a rank-1 lattice of up to 2^20 points (`exod2_base2_m20` of Kuo and Nuyens; Cools, Kuo &
/// Nuyens, "Constructing embedded lattice rules for multivariate integration", SIAM J. Sci. Comput. 28(6), 2006). Any
/// vector gives the same mean, and a good one less noise.
const GENERATOR: [u64; 40] = [
    1, 182667, 469891, 498753, 110745, 446247, 250185, 118627, 245333, 283199, 408519, 391023, 246327, 126539, 399185,
    461527, 300343, 69681, 516695, 436179, 106383, 238523, 413283, 70841, 47719, 300129, 113029, 123925, 410745,
    211325, 17489, 511893, 40767, 186077, 519471, 255369, 101819, 243573, 66189, 152143,
];

impl Rng {
    pub fn new(seed: u64, stream: u64) -> Self {
        let state = mix(mix(seed.wrapping_add(GOLDEN)) ^ mix(stream.wrapping_mul(GOLDEN)));
        Self { state, point: None }
    }

    /// Draws the first uniform numbers from the point `index` of an extensible lattice, shifted at random by `seed`
    /// (Cranley & Patterson 1976). 2^k points with one seed, starting at a multiple of 2^k, give less noise than
    /// independent numbers. Each point has the same distribution.
    pub fn of_lattice(seed: u64, index: u64) -> Self {
        let shift = Self::new(seed, 0).state;
        let state = mix(shift ^ mix(index.wrapping_add(GOLDEN)));
        Self { state, point: Some(LatticePoint { step: index.reverse_bits(), shift, drawn: 0 }) }
    }

    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }

    /// Returns a uniform number in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        let Some((generator, point)) = self.point.as_mut().and_then(|p| Some((GENERATOR.get(p.drawn)?, p))) else {
            return unit_from_bits(self.bits());
        };
        point.drawn += 1;
        let shift = mix(point.shift.wrapping_add(GOLDEN.wrapping_mul(point.drawn as u64)));
        unit_from_bits(point.step.wrapping_mul(*generator).wrapping_add(shift))
    }

    /// Returns a normal deviate by Box & Muller (1958).
    pub fn normal(&mut self) -> f64 {
        let (radius, angle) = ((-2.0 * (1.0 - self.uniform()).ln()).sqrt(), TAU * self.uniform());
        radius * angle.cos()
    }

    pub fn uniforms<const N: usize>(&mut self) -> [f64; N] {
        std::array::from_fn(|_| self.uniform())
    }
}

/// Returns a number in [0, 1) that depends only on `ray_key` and `triangle`. Candidates along a ray are decided
/// independently of one another and of the order of traversal.
pub fn uniform_of_candidate(ray_key: u64, triangle: usize) -> f64 {
    unit_from_bits(mix(ray_key ^ mix((triangle as u64).wrapping_mul(GOLDEN))))
}

/// Returns two unit vectors that form an orthonormal base with the unit vector `n`.
pub fn tangents(n: DVec3) -> (DVec3, DVec3) {
    let least = match n.abs() {
        a if a.x <= a.y && a.x <= a.z => DVec3::X,
        a if a.y <= a.z => DVec3::Y,
        _ => DVec3::Z,
    };
    let t = n.cross(least).normalize();
    (t, n.cross(t))
}

fn around(axis: DVec3, cos_theta: f64, sin_theta: f64, phi: f64) -> DVec3 {
    let (t, b) = tangents(axis);
    (t * (phi.cos() * sin_theta) + b * (phi.sin() * sin_theta) + axis * cos_theta).normalize()
}

/// Samples a direction with density cos θ / π around the unit vector `n`, from two uniform numbers.
pub fn cosine_direction(n: DVec3, [sin2, turn]: [f64; 2]) -> DVec3 {
    around(n, (1.0 - sin2).sqrt(), sin2.sqrt(), TAU * turn)
}

/// Samples a direction uniformly in the cone around `axis` with half-angle θ, with density 1 / (2π (1 − cos θ)). The
/// parameter 1 − cos θ keeps precision for narrow cones.
pub fn cone_direction(axis: DVec3, one_minus_cos: f64, rng: &mut Rng) -> DVec3 {
    let drop = one_minus_cos * rng.uniform();
    let sin_theta = (drop * (2.0 - drop)).max(0.0).sqrt();
    around(axis, 1.0 - drop, sin_theta, TAU * rng.uniform())
}

/// Samples barycentric weights uniformly over a triangle's area.
pub fn triangle_weights(rng: &mut Rng) -> [f64; 3] {
    let root = rng.uniform().sqrt();
    let v = rng.uniform();
    [1.0 - root, root * (1.0 - v), root * v]
}
