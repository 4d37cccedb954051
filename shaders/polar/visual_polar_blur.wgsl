// Blurs a visual-polar image along one of its axes as far as acuity allows (Koskela et al. 2019, section 3): not at all
// in the fovea, and from there on by a Gaussian whose deviation grows up to BLUR_FULL_DEG. Departure: the image is
// blurred before it is mapped to the screen, while it has fewer pixels.

//!include frame grid grid_visual_polar grid_polar bindings

// Maximum standard deviation of the blur, relative to the tangent of half the vertical field of view. It is 6.8 pixels
// of an image 1440 pixels high, whose height is 2 in this unit.
const MOST_DEVIATION: f32 = 2.0 * 6.8 / 1440.0;
const BLUR_FULL_DEG: f32 = 30.0;
// Radius of the kernel, in standard deviations; and smallest standard deviation, in pixels, that is worth a blur.
const REACH: f32 = 2.5;
const LEAST_DEVIATION: f32 = 0.3;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let along_columns = pass_.args.axis == 0u;
    let fovea_rows = frame.camera.views[pass_.view].fovea_rows;
    let e = eccentricity_near(f32(pixel.y) + 0.5, fovea_rows);
    let share = clamp((e - FOVEA_DEG) / (BLUR_FULL_DEG - FOVEA_DEG), 0.0, 1.0);
    let angle = share * MOST_DEVIATION * frame.camera.views[pass_.view].tan_half_y;
    let deviation = angle * select(rows_per_radian(e, fovea_rows), columns_per_radian(pixel.y, e, fovea_rows), along_columns);
    if deviation < LEAST_DEVIATION {
        blurred[at] = source[at];
        return;
    }
    let reach = min(i32(ceil(REACH * deviation)), i32(pass_.args.reach));
    var sum = vec3<f32>(0.0);
    var weight = 0.0;
    for (var i = -reach; i <= reach; i += 1) {
        let there = beside(pixel, select(vec2<i32>(0, i), vec2<i32>(i, 0), along_columns));
        let off = f32(i) / deviation;
        let w = select(0.0, exp(-0.5 * off * off), there.is_there);
        sum += source[pixel_index(vec2<u32>(there.pixel))].rgb * w;
        weight += w;
    }
    blurred[at] = vec4<f32>(sum / weight, 1.0);
}
