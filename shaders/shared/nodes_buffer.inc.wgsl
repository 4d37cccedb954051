// The nodes of all trees in a buffer, TEXELS_PER_NODE rows of 16 bytes per node.
@group(0) @binding(1) var<storage, read> nodes: array<vec4<u32>>;

fn node_part(node: u32, part: u32) -> vec4<u32> {
    return nodes[node * TEXELS_PER_NODE + part];
}

// The same table by rows, for the trees behind that of the triangles.
fn tree_row(row: u32) -> vec4<u32> {
    return nodes[row];
}
