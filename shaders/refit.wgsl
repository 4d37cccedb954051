// Refits the trees over deforming bodies, one level at a time from the deepest to the roots. The topology stays, and
// boxes are put around the triangles' current positions. One invocation per node.

//!include frame changed_tables bindings

// Variables:
// - `tree_nodes`: nodes as they were built.
// - `tree_order`: indices of the nodes, the deepest first.
// - `boxes`: bounding boxes of nodes, then of triangles: least and largest coordinates.

// A box in 8-bit units of its node's grid, rounded outwards so that it contains the given bounds.
struct Bytes {
    low: vec3<u32>,
    high: vec3<u32>,
}

fn quantized(low: vec3<f32>, high: vec3<f32>, corner: vec3<f32>, unit: vec3<f32>) -> Bytes {
    var l = floor((low - corner) / unit);
    var h = ceil((high - corner) / unit);
    // Grow by one unit where rounding excluded a bound: the division is rounded, and so is the product in traversal.
    l -= select(vec3<f32>(0.0), vec3<f32>(1.0), corner + l * unit > low);
    h += select(vec3<f32>(0.0), vec3<f32>(1.0), corner + h * unit < high);
    return Bytes(vec3<u32>(clamp(l, vec3<f32>(0.0), vec3<f32>(255.0))), vec3<u32>(clamp(h, vec3<f32>(0.0), vec3<f32>(255.0))));
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let first_node = pass_.args.first_node;
    let i = pass_.args.begin + id.x + id.y * COLUMNS;
    if i >= pass_.args.end {
        return;
    }
    let node = tree_order[i];
    let first_box = 2u * arrayLength(&tree_order);
    let header = tree_nodes[ROWS_PER_NODE * node].w;
    let links = tree_nodes[ROWS_PER_NODE * node + 1u];
    var lows: array<vec3<f32>, 8>;
    var highs: array<vec3<f32>, 8>;
    var low = vec3<f32>(MOST_FLOAT);
    var high = vec3<f32>(-MOST_FLOAT);
    var inner = 0u;
    for (var slot = 0u; slot < 8u; slot += 1u) {
        let meta_ = (select(links.z, links.w, slot >= 4u) >> (8u * (slot & 3u))) & 0xffu;
        let is_inner = ((header >> (24u + slot)) & 1u) != 0u;
        // Index of the first box of a child, and number of its boxes: its own if it is a node, or one for each of its
        // triangles.
        var at = 2u * (links.x - first_node + inner);
        var count = select(countOneBits(meta_ >> 5u), 1u, is_inner);
        if is_inner {
            inner += 1u;
        } else {
            at = first_box + 2u * (links.y - frame.geometry.first_deforming + (meta_ & 31u));
        }
        lows[slot] = vec3<f32>(MOST_FLOAT);
        highs[slot] = vec3<f32>(-MOST_FLOAT);
        for (var k = 0u; k < count; k += 1u) {
            lows[slot] = min(lows[slot], boxes[at + 2u * k].xyz);
            highs[slot] = max(highs[slot], boxes[at + 2u * k + 1u].xyz);
        }
        low = min(low, lows[slot]);
        high = max(high, highs[slot]);
    }
    boxes[2u * node] = vec4<f32>(low, 0.0);
    boxes[2u * node + 1u] = vec4<f32>(high, 0.0);
    // Unit of the grid on each axis: the smallest power of two of which 254 span the box. The 255th is left for
    // rounding.
    let bits = bitcast<vec3<u32>>(max((high - low) / 254.0, vec3<f32>(0x1p-126)));
    let exponents = min((bits >> vec3<u32>(23u)) + select(vec3<u32>(0u), vec3<u32>(1u), (bits & vec3<u32>(0x7fffffu)) != vec3<u32>(0u)), vec3<u32>(254u));
    let unit = bitcast<vec3<f32>>(exponents << vec3<u32>(23u));
    var words: array<vec4<u32>, 3>;
    for (var slot = 0u; slot < 8u; slot += 1u) {
        // A slot without a child gets an arbitrary box, since traversal never tests it.
        let q = quantized(min(lows[slot], high), max(highs[slot], low), low, unit);
        let shift = 8u * (slot & 3u);
        for (var axis = 0u; axis < 3u; axis += 1u) {
            let pair = vec2<u32>(q.low[axis], q.high[axis]) << vec2<u32>(shift);
            words[axis] |= select(vec4<u32>(pair.x, 0u, pair.y, 0u), vec4<u32>(0u, pair.x, 0u, pair.y), slot >= 4u);
        }
    }
    let row = ROWS_PER_NODE * (first_node + node);
    set_table_row(row, vec4<u32>(bitcast<vec3<u32>>(low), (header & 0xff000000u) | exponents.x | (exponents.y << 8u) | (exponents.z << 16u)));
    set_table_row(row + 1u, links);
    set_table_row(row + 2u, words[0]);
    set_table_row(row + 3u, words[1]);
    set_table_row(row + 4u, words[2]);
}
