// Resamples a rectified image, which the pass binds as `rectified`. Its size is `rectified_size`, and its pixels are
// means over their area. To conserve light, the light along each axis of a pixel is modelled by a parabola that has the
// pixel's mean and does not overshoot, and the parabolas are integrated over the displayed pixel (Colella & Woodward
// 1984, section 1: the piecewise parabolic method). A pixel between two flat sides gets a sharp edge instead, at the
// position that keeps its mean (Harten 1989, "ENO schemes with subcell resolution"): next to lamps, even a little
// misplaced light is visible.

//!include display_resampling bindings

// Maximum and minimum number of rectified pixels that a displayed pixel covers along an axis.
const WIDEST: f32 = 8.0;
const NARROWEST: f32 = 0.1;

// Light at the boundary of the second and the third of four pixels, clamped to the range of these two.
fn between(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, d: vec3<f32>) -> vec3<f32> {
    return clamp((7.0 * (b + c) - (a + d)) / 12.0, min(b, c), max(b, c));
}

// Integral of the light in a pixel from `low` to `high`, which are fractions of its width, given the light at its
// start, its mean, and the light at its end.
fn part_of(begin: vec3<f32>, mean: vec3<f32>, end: vec3<f32>, low: f32, high: f32) -> vec3<f32> {
    let is_extreme = (end - mean) * (mean - begin) <= vec3<f32>(0.0);
    let rise = end - begin;
    let bend = rise * (6.0 * mean - 3.0 * (begin + end));
    // An extremum inside the pixel is moved to its start or its end.
    var left = select(begin, 3.0 * mean - 2.0 * end, bend > rise * rise);
    var right = select(end, 3.0 * mean - 2.0 * begin, bend < -rise * rise);
    left = select(left, mean, is_extreme);
    right = select(right, mean, is_extreme);
    let curve = 6.0 * mean - 3.0 * (left + right);
    let length = high - low;
    let squares = 0.5 * (high * high - low * low);
    let cubes = (high * high * high - low * low * low) / 3.0;
    return left * length + (right - left + curve) * squares - curve * cubes;
}

// Maximum variation of the light on each side of an edge, relative to the step at the edge.
const EVEN: f32 = 0.25;

// Integral of the light from `low` to `high`, fractions of a pixel's width, in the middle one of five pixels.
fn part_among(two_before: vec3<f32>, before: vec3<f32>, own: vec3<f32>, after: vec3<f32>, two_after: vec3<f32>, low: f32, high: f32) -> vec3<f32> {
    let smooth_part = part_of(between(two_before, before, own, after), own, between(before, own, after, two_after), low, high);
    let rise = after - before;
    let is_between = (after - own) * (own - before) > vec3<f32>(0.0);
    let is_edge = is_between & (max(abs(before - two_before), abs(two_after - after)) < EVEN * abs(rise));
    // Position of the edge in the pixel.
    let at = clamp((after - own) / select(vec3<f32>(1.0), rise, is_edge), vec3<f32>(0.0), vec3<f32>(1.0));
    let first = max(min(at, vec3<f32>(high)) - low, vec3<f32>(0.0));
    return select(smooth_part, before * first + after * (high - low - first), is_edge);
}

fn light_at(column: i32, row: i32) -> vec3<f32> {
    let last = vec2<i32>(rectified_size()) - 1;
    let at = clamp(vec2<i32>(column, row), vec2<i32>(0), last);
    return rectified[at.y * (last.x + 1) + at.x].rgb;
}

// Mean light of a row between the horizontal positions `low` and `high`, pixels.
fn mean_of_row(row: i32, low: f32, high: f32) -> vec3<f32> {
    let first = i32(floor(low));
    var two_before = light_at(first - 2, row);
    var before = light_at(first - 1, row);
    var own = light_at(first, row);
    var after = light_at(first + 1, row);
    var sum = vec3<f32>(0.0);
    for (var column = first; f32(column) < high; column += 1) {
        let next = light_at(column + 2, row);
        let begin = max(low - f32(column), 0.0);
        sum += part_among(two_before, before, own, after, next, begin, min(high - f32(column), 1.0));
        two_before = before;
        before = own;
        own = after;
        after = next;
    }
    return sum / (high - low);
}

// Mean light of the image in a rectangle.
fn mean_of(low: vec2<f32>, high: vec2<f32>) -> vec3<f32> {
    let first = i32(floor(low.y));
    var two_before = mean_of_row(first - 2, low.x, high.x);
    var before = mean_of_row(first - 1, low.x, high.x);
    var own = mean_of_row(first, low.x, high.x);
    var after = mean_of_row(first + 1, low.x, high.x);
    var sum = vec3<f32>(0.0);
    for (var row = first; f32(row) < high.y; row += 1) {
        let next = mean_of_row(row + 2, low.x, high.x);
        let begin = max(low.y - f32(row), 0.0);
        sum += part_among(two_before, before, own, after, next, begin, min(high.y - f32(row), 1.0));
        two_before = before;
        before = own;
        own = after;
        after = next;
    }
    return sum / (high.y - low.y);
}

fn resampled(place: ShownPlace) -> vec3<f32> {
    // Width along each axis, from the variance of the pixel's footprint.
    let squares = place.across * place.across + place.down * place.down;
    let widths = clamp(sqrt(squares), vec2<f32>(NARROWEST), vec2<f32>(WIDEST));
    // Clamped, since drivers may convert NaN to any number.
    let size = vec2<f32>(rectified_size());
    let centre = clamp(place.point, vec2<f32>(-4.0), size + 4.0);
    // Rounding may leave slightly negative light.
    return max(mean_of(centre - 0.5 * widths, centre + 0.5 * widths), vec3<f32>(0.0));
}
