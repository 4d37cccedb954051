// Temporal gradients (Schied, Peters & Dachsbacher, "Gradient Estimation for Real-Time Adaptive Temporal Filtering",
// 2018): for each tile, one path of the previous frame is traced again in the current scene. It starts at the same
// point of the surface, even if the surface has moved, and uses the same random numbers. Any difference is a change of
// light. Departures:
// - The surface of a pixel of the current frame is tracked back to the previous frame. The paper projects surfaces of
//   the previous frame forwards.
// - The retraced paths are additional. In the paper, they replace paths of the current frame.
// - Frames of several samples per pixel, which store only the mean of their light, trace one path more per tile: a probe,
//   which the next frame traces again.
// - There are no gradients in mirrors and behind glass.

//!include frame grid projection rng tables trace surface split path cache bounces pack motion mirrored bindings

// `gradient` compares the luminance of demodulated illumination between the two frames. Component x: current minus
// previous luminance. Component y: the larger of both.

// Luminance of diffuse and specular light together, clamped so that sums over tiles stay finite.
fn all_luminance(light: SplitLight) -> f32 {
    let both = luminances(light);
    return both.x + both.y;
}

// Of so many rows of tiles, one has probes.
const PROBED_ROWS: u32 = 4u;
// Value of tiles without a probe.
const NO_PROBE: f32 = -1.0;
// Probes have random numbers of their own, which are those of no eye.
const PROBE_VIEW: u32 = 2u;

// A path that starts on the surface of a pixel.
struct Retraced {
    is_there: bool,
    // Values of the pixel in the images `hit` and `guide`.
    hit: vec4<u32>,
    position: vec3<f32>,
    origin: vec3<f32>,
    pixel: vec2<u32>,
    // View whose random numbers the path has.
    view: u32,
    // Luminance of its light in the previous frame.
    then: f32,
}

// Whether a frame has probes: whether pixels have several samples.
fn has_probes(sampling: Sampling) -> bool {
    return sampling.samples.is_jittered != 0u || sampling.samples.extra > 0.0;
}

// Whether a frame with probes has one in a tile. Rows of tiles take turns, so that lanes that run together do the same
// work. Gradients are smoothed over more rows than these.
fn is_probed(sampling: Sampling, tile: vec2<u32>) -> bool {
    return (tile.y + sampling.index) % PROBED_ROWS == 0u;
}

// Whether the light of a pixel comes from paths that start on the surface of its G-buffer. Paths of polished surfaces may
// start at what these reflect.
fn starts_there(hit: vec4<u32>, guide: vec4<u32>) -> bool {
    if guide.w == NO_NORMAL || is_mirrored(hit) || (hit.x & SPHERE) != 0u {
        return false;
    }
    return !HAS_POLISH || (stored_material(hit.w & MATERIAL_MASK).flags & POLISHED) == 0u;
}

// The pixel of a tile whose path is traced again, in an image of `size` pixels. It changes from frame to frame.
fn picked(index: u32, tile: vec2<u32>, size: vec2<u32>) -> vec2<u32> {
    let pick = hash_combine(hash_combine(index, tile.x), tile.y) % (TILE * TILE);
    return min(tile * TILE + vec2<u32>(pick % TILE, pick / TILE), size - 1u);
}

// The probe of `pixel`, which is of `tile`, in this frame.
fn probe_of(tile: vec2<u32>, pixel: vec2<u32>, size: vec2<u32>) -> Retraced {
    let hit = hit_image[pixel.y * size.x + pixel.x];
    let guide = guide_image[pixel.y * size.x + pixel.x];
    let is_there = has_probes(frame.sampling) && is_probed(frame.sampling, tile) && starts_there(hit, guide);
    let origin = frame.camera.views[0].origin;
    return Retraced(is_there, hit, bitcast<vec3<f32>>(guide.xyz), origin, pixel, PROBE_VIEW, 0.0);
}

