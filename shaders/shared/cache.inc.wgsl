// Paths that end in the radiance cache, and what they record for it.
//
// At its first surface, a path samples lights and bounces as without the cache. At a later one, it ends if it has spread
// over more than a cell and if earlier frames have filled the cell. Some paths record the light that they find in a
// cell, and the next frame reads it.

//!include frame rng math tables surface bsdf cells pack

override HAS_CACHE: bool = false;

// Recording mode of a path. It records nothing, the light in its first cell if the cache does not know it, or that light
// in any case.
const NO_RECORD: u32 = 0u;
const MAY_RECORD: u32 = 1u;
const MUST_RECORD: u32 = 2u;

// In each segment of RECORD_SEGMENT pixels of a row, either the left or the right half may record. Drivers that run eight
// lanes together then trace long paths together.
const RECORD_LANES: u32 = RECORD_SEGMENT / 2u;
// One in this many halves must record.
const MUST_RECORD_ONE_IN: u32 = 8u;

// Minimum number of samples of a cell in which paths end.
const ENOUGH_SAMPLES: f32 = 16.0;
// Minimum perceptual roughness of a surface whose reflected light hardly depends on the direction.
const ENOUGH_ROUGHNESS: f32 = 0.25;
// Paths with less throughput record nothing, since dividing by it is inaccurate.
const LEAST_THROUGHPUT: f32 = 1e-3;

// Maximum width of a cube as a fraction of its distance from the left eye. At least half of it is used, since widths
// are powers of two.
const CELL_ANGLE: f32 = 0.05;

// State of a path.
struct CachePath {
    recording: u32,
    // Whether a bounce has spread the path over more than a cell.
    is_spread: bool,
    length: f32,
    // The recorded cell, and the surface's albedo, the path's throughput and its light when it arrived there.
    cell: u32,
    albedo: vec3<f32>,
    throughput: vec3<f32>,
    light: vec3<f32>,
}

struct Cached {
    is_known: bool,
    // Reflected light over albedo.
    light: vec3<f32>,
}

// Width of the cube at `p`, which is at least 2^-22 of the largest coordinate, so that cubes can be numbered.
fn cell_width(p: vec3<f32>) -> f32 {
    let far = max3(abs(p));
    let away = length(p - frame.camera.views[0].origin);
    let most = max(max(CELL_ANGLE * away, 0x1p-22 * far), 0x1p-60);
    // Without its mantissa, a number is the largest power of two that is no larger.
    return bitcast<f32>(bitcast<u32>(most) & 0x7f800000u);
}

// Key of the cell of a point in a cube of this width. Light of another number of reflections has cells of its own.
fn cell_key(p: vec3<f32>, n: vec3<f32>, width: f32) -> u32 {
    let size = abs(n);
    let is_x = size.x >= size.y && size.x >= size.z;
    let axis = select(select(2u, 1u, size.y >= size.z), 0u, is_x);
    let side = select(0u, 3u, n[axis] < 0.0);
    let cube = bitcast<vec3<u32>>(vec3<i32>(floor(p / width)));
    let level = bitcast<u32>(width) >> 23u;
    let place = hash_combine(hash_combine(cube.x, cube.y), cube.z);
    let kind = (frame.sampling.reflections << 11u) | (level * 6u + axis + side);
    return max(hash_combine(place, kind), 1u);
}

// Packs light or albedo as RGB9E5: 9 bits per channel and a shared exponent. Brighter light than that of half floats is clamped.
fn pack_cell(light: vec3<f32>) -> u32 {
    let c = clamp(light, vec3<f32>(0.0), vec3<f32>(65408.0));
    let exponent = u32(clamp(frexp(max3(c)).exp + 15, 0, 31));
    let m = vec3<u32>(min(round(ldexp(c, vec3<i32>(24 - i32(exponent)))), vec3<f32>(511.0)));
    return m.x | (m.y << 9u) | (m.z << 18u) | (exponent << 27u);
}

fn recording_of(pixel: vec2<u32>, view: u32, sample: u32) -> u32 {
    let segment = pixel.x / RECORD_SEGMENT;
    let hash = hash_combine(hash_combine(hash_combine(frame.sampling.seed, frame.sampling.index), pixel.y), segment);
    let is_other_half = (pixel.x / RECORD_LANES) % 2u != hash % 2u;
    if !HAS_CACHE || view != 0u || sample != 0u || is_other_half {
        return NO_RECORD;
    }
    return select(MAY_RECORD, MUST_RECORD, (hash >> 1u) % MUST_RECORD_ONE_IN == 0u);
}

fn record_index(pixel: vec2<u32>) -> u32 {
    let segments = (pass_.width + RECORD_SEGMENT - 1u) / RECORD_SEGMENT;
    return (pixel.y * segments + pixel.x / RECORD_SEGMENT) * RECORD_LANES + pixel.x % RECORD_LANES;
}

// Light that the cache knows for a surface that the path hits at distance `t` after the bounce `b`. It is looked up at a
// random point near by, so that cells show no edges.
fn enter_cell(path: ptr<function, CachePath>, s: Surface, b: BsdfSample, t: f32, throughput: vec3<f32>, light: vec3<f32>, key: u32) -> Cached {
    let width = cell_width(s.position);
    (*path).is_spread = (*path).is_spread || (!b.is_delta && t * t > 4.0 * width * width * b.pdf);
    (*path).length += t;
    let flags = stored_material(s.material).flags;
    let has_smooth_coat = HAS_CLEARCOAT && s.coat > 0.0 && s.coat_alpha < ENOUGH_ROUGHNESS * ENOUGH_ROUGHNESS;
    let is_smooth = s.roughness < ENOUGH_ROUGHNESS || has_smooth_coat || (flags & (MIRROR | CLEAR_GLASS)) != 0u;
    if !(*path).is_spread || (*path).length <= 2.0 * width || is_smooth {
        return Cached();
    }
    let has_recorded = (*path).cell != NO_CELL;
    if (*path).recording != MUST_RECORD && !has_recorded {
        let hash = pcg_hash(key ^ 0x68bc21ebu);
        let u = vec2<f32>(unit_float(hash), unit_float(pcg_hash(hash))) - 0.5;
        let near = s.position + frame_around(s.geometric_normal) * vec3<f32>(u * width, 0.0);
        let found = cell_key(near, s.geometric_normal, width);
        let cell = live_cell(cell_slot(found));
        if cell.key == found && cell.samples >= ENOUGH_SAMPLES {
            return Cached(true, cell.light / frame.display.storage_scale);
        }
    }
    if (*path).recording != NO_RECORD && !has_recorded {
        (*path).cell = cell_key(s.position, s.geometric_normal, width);
        (*path).albedo = s.albedo;
        (*path).throughput = throughput;
        (*path).light = light;
    }
    return Cached();
}

// Record of a path that has ended: cell, and the light and the albedo of its surface, packed. Light is in the cache's
// unit.
fn record_of(path: CachePath, light: vec3<f32>) -> vec3<u32> {
    let least = min(min(path.throughput.x, path.throughput.y), path.throughput.z);
    if path.cell == NO_CELL || least < LEAST_THROUGHPUT {
        return vec3<u32>(NO_CELL, 0u, 0u);
    }
    let found = (light - path.light) / path.throughput * frame.display.storage_scale;
    let record = vec3<u32>(path.cell, pack_cell(found), pack_cell(path.albedo));
    return select(vec3<u32>(NO_CELL, 0u, 0u), record, is_finite(found));
}
