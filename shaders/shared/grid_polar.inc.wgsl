// Functions that all polar projections share. Besides the functions of `grid`, a polar projection defines
// `column_beside`: the column of a row that is next to the given column of another row, not yet wrapped.

//!include frame grid rings

const IS_POLAR: bool = true;

fn is_outside(pixel: vec2<u32>) -> bool {
    let rows = frame.camera.views[pass_.view].rows;
    let length = row_length(frame.camera.views[pass_.view].fovea_rows, i32(pixel.y));
    return f32(pixel.x) >= length || f32(pixel.y) >= rows || pixel.y >= pass_.row_end;
}

fn beside(pixel: vec2<u32>, offset: vec2<i32>) -> Beside {
    let there = vec2<i32>(pixel) + offset;
    let fovea_rows = frame.camera.views[pass_.view].fovea_rows;
    let rows = rows_around(f32(pixel.y), fovea_rows, frame.camera.views[pass_.view].rows);
    let row = clamp(there.y, max(i32(pass_.valid_begin), rows.x), min(i32(pass_.valid_end), rows.y) - 1);
    if is_in_square(fovea_rows, row) {
        let column = column_held(fovea_rows, row, there.x);
        return Beside(vec2<i32>(column, row), row == there.y && column == there.x);
    }
    let column = column_held(fovea_rows, row, column_beside(there.x, i32(pixel.y), row, fovea_rows));
    return Beside(vec2<i32>(column, row), row == there.y);
}

// Wraps a column around its ring, by at most one turn. Columns of the square are clamped.
fn column_held(eye_fovea_rows: f32, row: i32, column: i32) -> i32 {
    let length = i32(row_length(eye_fovea_rows, row));
    let turn = select(length, 0, is_in_square(eye_fovea_rows, row));
    let turned = column + select(0, turn, column < 0) - select(0, turn, column >= length);
    return clamp(turned, 0, length - 1);
}

fn column_in(row: i32, column: f32, eye_fovea_rows: f32) -> f32 {
    if !is_in_square(eye_fovea_rows, row) {
        return column * row_length(eye_fovea_rows, row) / f32(frame.camera.width);
    }
    return column;
}

fn point_in(pixel: vec2<f32>, offset: vec2<f32>) -> vec2<f32> {
    let at = pixel + offset;
    let fovea_rows = frame.camera.views[pass_.view].fovea_rows;
    if !is_in_square(fovea_rows, i32(pixel.y)) {
        let length = row_length(fovea_rows, i32(pixel.y));
        return vec2<f32>(at.x * f32(frame.camera.width) / length, at.y);
    }
    return at;
}

fn traced_index(at: vec2<f32>, size: vec2<f32>) -> u32 {
    let eye = frame.camera.views[pass_.view];
    let point = traced_point(at, size);
    let row = clamp(i32(floor(point.y)), 0, i32(eye.rows) - 1);
    let column = column_held(eye.fovea_rows, row, i32(floor(column_in(row, point.x, eye.fovea_rows))));
    return u32(row) * frame.camera.width + u32(column);
}