// The path of the previous frame that starts on the surface of `pixel`, where or near where that frame saw it.
fn last_path_of(tile: vec2<u32>, pixel: vec2<u32>, size: vec2<u32>) -> Retraced {
    let last = last_surface[pixel.y * size.x + pixel.x];
    if last.w == NO_NORMAL || was_mirrored(last) || frame.history.rows == NO_HISTORY {
        return Retraced();
    }
    let eye = previous.views[0];
    let position = bitcast<vec3<f32>>(last.xyz);
    // `pixel_of` returns a position on this pass's grid, which is that of tiles. Scale it to pixels.
    let point = pixel_of(position, eye);
    var seen = vec2<i32>(floor(point.xy / vec2<f32>(f32(pass_.width), f32(pass_.height)) * vec2<f32>(size)));
    let reach = i32(frame.history.rows);
    var low = max(i32(pass_.valid_begin * TILE), i32(pixel.y) - reach);
    var high = min(min(i32(pass_.valid_end * TILE), i32(size.y)), i32(pixel.y) + reach + 1);
    if point.z <= 0.0 || seen.x < 0 || seen.x >= i32(size.x) || seen.y < low || seen.y >= high {
        return Retraced();
    }
    var then = 0.0;
    var view = 0u;
    if has_probes(previous.sampling) {
        let last_tile = vec2<u32>(seen) / TILE;
        then = last_probe[last_tile.y * pass_.width + last_tile.x];
        view = PROBE_VIEW;
        seen = vec2<i32>(picked(previous.sampling.index, last_tile, size));
        // The rows of this tile, and as many around it as history reaches.
        low = max(i32(pass_.valid_begin * TILE), i32(tile.y * TILE) - reach);
        high = min(min(i32(pass_.valid_end * TILE), i32(size.y)), i32((tile.y + 1u) * TILE) + reach);
        if then < 0.0 || seen.y < low || seen.y >= high {
            return Retraced();
        }
    }
    if are_lost(seen.y, seen.y + 1) {
        return Retraced();
    }
    let there = u32(seen.y) * size.x + u32(seen.x);
    let guide = last_guide[there];
    let hit = last_hit[there];
    let normal = unpack_normal(last.w);
    let off = abs(dot(normal, bitcast<vec3<f32>>(guide.xyz) - position));
    let is_same = off < 0.01 * point.z && dot(unpack_normal(guide.w), normal) > 0.9;
    if !starts_there(hit, guide) || !is_same {
        return Retraced();
    }
    if view == 0u {
        if last_radiance[there].w == 0u {
            return Retraced();
        }
        then = all_luminance(unpack_sampled(last_radiance[there]));
    }
    return Retraced(true, hit, bitcast<vec3<f32>>(guide.xyz), eye.origin, vec2<u32>(seen), view, then);
}

// Demodulated illumination that a path finds in the current scene, with the settings of its frame.
fn light_of(path: Retraced, is_probe: bool) -> SplitLight {
    var sampling = previous.sampling;
    if is_probe {
        sampling = frame.sampling;
    }
    let direction = normalize(path.position - path.origin);
    let first = surface_at(path.hit.x, bitcast<vec2<f32>>(path.hit.yz), path.origin, direction);
    var rng = rng_in(sampling, path.pixel, path.view, 0u);
    let found = trace_path(first, direction, medium_before(first, OUTSIDE_OF_VOLUMES), sampling, 0u, NO_RECORD, &rng);
    // Samples that are dropped are black.
    if was_cut_short || !is_finite(found.radiance) || !is_finite(found.gloss) {
        return SplitLight();
    }
    let radiance = scaled(found.radiance);
    var packed = pack_sampled(over(radiance, first.albedo), vec3<f32>(0.0));
    if HAS_GLOSS {
        packed = pack_sampled(over(radiance, first.matte), over(scaled(found.gloss), first.albedo - first.matte));
    }
    // Pack and unpack the light, so that it is rounded like the stored light that it is compared with.
    return unpack_sampled(packed);
}

@compute @workgroup_size(8, 4)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let tile = vec2<u32>(id.x, pass_.row_begin + id.y);
    if tile.x >= pass_.width || tile.y >= pass_.row_end {
        return;
    }
    let at = pixel_index(tile);
    let size = vec2<u32>(pass_.args.width, pass_.args.height);
    let pixel = picked(frame.sampling.index, tile, size);
    let is_probe = pass_.args.of_probes != 0u;
    var path = Retraced();
    if is_probe {
        probe[at] = NO_PROBE;
        path = probe_of(tile, pixel, size);
    } else {
        gradient[at] = vec2<f32>(0.0);
        path = last_path_of(tile, pixel, size);
    }
    if !path.is_there {
        return;
    }
    let now = all_luminance(light_of(path, is_probe));
    if is_probe {
        probe[at] = now;
        return;
    }
    let value = vec2<f32>(now - path.then, max(now, path.then));
    gradient[at] = select(vec2<f32>(0.0), value, is_finite(value.xyy));
}
