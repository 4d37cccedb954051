// Computes the outdated fraction of each tile's history: the change of light divided by the light, both smoothed over
// tiles.

//!include frame grid bindings

const REACH_TILES: i32 = i32(REACH);
// Relative change of light up to which no history is dropped. When any light moves, the light tree may pick other
// lights, so retraced paths may differ even where light has not changed.
const UNNOTICED: f32 = 0.01;
// Factor that multiplies the part of a change above UNNOTICED.
const STRENGTH: f32 = 4.0;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let tile = vec2<u32>(id.x, pass_.row_begin + id.y);
    if tile.x >= pass_.width || tile.y >= pass_.row_end {
        return;
    }
    let low = vec2<i32>(0, i32(pass_.valid_begin));
    let high = vec2<i32>(i32(pass_.width) - 1, i32(pass_.valid_end) - 1);
    var sum = vec2<f32>(0.0);
    for (var dy = -REACH_TILES; dy <= REACH_TILES; dy += 1) {
        for (var dx = -REACH_TILES; dx <= REACH_TILES; dx += 1) {
            let there = vec2<i32>(tile) + vec2<i32>(dx, dy);
            let held = clamp(there, low, high);
            let r = f32(dx * dx + dy * dy) / f32((REACH_TILES + 1) * (REACH_TILES + 1));
            sum += select(0.0, exp(-2.0 * r), all(there == held)) * gradient[u32(held.y) * pass_.width + u32(held.x)];
        }
    }
    let share = select(0.0, abs(sum.x) / sum.y, sum.y > 0.0);
    light_change[pixel_index(tile)] = clamp(STRENGTH * (share - UNNOTICED), 0.0, 1.0);
}
