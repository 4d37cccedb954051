// Writes rows of the scene's tables, which are in a buffer.
@group(0) @binding(1) var<storage, read_write> tables: array<vec4<u32>>;

fn set_table_row(row: u32, value: vec4<u32>) {
    tables[row] = value;
}
