// Blockwise regression (Koskela et al. 2019, section 3.2): in each block of 32x32 pixels, demodulated illumination is
// fitted by a weighted sum of features in the least squares sense, with weights per channel. Features are 1, the
// normal, the coordinates of the position within the block's bounds, and their squares. Householder reflections (Golub
// & Van Loan, "Matrix Computations", 5.2) solve the system, with one workgroup for each block. Sums are always added in
// the same order.
// Departures:
// - Linearly dependent features are dropped (Xu, Tong & Xu, "Real-Time Path Tracing Reconstruction in DXR"): a feature
//   is dependent if the previous reflections leave too little of its column's length, here relative to the column's
//   original length. If the kernel's argument is above 0, noise of this amplitude is added to the features instead, as
//   in the paper, for comparison.
// - Pixels without a surface or without light, and those beyond the image's border, do not take part in the fit. Every
//   pixel with a surface gets the fitted light, and all others keep their own.
// - Fitted light is clamped to the brightest light of the block.
// - Specular and diffuse radiance are fitted one after the other if the scene has gloss. Pixels take part in the fit of the
//   channels that their surfaces reflect. If these differ, each channel is fitted alone.

//!include frame projection rng split pack bindings

// Variables:
// - `source`: demodulated illumination. The upper 8 bits of the last word hold the number of accumulated frames.
// - `fitted`: fitted illumination; the last word is 0 if there is none.

const INVOCATIONS: u32 = 256u;
// Number of a block's pixels that each invocation handles. They are ROWS_APART rows apart.
const PIXELS: u32 = 4u;
const ROWS_APART: u32 = INVOCATIONS / BLOCK;
const FEATURES: u32 = 10u;
// Number of entries in a row of the system: its features and its colour channels.
const ENTRIES: u32 = FEATURES + 3u;
// Number of partial results per entry. A reduction first combines the values of all invocations into this many sums or
// maxima, and then combines these into one.
const GROUP: u32 = 16u;

// Threshold for dropping a column: length of its part that is linearly independent of the columns before it, relative
// to its whole length. On a plane, rounding makes packed normals differ by up to 3e-5, and positions by up to 1e-5.
const INDEPENDENT: f32 = 1e-3;
// Minimum extent of a block's positions along an axis, relative to their largest coordinate on it. A smaller extent is
// treated as a rounding error.
const LEAST_EXTENT: f32 = 2e-6;
// Illumination up to which a block counts as black, and smallest divisor.
const DARK: f32 = 1e-30;
// Last word of a pixel of `fitted` that has light.
const IS_FITTED: u32 = 0x3f800000u;

var<workgroup> parts: array<f32, ENTRIES * INVOCATIONS>;
var<workgroup> group_sums: array<f32, ENTRIES * GROUP>;
// Entries of the pivot row of the current reflection.
var<workgroup> pivots: array<f32, ENTRIES>;
// Component x: sum or maximum of `parts` over all invocations. Component y: entry of `pivots`.
var<workgroup> totals: array<vec2<f32>, ENTRIES>;
var<workgroup> square_lengths: array<f32, ENTRIES>;
var<workgroup> is_lit: u32;
// Whether pixels lack some channels of a lobe and have others.
var<workgroup> differs: array<u32, 2>;
// Number of pixels in the fit of each channel.
var<workgroup> fitted_pixels: array<f32, 3>;
// The triangular system: for each row, its feature, and its entries from that feature's column on.
var<workgroup> row_feature: array<u32, FEATURES>;
var<workgroup> rows: array<f32, FEATURES * ENTRIES>;
var<workgroup> weights: array<f32, FEATURES * 3u>;

// Adds up `parts` over all invocations.
fn add_up(t: u32) {
    workgroupBarrier();
    if t < ENTRIES * GROUP {
        let first = t / GROUP * INVOCATIONS + t % GROUP;
        var sum = 0.0;
        for (var i = 0u; i < INVOCATIONS; i += GROUP) {
            sum += parts[first + i];
        }
        group_sums[t] = sum;
    }
    workgroupBarrier();
    if t < ENTRIES {
        var sum = 0.0;
        for (var i = 0u; i < GROUP; i += 1u) {
            sum += group_sums[t * GROUP + i];
        }
        totals[t] = vec2<f32>(sum, pivots[t]);
    }
    workgroupBarrier();
}

