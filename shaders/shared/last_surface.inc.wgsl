// Position of a surface point in the previous frame.

//!include frame tables scene

struct LastSurface {
    position: vec3<f32>,
    normal: vec3<f32>,
    has_moved: bool,
}

// World-space corners of a triangle in the previous frame.
fn last_triangle(place: Placed) -> array<vec3<f32>, 3> {
    // Rows below the first deforming one wrap around to large numbers.
    let deforming = place.row - frame.geometry.first_deforming;
    if deforming < frame.geometry.deforming_count {
        let at = frame.tables.last_corners + 3u * deforming;
        return array<vec3<f32>, 3>(
            bitcast<vec3<f32>>(table_row(at).xyz),
            bitcast<vec3<f32>>(table_row(at + 1u).xyz),
            bitcast<vec3<f32>>(table_row(at + 2u).xyz),
        );
    }
    let tri = stored_triangle(place.row);
    if !HAS_INSTANCES {
        return array<vec3<f32>, 3>(tri.v0, tri.v1, tri.v2);
    }
    let m = affine_at(place.instance + LAST_WORLD_FROM_LOCAL);
    return array<vec3<f32>, 3>(transform_point(m, tri.v0), transform_point(m, tri.v1), transform_point(m, tri.v2));
}

// Transfers a vector from one triangle to another, by its components along two edges and the normal, so that it turns
// and stretches with the triangle.
fn brought_along(v: vec3<f32>, edge1: vec3<f32>, edge2: vec3<f32>, to_edge1: vec3<f32>, to_edge2: vec3<f32>) -> vec3<f32> {
    let scale = power_scale(max(max(abs(edge1), abs(edge2)), max(abs(to_edge1), abs(to_edge2))));
    let e1 = edge1 * scale;
    let e2 = edge2 * scale;
    let to1 = to_edge1 * scale;
    let to2 = to_edge2 * scale;
    let n = cross(e1, e2);
    let last_n = cross(to1, to2);
    let size2 = dot(n, n);
    let last_size2 = dot(last_n, last_n);
    let a = dot(cross(v, e2), n) / size2;
    let b = dot(cross(e1, v), n) / size2;
    let c = dot(v, n) * inverseSqrt(size2 * last_size2);
    let there = a * to1 + b * to2 + c * last_n;
    return select(v, normalize(there), size2 > 0.0 && last_size2 > 0.0 && dot(there, there) > 0.0);
}

fn last_surface(prim: u32, bary: vec2<f32>, position: vec3<f32>, normal: vec3<f32>) -> LastSurface {
    let place = placed(prim);
    let now = triangle_at(place);
    let last = last_triangle(place);
    // Static surfaces keep their exact position.
    let moved = array<vec3<f32>, 3>(last[0] - now.v0, last[1] - now.v1, last[2] - now.v2);
    if all(moved[0] == vec3<f32>(0.0)) && all(moved[1] == vec3<f32>(0.0)) && all(moved[2] == vec3<f32>(0.0)) {
        return LastSurface(position, normal, false);
    }
    let shift = (1.0 - bary.x - bary.y) * moved[0] + bary.x * moved[1] + bary.y * moved[2];
    let turned = brought_along(normal, now.v1 - now.v0, now.v2 - now.v0, last[1] - last[0], last[2] - last[0]);
    return LastSurface(position + shift, turned, true);
}
