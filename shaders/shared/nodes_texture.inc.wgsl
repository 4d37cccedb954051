// The nodes of all trees in a texture, TEXELS_PER_NODE texels per node, NODES_PER_ROW nodes a row: for drivers that make a
// loop over lanes of each read of a storage buffer, and none of reads of texels.
@group(0) @binding(1) var nodes: texture_2d<u32>;

fn node_part(node: u32, part: u32) -> vec4<u32> {
    return textureLoad(nodes, vec2<u32>((node % NODES_PER_ROW) * TEXELS_PER_NODE + part, node / NODES_PER_ROW), 0);
}

// The same table by texels, for the trees behind that of the triangles.
fn tree_row(row: u32) -> vec4<u32> {
    const WIDTH: u32 = NODES_PER_ROW * TEXELS_PER_NODE;
    return textureLoad(nodes, vec2<u32>(row % WIDTH, row / WIDTH), 0);
}