// Finds the largest of `parts` over all invocations.
fn find_largest(t: u32) {
    workgroupBarrier();
    if t < ENTRIES * GROUP {
        let first = t / GROUP * INVOCATIONS + t % GROUP;
        var largest = parts[first];
        for (var i = GROUP; i < INVOCATIONS; i += GROUP) {
            largest = max(largest, parts[first + i]);
        }
        group_sums[t] = largest;
    }
    workgroupBarrier();
    if t < ENTRIES {
        var largest = group_sums[t * GROUP];
        for (var i = 1u; i < GROUP; i += 1u) {
            largest = max(largest, group_sums[t * GROUP + i]);
        }
        totals[t] = vec2<f32>(largest, 0.0);
    }
    workgroupBarrier();
}

// Offset, in pixels, by which the first blocks begin above and left of the image. Over 16 frames it visits the points
// of a 4 x 4 lattice with a spacing of 8 pixels, in the order of a Bayer matrix (Bayer 1973), in which successive
// points are far apart.
fn displacement() -> vec2<u32> {
    let far = frame.sampling.index & 3u;
    let near = (frame.sampling.index >> 2u) & 3u;
    let far_step = vec2<u32>((far ^ (far >> 1u)) & 1u, far & 1u);
    let near_step = vec2<u32>((near ^ (near >> 1u)) & 1u, near & 1u);
    return BLOCK / 2u * far_step + BLOCK / 4u * near_step;
}

// Image column of the `i`th pixel of a block in the given row; -1 if there is none. In polar images, a block covers the
// same directions in each ring, with fewer pixels in shorter rings. Together, the blocks of a ring cover it once.
fn column_in_block(origin: i32, displaced: u32, i: u32, row: i32) -> i32 {
    let width = i32(pass_.width);
    let column = origin + i32(i);
    if IS_POLAR {
        let fovea_rows = frame.camera.views[pass_.view].fovea_rows;
        let length = i32(row_length(fovea_rows, row));
        if is_in_square(fovea_rows, row) {
            return select(-1, column, column >= 0 && column < length);
        }
        let end = min(origin + i32(BLOCK), width - i32(displaced));
        // Scale the block's columns to the ring's length, rounding up. A turn (`width`) is added first, since the
        // dividend must not be negative.
        let first = ((origin + width) * length + width - 1) / width - length;
        let last = ((end + width) * length + width - 1) / width - length;
        let is_there = first + i32(i) < last && row < i32(frame.camera.views[pass_.view].rows);
        return select(-1, column_held(fovea_rows, row, first + i32(i)), is_there);
    }
    return select(-1, column, column >= 0 && column < width);
}


fn light_at(at: u32) -> SplitLight {
    return unpack_light(vec4<u32>(source[at].xyz, 0u));
}

// Light of a pixel that shows no surface at its centre.
fn unfitted(at: u32) -> vec4<u32> {
    return vec4<u32>(source[at].xyz, IS_FITTED);
}

fn lobe_at(at: u32, lobe: u32) -> vec3<f32> {
    let light = light_at(at);
    return select(light.matte, light.gloss, lobe == 1u);
}

fn largest_of(light: vec3<f32>) -> f32 {
    return max(light.r, max(light.g, light.b));
}

// 1 if some channels are absent and others not.
fn mixes_channels(light: vec3<f32>) -> f32 {
    return select(0.0, 1.0, any(absent(light)) && !is_absent(light));
}

// Bounds of a block's surfaces.
struct Extent {
    low: vec3<f32>,
    // 1 / size of the bounds on each axis; 0 on an axis on which the block has no extent.
    scale: vec3<f32>,
}

