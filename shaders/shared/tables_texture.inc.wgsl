//!include frame

// All tables of the scene, stored consecutively in rows of 16 bytes, in a texture. Some drivers turn each read of a
// storage buffer into a loop over lanes, but not reads of texels. A storage texture needs no look-up of a mip level or
// a sampler.
@group(0) @binding(1) var tables: texture_storage_2d<rgba32uint, read>;

fn table_row(row: u32) -> vec4<u32> {
    return textureLoad(tables, vec2<u32>(row % TABLE_WIDTH, row / TABLE_WIDTH));
}
