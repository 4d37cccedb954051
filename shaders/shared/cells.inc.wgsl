// Cells of the radiance cache: a hash table of the light that surfaces reflect, divided by their albedo.
//
// A cell holds the surface points in a cube whose geometric normals have the same largest component, with the same sign.
// Cubes are larger the farther they are from the left eye, so that scenes of any scale have about as many cells.

// Key of no cell, and of an empty slot.
const NO_CELL: u32 = 0u;

// Factor from light, in units of white at the run's exposure, to the integers that are summed.
const LIGHT_UNITS: f32 = 0x1p24;

// Slot of a cell. The key has 32 bits and the slot is its lowest bits, so with 2^17 slots an unknown cell is taken for the
// one in its slot with a probability of 2^-15.
fn cell_slot(key: u32) -> u32 {
    return key % (arrayLength(&last_cache) / 2u);
}

// A slot of the cache takes two rows. The first has the key, the number of samples and the number of frames since the
// latest; the second has the mean light.
struct Cell {
    key: u32,
    samples: f32,
    age: u32,
    light: vec3<f32>,
}

// The cell in a slot after the previous frame.
fn last_cell(slot: u32) -> Cell {
    let a = last_cache[2u * slot];
    let b = last_cache[2u * slot + 1u];
    return Cell(a.x, bitcast<f32>(a.y), a.z, bitcast<vec3<f32>>(b.xyz));
}

// Frames after which a cell without new samples loses its slot.
const MOST_AGE: u32 = 64u;

// The cell of earlier frames that keeps a slot; none if the slot is empty or its cell is too old.
fn live_cell(slot: u32) -> Cell {
    let cell = last_cell(slot);
    if frame.history.rows == NO_HISTORY || cell.age >= MOST_AGE {
        return Cell();
    }
    return cell;
}