fn features(bits: vec4<u32>, extent: Extent) -> array<f32, FEATURES> {
    let n = unpack_normal(bits.w);
    let x = (bitcast<vec3<f32>>(bits.xyz) - extent.low) * extent.scale;
    return array<f32, FEATURES>(1.0, n.x, n.y, n.z, x.x, x.y, x.z, x.x * x.x, x.y * x.y, x.z * x.z);
}

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) t: u32, @builtin(workgroup_id) group: vec3<u32>) {
    let displaced = displacement();
    let block = vec2<u32>(group.x, (pass_.row_begin + displaced.y) / BLOCK + group.y);
    let origin = vec2<i32>(block * BLOCK) - vec2<i32>(displaced);
    if origin.x >= i32(pass_.width) || origin.y >= i32(pass_.row_end) {
        return;
    }

    // Bounds of the block, and the brightest light of each lobe.
    var low = vec3<f32>(MOST_FLOAT);
    var high = vec3<f32>(-MOST_FLOAT);
    var brightest = vec2<f32>(0.0);
    var mixes = vec2<f32>(0.0);
    var counts = vec4<bool>(false);
    for (var s = 0u; s < PIXELS; s += 1u) {
        let row = origin.y + i32(t / BLOCK + s * ROWS_APART);
        let column = column_in_block(origin.x, displaced.x, t % BLOCK, row);
        let inside = column >= 0 && row >= i32(pass_.valid_begin) && row < i32(pass_.valid_end);
        let at = select(0u, u32(row) * pass_.width + u32(column), inside);
        let bits = guide_image[at];
        counts[s] = inside && bits.w != NO_NORMAL && (source[at].w >> 24u) != 0u;
        if counts[s] {
            low = min(low, bitcast<vec3<f32>>(bits.xyz));
            high = max(high, bitcast<vec3<f32>>(bits.xyz));
            let light = light_at(at);
            brightest = max(brightest, vec2<f32>(largest_of(light.matte), largest_of(light.gloss)));
            mixes = max(mixes, vec2<f32>(mixes_channels(light.matte), mixes_channels(light.gloss)));
        }
    }
    for (var i = 0u; i < 3u; i += 1u) {
        parts[i * INVOCATIONS + t] = -low[i];
        parts[(3u + i) * INVOCATIONS + t] = high[i];
    }
    for (var i = 0u; i < 2u; i += 1u) {
        parts[(6u + i) * INVOCATIONS + t] = brightest[i];
        parts[(8u + i) * INVOCATIONS + t] = mixes[i];
    }
    parts[10u * INVOCATIONS + t] = select(0.0, 1.0, any(counts));
    find_largest(t);
    if t == 0u {
        is_lit = u32(totals[10].x);
        differs[0] = u32(totals[8].x);
        differs[1] = u32(totals[9].x);
    }
    if t < ENTRIES {
        pivots[t] = 0.0;
    }
    low = -vec3<f32>(totals[0].x, totals[1].x, totals[2].x);
    high = vec3<f32>(totals[3].x, totals[4].x, totals[5].x);
    brightest = vec2<f32>(totals[6].x, totals[7].x);
    if workgroupUniformLoad(&is_lit) == 0u {
        for (var s = 0u; s < PIXELS; s += 1u) {
            let row = origin.y + i32(t / BLOCK + s * ROWS_APART);
            let column = column_in_block(origin.x, displaced.x, t % BLOCK, row);
            if column >= 0 && row >= i32(pass_.row_begin) && row < i32(pass_.row_end) {
                let at = u32(row) * pass_.width + u32(column);
                fitted[at] = select(vec4<u32>(0u), unfitted(at), guide_image[at].w == NO_NORMAL);
            }
        }
        return;
    }
    let is_wide = high - low > LEAST_EXTENT * max(abs(low), abs(high));
    let extent = Extent(low, select(vec3<f32>(0.0), 1.0 / max(high - low, vec3<f32>(DARK)), is_wide));
    // Light of this invocation's pixels.
    var fitted_light: array<array<vec3<f32>, PIXELS>, 2>;
    var lobes = 1u;
    if HAS_GLOSS {
        lobes = 2u;
    }
    for (var lobe = 0u; lobe < lobes; lobe += 1u) {
        let channels = select(1u, 3u, workgroupUniformLoad(&differs[lobe]) != 0u);
        for (var channel = 0u; channel < channels; channel += 1u) {
            // Columns of the system: the features, then the colour channels. Each invocation holds four rows of every column.
            var columns: array<vec4<f32>, ENTRIES>;
            let amplitude = pass_.args.noise;
            let per_light = select(0.0, 1.0 / max(brightest[lobe], DARK), brightest[lobe] > DARK);
            for (var s = 0u; s < PIXELS; s += 1u) {
                let row = origin.y + i32(t / BLOCK + s * ROWS_APART);
                let column = column_in_block(origin.x, displaced.x, t % BLOCK, row);
                let at = select(0u, u32(row) * pass_.width + u32(column), counts[s]);
                let f = features(guide_image[at], extent);
                let light = lobe_at(at, lobe);
                let takes_part = counts[s] && !absent(light)[channel];
                for (var j = 0u; j < FEATURES; j += 1u) {
                    columns[j][s] = select(0.0, f[j], takes_part);
                }
                for (var j = 0u; j < 3u; j += 1u) {
                    columns[FEATURES + j][s] = select(0.0, light[j] * per_light, takes_part);
                }
                if amplitude > 0.0 && takes_part {
                    let key = hash_combine(hash_combine(frame.sampling.index, at), pass_.view);
                    for (var j = 1u; j < FEATURES; j += 1u) {
                        columns[j][s] += amplitude * (2.0 * unit_float(hash_combine(key, j)) - 1.0);
                    }
                }
            }
            for (var j = 0u; j < ENTRIES; j += 1u) {
                parts[j * INVOCATIONS + t] = dot(columns[j], columns[j]);
            }
            add_up(t);
            if t < ENTRIES {
                square_lengths[t] = totals[t].x;
            }

            // Householder reflections. The current column is always column 0, since all columns move up after each reflection;
            // so array indices do not depend on the reflection. The first rows, which the first invocations hold, become the
            // rows of the triangular system.
            var rank = 0u;
            for (var m = 0u; m < FEATURES; m += 1u) {
                var v = columns[0];
                v.x = select(v.x, 0.0, t < rank);
                for (var j = 0u; j < ENTRIES; j += 1u) {
                    parts[j * INVOCATIONS + t] = dot(v, columns[j]);
                    if t == rank {
                        pivots[j] = columns[j].x;
                    }
                }
                add_up(t);
                let square = totals[0].x;
                let pivot = totals[0].y;
                let is_kept = square > max(INDEPENDENT * INDEPENDENT * square_lengths[m], DARK);
                if is_kept {
                    let length = sqrt(square);
                    // The sign for which the difference from the pivot does not cancel.
                    let diagonal = select(length, -length, pivot > 0.0);
                    // Two over the squared length of the mirror's normal.
                    let scale = 1.0 / (square + abs(pivot) * length);
                    v.x = select(v.x, v.x - diagonal, t == rank);
                    for (var j = 0u; j < ENTRIES; j += 1u) {
                        columns[j] -= v * (scale * (totals[j].x - diagonal * totals[j].y));
                    }
                    if t < ENTRIES - m {
                        let off = scale * (totals[t].x - diagonal * totals[t].y);
                        rows[rank * ENTRIES + t] = select(totals[t].y - (pivot - diagonal) * off, diagonal, t == 0u);
                    }
                    if t == 0u {
                        row_feature[rank] = m;
                    }
                    rank += 1u;
                }
                for (var j = 0u; j + 1u < ENTRIES; j += 1u) {
                    columns[j] = columns[j + 1u];
                }
                columns[ENTRIES - 1u] = vec4<f32>(0.0);
            }
            workgroupBarrier();

            // Back-substitution, with one channel in each of three invocations. Dropped features have weight 0.
            if t < 3u && (t == channel || channels == 1u) {
                fitted_pixels[t] = square_lengths[0];
                for (var m = 0u; m < FEATURES; m += 1u) {
                    weights[m * 3u + t] = 0.0;
                }
                for (var i = rank; i > 0u; i -= 1u) {
                    let k = i - 1u;
                    let feature = row_feature[k];
                    var rest = rows[k * ENTRIES + FEATURES + t - feature];
                    for (var l = i; l < rank; l += 1u) {
                        rest -= rows[k * ENTRIES + row_feature[l] - feature] * weights[row_feature[l] * 3u + t];
                    }
                    weights[feature * 3u + t] = rest / rows[k * ENTRIES];
                }
            }
            workgroupBarrier();
        }
        for (var s = 0u; s < PIXELS; s += 1u) {
            let row = origin.y + i32(t / BLOCK + s * ROWS_APART);
            let column = column_in_block(origin.x, displaced.x, t % BLOCK, row);
            let is_there = column >= 0 && row >= i32(pass_.row_begin) && row < i32(pass_.row_end);
            let f = features(guide_image[select(0u, u32(row) * pass_.width + u32(column), is_there)], extent);
            var sum = vec3<f32>(0.0);
            for (var m = 0u; m < FEATURES; m += 1u) {
                sum += f[m] * vec3<f32>(weights[m * 3u], weights[m * 3u + 1u], weights[m * 3u + 2u]);
            }
            // Values that are not finite are kept, so that the accumulation counts them.
            let light = select(sum, clamp(sum, vec3<f32>(0.0), vec3<f32>(1.0)) * brightest[lobe], is_finite(sum));
            let pixels = vec3<f32>(fitted_pixels[0], fitted_pixels[1], fitted_pixels[2]);
            fitted_light[lobe][s] = select(absent_light(), light, pixels > vec3<f32>(0.0));
        }
        workgroupBarrier();
    }

    for (var s = 0u; s < PIXELS; s += 1u) {
        let row = origin.y + i32(t / BLOCK + s * ROWS_APART);
        let column = column_in_block(origin.x, displaced.x, t % BLOCK, row);
        if column < 0 || row < i32(pass_.row_begin) || row >= i32(pass_.row_end) {
            continue;
        }
        let at = u32(row) * pass_.width + u32(column);
        let light = pack_light(SplitLight(fitted_light[0][s], fitted_light[1][s], vec2<f32>(0.0)));
        fitted[at] = select(vec4<u32>(light.xyz, IS_FITTED), unfitted(at), guide_image[at].w == NO_NORMAL);
    }
}
