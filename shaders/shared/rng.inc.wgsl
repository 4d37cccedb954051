// Random numbers, keyed only on (seed, frame, eye, pixel of the full frame, sample, dimension).
//
// `sobol`: a two-dimensional Sobol' sequence per pair of dimensions, Owen-scrambled and index-shuffled by hashing
// (Burley, "Practical Hash-based Owen Scrambling", JCGT 9(4), 2020, with his Laine-Karras constants). It needs no
// table: the second dimension's matrix is Pascal's triangle mod 2, that is the substitution x -> x + 1 in a polynomial
// over GF(2), which five masked shifts compute. Sample counts up to 2^32 work. Pixels share the sequences of a frame,
// in Z-order: whatever the scrambling, the pixels of a 2^k x 2^k block take their samples from one well-distributed
// part of a sequence. Their errors cancel, so that the error over the image is blue noise (Ahmed & Wonka, "Screen-Space
// Blue-Noise Diffusion of Monte Carlo Sampling Error via Hierarchical Ordering of Pixels", ACM TOG 39(6), 2020, with
// the binary shuffle above instead of their quaternary one). In accumulations, whose final sample count is unknown,
// each pixel has its own sequences. `pcg`: independent numbers by hashing (Jarzynski & Olano, "Hash Functions for GPU
// Rendering", JCGT 9(3), 2020).

//!include frame

override SOBOL: bool = true;

struct Rng {
    key: u32,
    sample: u32,
    dimension: u32,
}

fn pcg_hash(value: u32) -> u32 {
    let state = value * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

fn hash_combine(a: u32, b: u32) -> u32 {
    return pcg_hash(a ^ pcg_hash(b + 0x9e3779b9u));
}

// Generator for a sample of a pixel in this frame. `sample` counts from the frame's first sample.
fn rng_for(pixel: vec2<u32>, view: u32, sample: u32) -> Rng {
    return rng_in(frame.sampling, pixel, view, sample);
}

// Generator for a sample of a pixel in a frame with the constants `sampling`.
fn rng_in(sampling: Sampling, pixel: vec2<u32>, view: u32, sample: u32) -> Rng {
    let key = hash_combine(hash_combine(sampling.seed, sampling.index), view);
    let number = sampling.samples.first + sample;
    if SOBOL && sampling.samples.curve_shift < NO_CURVE {
        let place = spread_bits(pixel.x) | (spread_bits(pixel.y) << 1u);
        return Rng(key, (place << sampling.samples.curve_shift) | number, 0u);
    }
    return Rng(hash_combine(hash_combine(key, pixel.x), pixel.y), number, 0u);
}

// Spreads the lower 16 bits to the even bit positions, which gives a coordinate's part of a Z-order index.
fn spread_bits(value: u32) -> u32 {
    var x = value & 0xffffu;
    x = (x | (x << 8u)) & 0x00ff00ffu;
    x = (x | (x << 4u)) & 0x0f0f0f0fu;
    x = (x | (x << 2u)) & 0x33333333u;
    return (x | (x << 1u)) & 0x55555555u;
}

fn unit_float(bits: u32) -> f32 {
    return f32(bits >> 8u) * 0x1p-24f;
}

// Owen scrambling of a bit-reversed number.
fn laine_karras(value: u32, seed: u32) -> u32 {
    var x = value + seed;
    x ^= x * 0x6c50b47cu;
    x ^= x * 0xb82f1e52u;
    x ^= x * 0xc7afe638u;
    x ^= x * 0x8d22f6e6u;
    return x;
}

// p(x + 1) of the polynomial over GF(2) whose coefficients are the bits of `p`.
fn shift_polynomial(p: u32) -> u32 {
    var v = p;
    v ^= (v >> 1u) & 0x55555555u;
    v ^= (v >> 2u) & 0x33333333u;
    v ^= (v >> 4u) & 0x0f0f0f0fu;
    v ^= (v >> 8u) & 0x00ff00ffu;
    v ^= (v >> 16u) & 0x0000ffffu;
    return v;
}

// Key of the generator's current ray, for `is_covered`.
fn alpha_key(rng: Rng) -> u32 {
    return rng.key + rng.sample * 0x9e3779b9u + rng.dimension * 0x85ebca6bu;
}

// The next two dimensions, each in [0, 1).
fn random2(rng: ptr<function, Rng>) -> vec2<f32> {
    let seed = hash_combine((*rng).key, (*rng).dimension);
    (*rng).dimension += 1u;
    if SOBOL {
        let index = reverseBits(laine_karras(reverseBits((*rng).sample), seed));
        let x = reverseBits(laine_karras(index, pcg_hash(seed ^ 0x68bc21ebu)));
        let y = reverseBits(laine_karras(shift_polynomial(index), pcg_hash(seed ^ 0x02e5be93u)));
        return vec2<f32>(unit_float(x), unit_float(y));
    }
    let x = hash_combine(seed, (*rng).sample);
    return vec2<f32>(unit_float(x), unit_float(pcg_hash(x ^ 0x5bd1e995u)));
}
