// Where a surface was seen before.

// Whether anything but the eyes moves.
override HAS_MOTION: bool = false;

// Whether rows of the frame before are among those of which nothing is known.
fn are_lost(begin: i32, end: i32) -> bool {
    return max(begin, i32(frame.history.lost_begin)) < min(end, i32(frame.history.lost_end));
}

// Longest history in frames where light changes: as long as what is left of light that has gone, or lacks of light that has
// come, is no more than this share of all light.
const MOST_LATE_LIGHT: f32 = 0.05;

fn longest_in_light() -> f32 {
    return MOST_LATE_LIGHT / max(frame.lights.change, 1e-6);
}

// Whether an eye is anywhere else than it was, or looks another way.
fn has_moved(now: View, before: View) -> bool {
    return any(now.origin != before.origin) || any(now.right != before.right) || any(now.up != before.up)
        || any(now.forward != before.forward) || any(now.gaze != before.gaze);
}
