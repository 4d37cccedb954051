// Cells of the radiance cache: a hash table of the light that surfaces reflect, divided by their albedo.
//
// A cell holds the surface points in a cube whose geometric normals have the same largest component, with the same sign.
// Cubes are larger the farther they are from the left eye, so that scenes of any scale have about as many cells.

//!include frame bindings

// Key of no cell, and of an empty slot.
const NO_CELL: u32 = 0u;

// Factor from albedo, and from light, to the integers that are summed. Light is in units in which white is near 1 at the
// run's exposure: radiance times `storage_scale`.
const RECORD_UNITS: f32 = 0x1p24;

// Slot of a cell. The key has 32 bits and the slot is its lowest bits, so with 2^17 slots an unknown cell is taken for the
// one in its slot with a probability of 2^-15.
fn cell_slot(key: u32) -> u32 {
    return key % (arrayLength(&last_cache) / 3u);
}

// A slot of the cache takes three rows. The first has the key, the number of samples, the number of frames since the
// latest, and the number of reflections of the paths. The second has the sum of light over the sum of albedo, and the
// third has that sum of albedo.
struct Cell {
    key: u32,
    samples: f32,
    age: u32,
    reflections: u32,
    light: vec3<f32>,
    albedo: vec3<f32>,
}

// Frames after which a cell without new samples loses its slot. Another cell may take it sooner if no path of this frame
// can end in it, because they have another number of reflections.
const MOST_AGE: u32 = 64u;
const MOST_AGE_OF_OTHERS: u32 = 4u;

// The cell in a slot after the previous frame; none if the slot is empty or its cell is too old.
fn live_cell(slot: u32) -> Cell {
    let a = last_cache[3u * slot];
    if frame.history.rows == NO_HISTORY || a.z >= MOST_AGE {
        return Cell();
    }
    let light = bitcast<vec3<f32>>(last_cache[3u * slot + 1u].xyz);
    let albedo = bitcast<vec3<f32>>(last_cache[3u * slot + 2u].xyz);
    return Cell(a.x, bitcast<f32>(a.y), a.z, a.w, light, albedo);
}

// Whether a new cell may take the slot of `cell`.
fn yields(cell: Cell) -> bool {
    return cell.key == NO_CELL || (cell.reflections != frame.sampling.reflections && cell.age >= MOST_AGE_OF_OTHERS);
}
