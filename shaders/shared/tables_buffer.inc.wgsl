//!include frame

// All tables of the scene, stored consecutively in rows of 16 bytes, in a buffer.
@group(0) @binding(1) var<storage, read> tables: array<vec4<u32>>;

fn table_row(row: u32) -> vec4<u32> {
    return tables[row];
}
