// Imports a frame of another renderer: writes the images of the G-buffer and of path tracing from the arrays that the
// caller gives. Emission bypasses the filter, and so does light that no albedo can demodulate, on black surfaces and in the
// sky.

//!include frame grid projection split pack motion bindings

// Square of the length up to which a normal counts as 0.
const NO_LENGTH: f32 = 1e-12;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, pass_.row_begin + id.y);
    if is_outside(pixel) {
        return;
    }
    let at = pixel_index(pixel);
    let color = imported_color[at].xyz;
    let emitted = imported_emission[at].xyz;
    let given = imported_normal[at].xyz;
    let position = imported_position[at].xyz;
    let is_surface = dot(given, given) > NO_LENGTH && is_finite(position);
    let normal = select(vec3<f32>(0.0, 0.0, 1.0), normalize(given), is_surface);
    var albedo = select(vec3<f32>(0.0), imported_albedo[at].xyz, is_surface);
    let light = over(scaled(color - emitted), albedo);
    let is_black = absent(light);
    albedo = select(albedo, vec3<f32>(0.0), is_black);
    let depth = distance(position, frame.camera.views[pass_.view].origin);
    let guide = vec4<u32>(bitcast<vec3<u32>>(position), pack_normal(normal));
    let sky = vec4<u32>(0u, 0u, 0u, NO_NORMAL);
    // All surfaces have the same material, since positions and normals tell them apart.
    hit_image[at] = select(vec4<u32>(NO_PRIM, 0u, 0u, MATERIAL_NONE), vec4<u32>(0u), is_surface);
    guide_image[at] = select(sky, guide, is_surface);
    albedo_image[at] = pack_albedo(Albedo(albedo, albedo, 1.0));
    emission_image[at] = vec4<f32>(select(emitted, color, is_black), select(0.0, depth, is_surface));
    radiance_image[at] = pack_sampled(light, vec3<f32>(0.0));
    tally_image[at] = 0u;
    if HAS_MOTION {
        let last = imported_last_position[at].xyz;
        // A surface that the previous frame did not have gets the opposite normal, which none of its surfaces has.
        let was_there = is_finite(last);
        let before = vec4<u32>(
            bitcast<vec3<u32>>(select(position, last, was_there)),
            pack_normal(select(-normal, normal, was_there)),
        );
        last_surface_image[at] = select(sky, before, is_surface);
    }
}
