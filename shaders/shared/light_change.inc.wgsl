// Fraction by which light in the left eye has changed since the previous frame, per tile. The pass binds the image.

//!include frame projection bindings

// Tile in which the left eye sees this pixel's surface, which is at `position`.
fn tile_of(pixel: vec2<u32>, position: vec3<f32>) -> u32 {
    var x = pixel.x;
    if pass_.view == 1u {
        let seen = pixel_of(position, frame.camera.views[0]).x;
        x = u32(clamp(seen, 0.0, f32(pass_.width) - 1.0));
    }
    return pixel.y / TILE * ((pass_.width + TILE - 1u) / TILE) + x / TILE;
}

// Fraction to keep of a history with weight `old`, for a new frame with weight `new_`. If all light has changed,
// nothing is kept. In between, the weight of the new frame is interpolated (Schied et al. 2018, section 4.3).
fn kept_in_light(tile: u32, old: f32, new_: f32) -> f32 {
    let change = light_change[tile];
    let weight = new_ / (old + new_);
    return (1.0 - change) * weight / mix(weight, 1.0, change);
}
