// Light that the right eye takes over after the left eye's filter: each reprojected pixel gathers the filtered light of its
// surface (see `reprojection.inc.wgsl`), so that both eyes see the same blur and the same remaining noise. Such pixels
// are FINISHED: the right eye's own filter leaves them out and uses them for the pixels around them, the holes. Pixels
// that reflect what the surfaces in the left eye do not, for example beside a black texel, are left to the filter.

//!include frame grid projection split pack foveation variance reprojection bindings

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    filtered[at] = source[at];
    let hit = hit_image[at];
    let guide = guide_image[at];
    let reason = hole_reason(tally_image[at]);
    if guide.w == NO_NORMAL || (reason != 0u && reason != SKIPPED) || (hit.w & FLAG_VIEW_DEPENDENT) != 0u {
        return;
    }
    var slack = 1.0;
    if FOVEATED {
        slack = f32(1u << layer_of(pixel, 1u));
    }
    let wanted = wanted_by(pixel, hit, guide, slack);
    let seen = pixel_of(wanted.image, frame.camera.views[0]);
    if seen.z <= 0.0 {
        return;
    }
    var sum = 0.0;
    var matte = MeanLight();
    var gloss = MeanLight();
    for (var i = 0; i < taps(); i += 1) {
        let tap = tap_around(seen.xy, pixel.y, i);
        if tap.weight > 0.0 && surface_differs(tap, wanted) == 0u {
            let light = unpack_light(left_light[tap.at]);
            let w = select(0.0, tap.weight, light.a.x != MISSING);
            matte = with_light(matte, light.matte, w);
            gloss = with_light(gloss, light.gloss, w);
            sum += w;
        }
    }
    let found = SplitLight(mean_light(matte, 0.0), mean_light(gloss, 0.0), vec2<f32>(FINISHED));
    if sum >= 1e-4 && !lacks_light(found, unpack_albedo(albedo_image[at])) {
        filtered[at] = pack_light(found);
    }
}
