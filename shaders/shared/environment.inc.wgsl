// The environment image: look-up, and importance sampling by luminance. See `emitters/env_grid.rs`.

//!include frame math tables light_groups

override HAS_ENV_MAP: bool = true;

@group(0) @binding(3) var env_map: texture_2d<f32>;

fn env_texel(x: i32, y: i32) -> vec3<f32> {
    let w = i32(frame.environment.width);
    let column = select(x % w, x % w + w, x % w < 0);
    return textureLoad(env_map, vec2<i32>(column, clamp(y, 0, i32(frame.environment.height) - 1)), 0).rgb;
}

// Angle of (x, y), -pi to pi, exact to f32 rounding. The built-in atan2 and acos may be off by 4096 ulp, and on
// software drivers they are. With such an error, a direction may get the density of a neighbouring cell.
fn angle_of(y: f32, x: f32) -> f32 {
    let ax = abs(x);
    let ay = abs(y);
    let ratio = min(ax, ay) / max(max(ax, ay), 1e-37);
    // atan(ratio) / ratio as a polynomial in ratio squared, interpolated at 9 Chebyshev nodes; the error is below 1e-8.
    let t = ratio * ratio;
    var p = 0.0027662835;
    p = p * t - 0.0157312491;
    p = p * t + 0.0421376236;
    p = p * t - 0.0745685483;
    p = p * t + 0.106183706;
    p = p * t - 0.141977978;
    p = p * t + 0.19991872;
    p = p * t - 0.333330367;
    p = p * t + 0.999999982;
    var angle = ratio * p;
    angle = select(angle, 0.5 * PI - angle, ay > ax);
    angle = select(angle, PI - angle, x < 0.0);
    return select(angle, -angle, y < 0.0);
}

fn env_uv(direction: vec3<f32>) -> vec2<f32> {
    let u = 0.5 + angle_of(direction.x, -direction.z) / (2.0 * PI) + frame.environment.rotation;
    return vec2<f32>(u - floor(u), angle_of(length(direction.xz), direction.y) / PI);
}

fn environment(direction: vec3<f32>) -> vec3<f32> {
    if !HAS_ENV_MAP || frame.environment.width == 0u {
        return frame.environment.radiance;
    }
    let at = env_uv(direction) * vec2<f32>(f32(frame.environment.width), f32(frame.environment.height)) - 0.5;
    let base = floor(at);
    let f = at - base;
    let b = vec2<i32>(base);
    let top = mix(env_texel(b.x, b.y), env_texel(b.x + 1, b.y), f.x);
    let bottom = mix(env_texel(b.x, b.y + 1), env_texel(b.x + 1, b.y + 1), f.x);
    return mix(top, bottom, f.y);
}

// Density of the environment's grid at column `x`, which wraps, and row `y`, which is clamped.
fn env_density(x: u32, y: u32) -> f32 {
    let column = select(x, 0u, x >= frame.environment.grid_width);
    return stored_env_cell(min(y, frame.environment.grid_height - 1u) * frame.environment.grid_width + column).density;
}

// Densities at the corners of patch (x, y): above left, above right, below left, below right.
fn env_patch(x: u32, y: u32) -> vec4<f32> {
    let above = select(y - 1u, 0u, y == 0u);
    return vec4<f32>(env_density(x, above), env_density(x + 1u, above), env_density(x, y), env_density(x + 1u, y));
}

// Solid-angle density with which `sample_light` samples the environment in a direction.
fn env_light_pdf(direction: vec3<f32>, is_first: bool) -> f32 {
    if frame.environment.grid_width == 0u {
        return 0.0;
    }
    let size = vec2<f32>(f32(frame.environment.grid_width), f32(frame.environment.grid_height));
    let at = env_uv(direction) * size + vec2<f32>(size.x - 0.5, 0.5);
    let base = floor(at);
    let f = at - base;
    let column = u32(base.x) % max(frame.environment.grid_width, 1u);
    let corners = env_patch(column, min(u32(base.y), frame.environment.grid_height));
    let density = mix(mix(corners.x, corners.y, f.x), mix(corners.z, corners.w, f.x), f.y);
    let sin_theta = length(direction.xz);
    return group_probability(is_first) * density / max(2.0 * PI * PI * sin_theta, 1e-12);
}

// Maps a number in [0, 1) to a sample of a density that is linear from `a` to `b`.
fn sample_linear(u: f32, a: f32, b: f32) -> f32 {
    return min(u * (a + b) / max(a + sqrt(mix(a * a, b * b, u)), 1e-37), 0x1.fffffep-1);
}

fn sample_env_map(choice: vec2<f32>, u: vec2<f32>, is_first: bool) -> LightSample {
    // One random number picks the column and one the row, since a single number has too few digits for all patches. The
    // remainders of both decide between the patch and its alias.
    let width = max(frame.environment.grid_width, 1u);
    let height = frame.environment.grid_height;
    let scaled = choice * vec2<f32>(f32(width), f32(height + 1u));
    let column = min(u32(scaled.x), width - 1u);
    let row = min(u32(scaled.y), height);
    let rest = scaled - vec2<f32>(f32(column), f32(row));
    var patch_ = row * width + column;
    let entry = stored_env_cell(patch_);
    let keep = fract(rest.x + rest.y * 0x1p-11);
    patch_ = select(entry.alias_index, patch_, keep < entry.keep);
    let x = patch_ % width;
    let y = patch_ / width;
    let corners = env_patch(x, y);
    // Half of a patch at a pole lies beyond it.
    var down = sample_linear(u.y, corners.x + corners.y, corners.z + corners.w);
    down = select(down, 0.5 + 0.5 * u.y, y == 0u);
    down = select(down, 0.5 * u.y, y == height);
    let across = sample_linear(u.x, mix(corners.x, corners.z, down), mix(corners.y, corners.w, down));
    let uv = vec2<f32>((f32(x) + across + 0.5) / f32(width), (f32(y) + down - 0.5) / f32(height));
    let phi = 2.0 * PI * (uv.x - frame.environment.rotation - 0.5);
    let theta = PI * uv.y;
    var s = no_light();
    s.direction = vec3<f32>(sin(theta) * sin(phi), cos(theta), -sin(theta) * cos(phi));
    s.distance = 3.0e38;
    s.radiance = environment(s.direction);
    s.pdf = env_light_pdf(s.direction, is_first);
    return s;
}
