// The constants of a frame and of a pass, and the pinhole rig. Mirrors `stages::layout`.

struct View {
    origin: vec3<f32>,
    tan_half_x: f32,
    right: vec3<f32>,
    tan_half_y: f32,
    up: vec3<f32>,
    pad0: u32,
    forward: vec3<f32>,
    pad1: u32,
}

struct Frame {
    views: array<View, 2>,
    width: u32,
    height: u32,
    index: u32,
    seed: u32,
    spp: u32,
    reflections: u32,
    indirect_clamp: f32,
    exposure: f32,
    // First row in `nodes` of the tree of spheres.
    sphere_tree: u32,
    light_groups: u32,
    env_width: u32,
    env_height: u32,
    env_radiance: vec3<f32>,
    env_rotation: f32,
    // In `nodes`: the row after the last of the tree of spheres, and the light tree's root.
    sphere_tree_end: u32,
    light_tree: u32,
    // In `lights`: those that the light tree picks from; directional ones stand behind them.
    local_lights: u32,
    directional_lights: u32,
    env_grid_width: u32,
    env_grid_height: u32,
    // Number of the frame's first sample: passes of one accumulation continue one another's sequences.
    sample_base: u32,
    // In `nodes`: the instances' first row, and the root of the tree over all but the first of them.
    instances: u32,
    // Where (0, 0, 0) is in the world.
    world_origin: vec3<f32>,
    instance_tree: u32,
    instance_count: u32,
    // Bits of a sample's number below its pixel's place on the Z curve; NO_CURVE: each pixel has sequences of its own.
    curve_shift: u32,
    // How far up and down history may have moved; 0xffffffff: there is none.
    history_rows: u32,
    // Added to every pixel's threshold; 2^32 is a whole turn.
    mask_turn: u32,
    // Where in a pixel rays go that stand for all of it.
    centre: vec2<f32>,
    // Foveation, pixels: where inner and middle layer end, and the gaze of the left and the right eye.
    fovea_radii: vec2<f32>,
    gaze: vec4<f32>,
    // Filter iterations that pixels of the inner, middle and outer layer take part in.
    layer_iterations: vec3<u32>,
    // Of the outer layer's pixels that would be sampled without foveation.
    unsampled_share: f32,
    // Of all pixels, before foveation leaves out more.
    sampled_share: f32,
}

struct Pass {
    view: u32,
    row_begin: u32,
    row_end: u32,
    // Rows that may be read: the stripe plus what was received or recomputed around it.
    valid_begin: u32,
    valid_end: u32,
    // What these mean is the pass's own business.
    arg0: u32,
    arg1: u32,
    arg2: u32,
    // Columns and rows of the pass's grid.
    width: u32,
    height: u32,
    // Number of the device.
    device: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
var<immediate> pass_: Pass;

const NO_PRIM: u32 = 0xffffffffu;

fn pixel_index(pixel: vec2<u32>) -> u32 {
    return pixel.y * frame.width + pixel.x;
}

// Unit direction through image point `at`, pixels from the top left corner.
fn ray_direction(view: u32, at: vec2<f32>) -> vec3<f32> {
    let size = vec2<f32>(f32(frame.width), f32(frame.height));
    let ndc = vec2<f32>(2.0, -2.0) * (at / size) + vec2<f32>(-1.0, 1.0);
    return normalize(frame.views[view].forward
        + frame.views[view].right * (ndc.x * frame.views[view].tan_half_x)
        + frame.views[view].up * (ndc.y * frame.views[view].tan_half_y));
}

fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3<f32>(0.2126, 0.7152, 0.0722));
}
