// Cells of the radiance cache: a hash table of the light that surfaces reflect, divided by their albedo.
//
// A cell holds the surface points in a cube whose geometric normals have the same largest component, with the same sign.
// Cubes are larger the farther they are from the left eye, so that scenes of any scale have about as many cells.

// Key of no cell, and of an empty slot.
const NO_CELL: u32 = 0u;

// Factor from light, in units of white at the run's exposure, to the integers that are summed.
const LIGHT_UNITS: f32 = 0x1p24;

fn cell_slot(key: u32) -> u32 {
    return key % CACHE_SLOTS;
}

// A slot of the cache takes two rows. The first has the key, the number of samples and the number of frames since the
// latest; the second has the mean light.
struct Cell {
    key: u32,
    samples: f32,
    age: u32,
    light: vec3<f32>,
}

fn unpack_cell(a: vec4<u32>, b: vec4<u32>) -> Cell {
    return Cell(a.x, bitcast<f32>(a.y), a.z, bitcast<vec3<f32>>(b.xyz));
}

// A channel of packed light as a 64-bit integer in LIGHT_UNITS: low and high word.
fn light_units(packed: u32, channel: u32) -> vec2<u32> {
    let m = (packed >> (9u * channel)) & 511u;
    let exponent = packed >> 27u;
    return vec2<u32>(m << exponent, select(0u, m >> (32u - exponent), exponent > 0u));
}
