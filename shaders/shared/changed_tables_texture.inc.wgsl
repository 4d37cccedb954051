// Writes rows of the scene's tables, which are in a texture.
@group(0) @binding(1) var tables: texture_storage_2d<rgba32uint, write>;

fn set_table_row(row: u32, value: vec4<u32>) {
    textureStore(tables, vec2<u32>(row % TABLE_WIDTH, row / TABLE_WIDTH), value);
}
