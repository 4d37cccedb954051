// All tables of the scene, one after another in rows of 16 bytes, in a texture: for drivers that make a loop over lanes of
// each read of a storage buffer, and none of reads of texels. As a storage texture, of which no level and no sampler must
// be looked up.
@group(0) @binding(1) var tables: texture_storage_2d<rgba32uint, read>;

fn table_row(row: u32) -> vec4<u32> {
    return textureLoad(tables, vec2<u32>(row % TABLE_WIDTH, row / TABLE_WIDTH));
}
