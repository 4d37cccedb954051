// Bilateral filter across the seams between stripes that were filtered separately (Leria et al.). Rows near a seam are
// smoothed, and all others are copied.

//!include frame grid projection split pack edges bindings

const REACH: i32 = i32(SEAM_REACH);

fn is_near(row: u32, seam: u32) -> bool {
    return seam > 0u && seam < pass_.height && abs(i32(row) * 2 + 1 - i32(seam) * 2) < 2 * REACH;
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let centre = unpack_light(source[at]);
    let bits = guide_image[at];
    if bits.w == NO_NORMAL || !(is_near(pixel.y, pass_.row_begin) || is_near(pixel.y, pass_.row_end)) {
        filtered[at] = source[at];
        return;
    }
    let guide = guide_for(bits, frame.camera.views[pass_.view].origin, 0.01);
    let colour = comparable(unmarked(centre.matte) + unmarked(centre.gloss));
    let inverse_sigma2 = pass_.args.inverse_sigma2;
    var matte = MeanLight();
    var gloss = MeanLight();
    for (var dy = -REACH; dy <= REACH; dy += 1) {
        for (var dx = -REACH; dx <= REACH; dx += 1) {
            let there = beside(pixel, vec2<i32>(dx, dy));
            let tap = pixel_index(vec2<u32>(there.pixel));
            let value = unpack_light(source[tap]);
            let near = exp(-f32(dx * dx + dy * dy) / 8.0);
            let w = near * edge_weight(guide, colour, guide_image[tap], unmarked(value.matte) + unmarked(value.gloss), inverse_sigma2);
            let k = select(0.0, w, there.is_there);
            matte = with_light(matte, value.matte, k);
            gloss = with_light(gloss, value.gloss, k);
        }
    }
    filtered[at] = pack_light(SplitLight(mean_light(matte, 0.0), mean_light(gloss, 0.0), centre.a));
}
