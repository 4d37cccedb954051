// Parts of the grid that all projections share. The include of the frame's projection adds the functions that map pixels
// of the pass's grid to rays, and points in the scene to pixels: `grid_perspective`, or `grid_polar` with
// `grid_visual_polar` or `grid_log_polar` (see `src/projection`). Rows of polar images are rings around the gaze, and
// columns are directions from it. Every projection defines:
//
// IS_POLAR           whether rows are rings: columns wrap around, and rows may have lengths of their own
// is_outside         whether a pixel is outside the image or the dispatch's rows
// is_in_square       whether a row belongs to the square of screen pixels around the gaze that precedes the rings
// is_shown           whether a pixel is on the screen, or so close to it that filters read it; others are not traced
// row_length         columns of a row
// rows_around        rows of the image part (square or rings) at a row position: the first, and the one after the last
// goes_around        whether columns wrap around at a row position
// beside             pixel at an offset from another one
// column_held        column wrapped around its ring, or clamped
// column_in          column of an image point, converted from columns of full-length rows to those of the given row
// point_in           image point at an offset in a pixel
// ray_of             unit direction through a point of the image, whose column counts in columns of its own row
// pixel_of           image point where an eye sees a point of the scene, and the distance along its view direction (from
//                    the eye in visual-polar images)
// traced_point       image point of the pass's view that shows a point of the screen; `size` is the size of the screen
// traced_index       index of the pixel that shows a point of the screen, or of the nearest one
// density_on_screen  columns and rows per screen pixel at a point of the screen, which the image shows at `point`

//!include frame

const TAU: f32 = 6.2831855;

fn pixel_index(pixel: vec2<u32>) -> u32 {
    return pixel.y * pass_.width + pixel.x;
}

// Pixel at an offset from another one: the nearest that may be read, and whether it is the requested one.
struct Beside {
    pixel: vec2<i32>,
    is_there: bool,
}

// Unit direction through a point of a pinhole image of this size, measured from the top left corner.
fn pinhole_ray(view: u32, at: vec2<f32>, size: vec2<f32>) -> vec3<f32> {
    let ndc = vec2<f32>(2.0, -2.0) * (at / size) + vec2<f32>(-1.0, 1.0);
    return normalize(frame.camera.views[view].forward
        + frame.camera.views[view].right * (ndc.x * frame.camera.views[view].tan_half_x + frame.camera.views[view].shift_x)
        + frame.camera.views[view].up * (ndc.y * frame.camera.views[view].tan_half_y));
}

// Point of a pinhole image of this size that shows `v`, which is relative to the eye; and the distance of `v` along the
// view direction.
fn pinhole_point(v: vec3<f32>, eye: View, size: vec2<f32>) -> vec3<f32> {
    let z = dot(v, eye.forward);
    let front = max(z, 1e-20);
    let ndc = vec2<f32>(
        dot(v, eye.right) / (front * eye.tan_half_x) - eye.shift_x / eye.tan_half_x,
        -dot(v, eye.up) / (front * eye.tan_half_y),
    );
    return vec3<f32>((ndc * 0.5 + 0.5) * size, z);
}
