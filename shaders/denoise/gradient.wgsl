// Temporal gradients (Schied, Peters & Dachsbacher, "Gradient Estimation for Real-Time Adaptive Temporal Filtering",
// 2018): for each tile, one path of the previous frame is traced again in the current scene. It starts at the same
// point of the surface, even if the surface has moved, and uses the same random numbers. Any difference is a change of
// light. Departures:
// - The surface of a pixel of the current frame is tracked back to the previous frame. The paper projects surfaces of
//   the previous frame forwards.
// - The retraced paths are additional. In the paper, they replace paths of the current frame.
// - There are no gradients if the previous frame had several samples per pixel, and none in mirrors and behind glass.

//!include frame grid projection rng scene light_tree environment lights trace traverse hits surface bsdf split path pack mirrored samples motion bindings

// `gradient` compares the luminance of demodulated illumination between the two frames. Component x: current minus
// previous luminance. Component y: the larger of both.

// Luminance of diffuse and specular light together, clamped so that sums over tiles stay finite.
fn all_luminance(light: SplitLight) -> f32 {
    let both = luminances(light);
    return both.x + both.y;
}

// Demodulated illumination, in the current scene, of the surface that `pixel` of the previous frame saw from `origin`.
// Retraces that pixel's path.
fn light_again(hit: vec4<u32>, position: vec3<f32>, origin: vec3<f32>, pixel: vec2<u32>) -> SplitLight {
    let direction = normalize(position - origin);
    let first = surface_at(hit.x, bitcast<vec2<f32>>(hit.yz), origin, direction);
    // Use the previous frame's settings, since its quality may differ.
    var rng = rng_in(previous.sampling, pixel, 0u, 0u);
    let path = trace_path(first, direction, medium_before(first, OUTSIDE_OF_VOLUMES), previous.sampling, 0u, &rng);
    // Samples that are dropped are black.
    if was_cut_short || !is_finite(path.radiance) || !is_finite(path.gloss) {
        return SplitLight();
    }
    var packed = pack_sampled(over(path.radiance, first.albedo), vec3<f32>(0.0));
    if HAS_GLOSS {
        packed = pack_sampled(over(path.radiance, first.matte), over(path.gloss, first.albedo - first.matte));
    }
    // Pack and unpack the light, so that it is rounded like the stored light that it is compared with.
    return unpack_sampled(packed);
}

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let tile = vec2<u32>(id.x, pass_.row_begin + id.y);
    if tile.x >= pass_.width || tile.y >= pass_.row_end {
        return;
    }
    let at = pixel_index(tile);
    gradient[at] = vec2<f32>(0.0);
    let size = vec2<u32>(pass_.args[0], pass_.args[1]);
    let pick = hash_combine(hash_combine(frame.sampling.index, tile.x), tile.y) % (TILE * TILE);
    let pixel = min(tile * TILE + vec2<u32>(pick % TILE, pick / TILE), size - 1u);
    let last = last_surface[pixel.y * size.x + pixel.x];
    if last.w == NO_NORMAL || was_mirrored(last) || frame.history.rows == NO_HISTORY || previous.sampling.is_jittered != 0u {
        return;
    }
    let eye = previous.views[0];
    let position = bitcast<vec3<f32>>(last.xyz);
    // `pixel_of` returns a position on this pass's grid, which is that of tiles. Scale it to pixels.
    let point = pixel_of(position, eye);
    let seen = vec2<i32>(floor(point.xy / vec2<f32>(f32(pass_.width), f32(pass_.height)) * vec2<f32>(size)));
    let low = max(i32(pass_.valid_begin * TILE), i32(pixel.y) - i32(frame.history.rows));
    let high = min(min(i32(pass_.valid_end * TILE), i32(size.y)), i32(pixel.y) + i32(frame.history.rows) + 1);
    if point.z <= 0.0 || seen.x < 0 || seen.x >= i32(size.x) || seen.y < low || seen.y >= high || are_lost(seen.y, seen.y + 1) {
        return;
    }
    let there = u32(seen.y) * size.x + u32(seen.x);
    let guide = last_guide[there];
    let hit = last_hit[there];
    let before = last_radiance[there];
    let normal = unpack_normal(last.w);
    let off = abs(dot(normal, bitcast<vec3<f32>>(guide.xyz) - position));
    let is_same = guide.w != NO_NORMAL && off < 0.01 * point.z && dot(unpack_normal(guide.w), normal) > 0.9;
    if samples_in(previous.sampling, vec2<u32>(seen)) > 1u {
        return;
    }
    if !is_same || is_mirrored(hit) || before.w == 0u || (hit.x & SPHERE) != 0u {
        return;
    }
    // Paths of polished surfaces may start at what these reflect.
    if HAS_POLISH && (stored_material(hit.w & MATERIAL_MASK).flags & POLISHED) != 0u {
        return;
    }
    let then = all_luminance(unpack_sampled(before));
    let now = all_luminance(light_again(hit, bitcast<vec3<f32>>(guide.xyz), eye.origin, vec2<u32>(seen)));
    let value = vec2<f32>(now - then, max(now, then));
    gradient[at] = select(vec2<f32>(0.0), value, is_finite(value.xyy));
}
