// Deforms bodies, for this frame and the previous one: linear blend skinning of morphed vertices, as in glTF 2.0,
// sections 3.7.2.2 and 3.7.3. One invocation per vertex, then one per triangle. The results depend only on the two
// poses that the host provides, not on the tables of another frame.

//!include frame changed_tables bindings

// Variables:
// - `pose`: for each joint, three rows of its current matrix and three of its previous one; then a row for each weight
//   of a morph target, the current one in x and the previous one in y.
// - `skinned`: world-space vertices.
// - `boxes`: bounding boxes of nodes, then of triangles: least and largest coordinates.

struct Affine {
    x: vec4<f32>,
    y: vec4<f32>,
    z: vec4<f32>,
}

struct Skinned {
    position: vec3<f32>,
    last_position: vec3<f32>,
    normal: vec3<f32>,
    tangent: vec4<f32>,
}

// Weighted means of a vertex's joint matrices.
struct Blended {
    now: Affine,
    last: Affine,
}

fn blended(v: u32) -> Blended {
    var m = Blended();
    for (var i = 0u; i < JOINTS_PER_VERTEX; i += 1u) {
        let weight = skin_vertices[v].weights[i];
        if weight == 0.0 {
            break;
        }
        let row = skin_vertices[v].joints[i] * ROWS_PER_JOINT;
        m.now.x += weight * pose[row];
        m.now.y += weight * pose[row + 1u];
        m.now.z += weight * pose[row + 2u];
        m.last.x += weight * pose[row + 3u];
        m.last.y += weight * pose[row + 4u];
        m.last.z += weight * pose[row + 5u];
    }
    return m;
}

fn point(m: Affine, p: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(m.x.xyz, p) + m.x.w, dot(m.y.xyz, p) + m.y.w, dot(m.z.xyz, p) + m.z.w);
}

fn vector(m: Affine, v: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(dot(m.x.xyz, v), dot(m.y.xyz, v), dot(m.z.xyz, v));
}

// Transforms a normal by the matrix of cofactors, which is the inverse transpose up to a factor, and exists for
// singular matrices too.
fn normal_vector(m: Affine, n: vec3<f32>) -> vec3<f32> {
    let rows = mat3x3<f32>(cross(m.y.xyz, m.z.xyz), cross(m.z.xyz, m.x.xyz), cross(m.x.xyz, m.y.xyz));
    return n * rows;
}

fn unit_or(v: vec3<f32>, otherwise: vec3<f32>) -> vec3<f32> {
    let scaled = v * power_scale(v);
    let size2 = dot(scaled, scaled);
    return select(otherwise, scaled * inverseSqrt(max(size2, 1.0)), size2 >= 1.0);
}

fn bring(at: u32) -> Skinned {
    var position = skin_vertices[at].position;
    var last_position = position;
    var normal = skin_vertices[at].normal;
    var tangent = skin_vertices[at].tangent;
    for (var i = 0u; i < skin_vertices[at].morph_count; i += 1u) {
        let morph = skin_morphs[skin_vertices[at].first_morph + i];
        let weight = pose[skin_vertices[at].first_weight + i];
        position += weight.x * morph.position;
        last_position += weight.y * morph.position;
        normal += weight.x * morph.normal;
        tangent += vec4<f32>(weight.x * morph.tangent, 0.0);
    }
    let m = blended(at);
    let now = m.now;
    let along = unit_or(vector(now, tangent.xyz), vec3<f32>(0.0));
    return Skinned(
        point(now, position),
        point(m.last, last_position),
        normal_vector(now, normal),
        vec4<f32>(along, tangent.w),
    );
}

fn set_row(row: u32, v: vec3<f32>, w: u32) {
    set_table_row(row, vec4<u32>(bitcast<vec3<u32>>(v), w));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let i = id.x + id.y * COLUMNS;
    if i >= pass_.args.count {
        return;
    }
    if pass_.args.of_vertices != 0u {
        skinned[i] = bring(i);
        return;
    }
    let first_box = pass_.args.first_box;
    let t = skin_triangles[i];
    let a = skinned[t.corners.x];
    let b = skinned[t.corners.y];
    let c = skinned[t.corners.z];
    let row = frame.geometry.first_deforming + i;
    let at = frame.tables.triangles + 3u * row;
    set_row(at, a.position, t.material);
    set_row(at + 1u, b.position, t.first_copy);
    set_row(at + 2u, c.position, t.light);
    let flat = unit_or(cross(b.position - a.position, c.position - a.position), vec3<f32>(0.0, 0.0, 1.0));
    let shading = frame.tables.shadings + 4u * row;
    set_row(shading, unit_or(a.normal, flat), bitcast<u32>(t.uv0.x));
    set_row(shading + 1u, unit_or(b.normal, flat), bitcast<u32>(t.uv0.y));
    set_row(shading + 2u, unit_or(c.normal, flat), bitcast<u32>(t.uv1.x));
    set_table_row(shading + 3u, vec4<u32>(bitcast<vec3<u32>>(vec3<f32>(t.uv1.y, t.uv2)), 0u));
    if frame.tables.tangents != 0u {
        let tangents = frame.tables.tangents + 3u * row;
        set_table_row(tangents, bitcast<vec4<u32>>(a.tangent));
        set_table_row(tangents + 1u, bitcast<vec4<u32>>(b.tangent));
        set_table_row(tangents + 2u, bitcast<vec4<u32>>(c.tangent));
    }
    let last = frame.tables.last_corners + 3u * i;
    set_row(last, a.last_position, 0u);
    set_row(last + 1u, b.last_position, 0u);
    set_row(last + 2u, c.last_position, 0u);
    boxes[first_box + 2u * i] = vec4<f32>(min(min(a.position, b.position), c.position), 0.0);
    boxes[first_box + 2u * i + 1u] = vec4<f32>(max(max(a.position, b.position), c.position), 0.0);
}
