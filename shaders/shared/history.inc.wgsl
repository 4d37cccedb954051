// Finds the pixels of the previous frame that show a pixel's surface: the four around the image point where the surface
// was, each validated by position and normal.

//!include frame projection pack motion mirrored

// Minimum sum of the weights of valid pixels that counts as history.
const LEAST_FOUND: f32 = 0.01;

// Four pixels around an image point.
struct Around {
    base: vec2<i32>,
    fraction: vec2<f32>,
    // Rows that may be read: the first, and the one after the last.
    low: i32,
    high: i32,
    // Maximum distance from the surface's plane at which a pixel counts as the same surface; below 0 if the image point
    // is behind the eye.
    reach: f32,
    // For polar images: the image point's column, and the view's `fovea_rows`.
    column: f32,
    fovea_rows: f32,
}

// The four pixels around `seen`, the image point and depth at which `eye` saw the surface of a pixel in row `row`.
fn pixels_around(seen: vec3<f32>, row: u32, eye: View) -> Around {
    let size = vec2<f32>(f32(pass_.width), f32(pass_.height));
    let corner = clamp(seen.xy - frame.camera.centre, vec2<f32>(-2.0), size + 1.0);
    let base = floor(corner);
    let rows = rows_around(seen.y, eye.fovea_rows, eye.rows);
    let low = max(max(i32(pass_.valid_begin), rows.x), i32(row) - i32(frame.history.rows));
    let high = min(min(i32(pass_.valid_end), rows.y), i32(row) + i32(frame.history.rows) + 1);
    return Around(vec2<i32>(base), corner - base, low, high, select(-1.0, 0.005 * seen.z, seen.z > 0.0), seen.x, eye.fovea_rows);
}

// One of the four pixels: its index, and its bilinear weight, which is 0 if it may not be read.
struct Corner {
    at: u32,
    weight: f32,
}

fn corner_of(around: Around, i: i32) -> Corner {
    let offset = vec2<i32>(i & 1, i >> 1u);
    var there = around.base + offset;
    var fraction = around.fraction;
    if IS_POLAR {
        let column = column_in(there.y, around.column, around.fovea_rows) - frame.camera.centre.x;
        fraction.x = fract(column);
        there.x = column_held(around.fovea_rows, there.y, i32(floor(column)) + offset.x);
    }
    let inside = around.reach >= 0.0 && there.x >= 0 && there.x < i32(pass_.width)
        && there.y >= around.low && there.y < around.high && !are_lost(there.y, there.y + 1);
    let near = select(fraction, 1.0 - fraction, offset == vec2<i32>(0));
    let at = select(0u, u32(there.y) * pass_.width + u32(there.x), inside);
    return Corner(at, select(0.0, near.x * near.y, inside));
}

// A pixel's surface in the previous frame, by its `guide` or, in dynamic scenes, `last_surface`.
struct Before {
    // A point on its plane.
    position: vec3<f32>,
    normal: vec3<f32>,
    // Where it was seen: its position or, in mirrors, its image.
    image: vec3<f32>,
}

fn surface_before(pixel: vec2<u32>, hit: vec4<u32>, bits: vec4<u32>) -> Before {
    let normal = unpack_normal(bits.w);
    if HAS_MOTION {
        return Before(point_of_last(bits), normal, image_of_last(pass_.view, bits));
    }
    let position = bitcast<vec3<f32>>(bits.xyz);
    return Before(position, normal, image_point(pass_.view, pixel, hit, position));
}

// Whether a pixel's guide shows that surface.
fn shows(guide: vec4<u32>, before: Before, reach: f32) -> bool {
    let off = abs(dot(before.normal, bitcast<vec3<f32>>(guide.xyz) - before.position));
    return guide.w != NO_NORMAL && off < reach && dot(before.normal, unpack_normal(guide.w)) > 0.9;
}
