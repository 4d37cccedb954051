// Spatial reprojection, right eye from left (Adelson & Hodges 1993; Leria et al.): each right pixel gathers the light
// that the left eye saw on its surface (see `reprojection.inc.wgsl`). A pixel without any valid tap becomes a hole. If a
// sampling mask leaves pixels to the filter, left pixels that were not sampled are invalid taps, and only right pixels in
// the right eye's own mask become holes. With foveation, taps may differ more from the surface in the outer layers.

//!include frame grid projection split pack foveation gather new_list bindings

// Lists a hole if the right eye's sampling mask contains it (`wanted`), and otherwise leaves it to the filter.
fn open_hole(at: u32, why: u32, wanted: bool) {
    if SPARSE && !wanted {
        tally_image[at] |= SKIPPED << 28u;
        return;
    }
    tally_image[at] |= why << 28u;
    append(at, LIST_GROUP);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let hit = hit_image[at];
    let guide = guide_image[at];
    radiance_image[at] = vec4<u32>(0u);
    var is_wanted = true;
    var slack = 1.0;
    var is_full = true;
    if FOVEATED {
        let layer = layer_of(pixel, 1u);
        is_full = layer == INNER;
        slack = f32(1u << layer);
    }
    if SPARSE {
        is_full = is_full && frame.sampling.sampled_fraction >= 1.0;
        // Filters do not fill a pixel without a surface at its centre.
        is_wanted = guide.w == NO_NORMAL || is_sampled(pixel, 1u);
    }
    if (hit.w & FLAG_MIXED) != 0u && (!ACCEPTS_MIXED || guide.w == NO_NORMAL) {
        open_hole(at, MIXED, is_wanted);
        return;
    }
    if guide.w == NO_NORMAL {
        return;
    }
    if (hit.w & FLAG_VIEW_DEPENDENT) != 0u {
        open_hole(at, VIEW, is_wanted);
        return;
    }
    let wanted = wanted_by(pixel, hit, guide, slack);
    let seen = pixel_of(wanted.image, frame.camera.views[0]);
    if seen.z <= 0.0 {
        open_hole(at, OUTSIDE, is_wanted);
        return;
    }
    let found = gathered(seen.xy, pixel.y, wanted);
    var why = found.why;
    if found.sum < LEAST_SUM {
        if SPARSE && found.was_skipped {
            // The left eye's mask skips the surface. Unless the right eye's mask samples all pixels here, leave the
            // pixel to the filter: neighbouring pixels gather samples of the left eye, so the area around this pixel
            // has as many samples as intended.
            is_wanted = is_full;
            why = OUTSIDE;
        }
        open_hole(at, why, is_wanted);
        return;
    }
    radiance_image[at] = pack_gathered(found);
}
