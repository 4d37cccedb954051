// Mean of the base colour's texture over a pixel's footprint, for frames of one sample per pixel. Light is stored
// without albedo, so that the albedo of a pixel may be a mean without any change of the light.

//!include frame math tables scene parameters surface path mirror

override FILTERS_TEXTURES: bool = false;

// Maximum number of taps along each side of the footprint.
const MOST_TAPS: f32 = 2.0;

// Change of the barycentrics of `tri` for a step in its plane.
fn barycentric_step(tri: Triangle, step: vec3<f32>) -> vec2<f32> {
    let edges = scaled_edges(tri);
    let n = cross(edges.e1, edges.e2);
    let v = step * edges.scale;
    return vec2<f32>(dot(cross(v, edges.e2), n), dot(cross(edges.e1, v), n)) / max(dot(n, n), 1e-37);
}

// Change of a ray's end on a surface, for a change perpendicular to the ray.
fn on_surface(change: vec3<f32>, direction: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    return change - direction * (dot(normal, change) / dot(normal, direction));
}

// Fraction of a tap's colour that counts, by its alpha.
fn tap_weight(m: Material, alpha: f32) -> f32 {
    let masked = select(0.0, 1.0, alpha * m.base_color.a >= m.alpha_cutoff);
    return select(select(1.0, alpha, (m.flags & ALPHA_BLEND) != 0u), masked, (m.flags & ALPHA_MASK) != 0u);
}

// Changes of a ray's end from pixel to pixel, to the right and down.
struct Footprint {
    across: vec3<f32>,
    down: vec3<f32>,
}

// Footprint of a ray that mirrors or glass sent on in `direction`. They turn it, and only its shape is known. `steps` are
// the changes of the direction at the eye, of which a unit covers `spread`.
fn turned(steps: Footprint, spread: f32, direction: vec3<f32>) -> Footprint {
    let around = frame_around(direction);
    return Footprint(around[0] * (length(steps.across) * spread), around[1] * (length(steps.down) * spread));
}

// Replaces the albedo of a first hit by that of its base colour's mean over the pixel; the colour of an unlit surface
// likewise. `direction` is that of the last ray. The texture continues on the triangle's plane.
fn filter_texture(f: ptr<function, FirstHit>, direction: vec3<f32>, footprint: Footprint) {
    let hit = (*f).hit;
    if (flags_of(*f) & BASE_COLOR_TEXTURE) == 0u || is_link(*f) {
        return;
    }
    var s = (*f).surface;
    let m = stored_material(s.material);
    let place = placed(hit.prim);
    let tri = triangle_at(place);
    if abs(dot(s.geometric_normal, direction)) < 1e-3 {
        return;
    }
    let by_x = barycentric_step(tri, on_surface(footprint.across, direction, s.geometric_normal));
    let by_y = barycentric_step(tri, on_surface(footprint.down, direction, s.geometric_normal));
    let info = stored_texture(m.first_texture);
    let size = vec2<f32>(f32(info.width), f32(info.height));
    let uv = interpolate_uv(place.row, hit.bary, info);
    let uv_by_x = interpolate_uv(place.row, hit.bary + by_x, info) - uv;
    let uv_by_y = interpolate_uv(place.row, hit.bary + by_y, info) - uv;
    let columns = clamp(ceil(length(uv_by_x * size)), 1.0, MOST_TAPS);
    let rows = clamp(ceil(length(uv_by_y * size)), 1.0, MOST_TAPS);
    if !(columns * rows > 1.0) {
        return;
    }
    var sum = vec4<f32>(0.0);
    // Taps move within their parts of the pixel from frame to frame, so that TAA averages all of the footprint.
    let centre = frame.camera.centre;
    for (var row = 0.0; row < rows; row += 1.0) {
        for (var column = 0.0; column < columns; column += 1.0) {
            let at = (vec2<f32>(column, row) + centre) / vec2<f32>(columns, rows) - centre;
            let tap = sample_texture(info, uv + at.x * uv_by_x + at.y * uv_by_y);
            sum += vec4<f32>(tap.rgb, 1.0) * tap_weight(m, tap.a);
        }
    }
    if sum.a <= 0.0 {
        return;
    }
    let base = base_factor_at(place.row, hit.bary, m).rgb * (sum.rgb / sum.a);
    if HAS_UNLIT && (m.flags & UNLIT) != 0u {
        (*f).emission += (base - s.emission) * (*f).transmittance;
        return;
    }
    // Surfaces that only scatter diffusely have their base colour as albedo.
    let old = (*f).surface;
    if !all_are_lambertian() {
        var p = parameters_at(place.row, hit.bary, m);
        p.base = base;
        describe_lobes(&s, p, m, -direction);
    } else {
        s.albedo = base;
    }
    (*f).albedo += (s.albedo - old.albedo) * (*f).transmittance;
    (*f).matte += (s.matte - old.matte) * (*f).transmittance;
}
