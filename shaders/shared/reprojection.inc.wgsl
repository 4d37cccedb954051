// Look-up of a right pixel's surface in the left image. The eyes are rectified, so both taps lie on the pixel's own row.
// Polar images use four taps, at most `reach` rows away. Surfaces in plane mirrors are looked up at their image, which
// lies on the same row in both eyes; other mirrors give holes.

//!include frame projection pack mirrored bindings

// Whether pixels that show several surfaces take over light, for a filter that blends light at edges anyway. Their mean
// albedo is that of all surfaces.
override ACCEPTS_MIXED: bool = false;

// Number of taps.
fn taps() -> i32 {
    return select(2, 4, IS_POLAR);
}

// Surface of a right pixel, as the left eye is searched for it.
struct Wanted {
    position: vec3<f32>,
    normal: vec3<f32>,
    // Position or, in mirrors, the image point.
    image: vec3<f32>,
    // Distance of the image from the left eye.
    reach: f32,
    material: u32,
    // Factor by which taps may differ more than in the innermost layer.
    slack: f32,
}

// Relative difference, and difference over `reach`, of two distances that count as equal.
const SAME_RATIO: f32 = 0.05;
const SAME_DISTANCE: f32 = 0.0005;
// Cosine of the angle between two normals of one surface. Pixels of thin and curved parts differ by up to 26 degrees
// from their neighbours, and light of such neighbours has no more error than a path of their own.
const LEAST_COSINE: f32 = 0.9;

// Whether a mirrored surface of the left eye is as far from the wanted one as their images are from one another. This
// holds for plane mirrors, which keep distances. Curved mirrors scale them, and show the surface elsewhere.
fn keeps_distance(at: u32, hit: vec4<u32>, position: vec3<f32>, wanted: Wanted) -> bool {
    let pixel = vec2<u32>(at % pass_.width, at / pass_.width);
    let apart = length(image_point(0u, pixel, hit, position) - wanted.image);
    let off = abs(length(position - wanted.position) - apart);
    return off <= wanted.slack * (SAME_RATIO * apart + SAME_DISTANCE * wanted.reach);
}

// The surface of a right pixel by its `hit` and `guide`.
fn wanted_by(pixel: vec2<u32>, hit: vec4<u32>, guide: vec4<u32>, slack: f32) -> Wanted {
    let position = bitcast<vec3<f32>>(guide.xyz);
    let image = image_point(1u, pixel, hit, position);
    let reach = length(image - frame.camera.views[0].origin);
    return Wanted(position, unpack_normal(guide.w), image, reach, hit.w & MATERIAL_MASK, slack);
}

// Returns the reason that a tap does not show the surface; 0 if it does.
fn surface_differs(tap: Tap, wanted: Wanted) -> u32 {
    if !tap.is_there {
        return OUTSIDE;
    }
    let at = tap.at;
    let hit = left_hit[at];
    if !ACCEPTS_MIXED && (hit.w & FLAG_MIXED) != 0u {
        return MIXED;
    }
    if (hit.w & FLAG_VIEW_DEPENDENT) != 0u {
        return VIEW;
    }
    let guide = left_guide[at];
    if (hit.w & MATERIAL_MASK) != wanted.material || guide.w == NO_NORMAL {
        return MATERIAL;
    }
    let position = bitcast<vec3<f32>>(guide.xyz);
    if abs(dot(wanted.normal, position - wanted.position)) >= 0.005 * wanted.slack * wanted.reach {
        return DISTANCE;
    }
    if dot(wanted.normal, unpack_normal(guide.w)) <= LEAST_COSINE {
        return NORMAL;
    }
    if is_mirrored(hit) && !keeps_distance(at, hit, position, wanted) {
        return VIEW;
    }
    return 0u;
}

// A pixel of the left image around a point, with its linear weight.
struct Tap {
    at: u32,
    weight: f32,
    is_there: bool,
}

// The `i`th tap around image point `seen` of the left eye, for a pixel in row `row` of the right eye.
fn tap_around(seen: vec2<f32>, row: u32, i: i32) -> Tap {
    if IS_POLAR {
        let eye = frame.camera.views[0];
        let y = clamp(seen.y - frame.camera.centre.y, -2.0, eye.rows + 1.0);
        let there = i32(floor(y)) + (i >> 1u);
        let rows = rows_around(seen.y, eye.fovea_rows, eye.rows);
        let low = max(max(i32(pass_.valid_begin), rows.x), i32(row) - i32(pass_.args.reach));
        let high = min(min(i32(pass_.valid_end), rows.y), i32(row) + i32(pass_.args.reach) + 1);
        let x = column_in(there, seen.x, eye.fovea_rows) - frame.camera.centre.x;
        let column = column_held(eye.fovea_rows, there, i32(floor(x)) + (i & 1));
        let near = abs(vec2<f32>(f32(1 - (i & 1)), f32(1 - (i >> 1u))) - fract(vec2<f32>(x, y)));
        let is_there = there >= low && there < high;
        return Tap(select(0u, u32(there) * pass_.width + u32(column), is_there), near.x * near.y, is_there);
    }
    let x = clamp(seen.x - frame.camera.centre.x, -2.0, f32(pass_.width) + 1.0);
    let there = i32(floor(x)) + i;
    let is_there = there >= 0 && there < i32(pass_.width);
    let at = row * pass_.width + u32(clamp(there, 0, i32(pass_.width) - 1));
    return Tap(at, select(fract(x), 1.0 - fract(x), i == 0), is_there);
}
