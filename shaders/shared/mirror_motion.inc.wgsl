// Where the previous frame saw a surface in mirrors or behind glass, if the surface or one of these has moved since.

//!include frame scene path last_surface

// How a chain of mirrors and glass maps the surface to its image: x becomes turn * x + shift. If all links are plane
// mirrors and thin panes, this is a product of reflections. Curved links and solid glass only contribute to `turn`.
struct Mapping {
    turn: mat3x3<f32>,
    shift: vec3<f32>,
}

struct MirrorMotion {
    now: Mapping,
    // The mapping in the previous frame, if `is_flat`.
    last: Mapping,
    // Whether all links are plane mirrors and thin panes.
    is_flat: bool,
    // Whether all links are parts of the same rigid body, and its first row.
    is_one_body: bool,
    body: u32,
    has_moved: bool,
    // Size of the image over that of the surface.
    magnification: f32,
}

// That of the chain that was followed last, in dynamic scenes.
var<private> mirror_motion: MirrorMotion;

fn identity() -> mat3x3<f32> {
    return mat3x3<f32>(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
}

// The motion of no links at all.
fn no_mirror_motion() -> MirrorMotion {
    let mapping = Mapping(identity(), vec3<f32>(0.0));
    return MirrorMotion(mapping, mapping, true, true, 0u, false, 1.0);
}

// The mapping with a further plane mirror, through `p` with normal `n`, before it.
fn over_mirror(m: Mapping, n: vec3<f32>, p: vec3<f32>) -> Mapping {
    let twice = 2.0 * (m.turn * n);
    let turn = mat3x3<f32>(m.turn[0] - twice * n.x, m.turn[1] - twice * n.y, m.turn[2] - twice * n.z);
    return Mapping(turn, m.shift + twice * dot(n, p));
}

// Turns a vector by the smallest rotation that takes unit vector `a` to `b`, which is not the opposite of `a`.
fn turned_towards(v: vec3<f32>, a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    let axis = cross(a, b);
    return v * dot(a, b) + cross(axis, v) + axis * (dot(axis, v) / max(1.0 + dot(a, b), 1e-6));
}

// The mapping with glass before it that bends a path from direction `before` to `onward`.
fn over_glass(m: Mapping, before: vec3<f32>, onward: vec3<f32>) -> Mapping {
    let one = identity();
    let bend = mat3x3<f32>(
        turned_towards(one[0], onward, before),
        turned_towards(one[1], onward, before),
        turned_towards(one[2], onward, before),
    );
    return Mapping(m.turn * bend, m.shift);
}

// The motion with one more link, hit by a ray in direction `before` that goes on in direction `onward`. `last` is the
// link's surface in the previous frame.
fn with_link(motion: MirrorMotion, f: FirstHit, last: LastSurface, before: vec3<f32>, onward: vec3<f32>, is_first: bool, is_flat: bool) -> MirrorMotion {
    let s = f.surface;
    let place = placed(f.hit.prim);
    let is_rigid = place.row - frame.geometry.first_deforming >= frame.geometry.deforming_count;
    var sum = motion;
    sum.is_one_body = is_rigid && (is_first || (sum.is_one_body && place.instance == sum.body));
    sum.body = place.instance;
    sum.has_moved = sum.has_moved || last.has_moved;
    sum.is_flat = sum.is_flat && is_flat;
    if dot(onward, s.normal) > 0.0 {
        sum.now = over_mirror(sum.now, s.normal, s.position);
        sum.last = over_mirror(sum.last, last.normal, last.position);
    } else {
        sum.now = over_glass(sum.now, before, onward);
    }
    return sum;
}

fn mapped(m: Mapping, p: vec3<f32>) -> vec3<f32> {
    return m.turn * p + m.shift;
}

// Where the previous frame saw a surface that this frame sees at `image`, in `direction`. The surface is at `position`
// and was at `last`. The last component is 1, or 0 if the place is unknown.
fn last_image(motion: MirrorMotion, image: vec3<f32>, direction: vec3<f32>, position: vec3<f32>, last: vec3<f32>) -> vec4<f32> {
    if motion.is_flat {
        // Rounding errors, and the shift by panes with a thickness, stay as they are.
        return vec4<f32>(image + mapped(motion.last, last) - mapped(motion.now, position), 1.0);
    }
    if motion.has_moved && !motion.is_one_body {
        return vec4<f32>(image, 0.0);
    }
    // In the frame of the moving mirror, only the surface moves. Its image moves by as much, magnified.
    var carried = image;
    var before = position;
    var turn = identity();
    if motion.has_moved {
        let back = affine_at(motion.body + LOCAL_FROM_WORLD);
        let there = affine_at(motion.body + LAST_WORLD_FROM_LOCAL);
        carried = transform_point(there, transform_point(back, image));
        before = transform_point(there, transform_point(back, position));
        turn = mat3x3<f32>(
            transform_vector(there, transform_vector(back, turn[0])),
            transform_vector(there, transform_vector(back, turn[1])),
            transform_vector(there, transform_vector(back, turn[2])),
        );
    }
    let m = motion.magnification;
    let moved = motion.now.turn * (transpose(turn) * (last - before));
    let magnified = m * (moved + (m - 1.0) * dot(moved, direction) * direction);
    return vec4<f32>(carried + turn * magnified, 1.0);
}
