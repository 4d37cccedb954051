// Motion since the previous frame, and its limits on history.

// Whether the scene is dynamic. Eyes may move in any scene.
override HAS_MOTION: bool = false;

// Whether any of these rows of the previous frame are lost.
fn are_lost(begin: i32, end: i32) -> bool {
    return max(begin, i32(frame.history.lost_begin)) < min(end, i32(frame.history.lost_end));
}

// Maximum outdated light in a history, as a fraction of all light: light that has gone, or that is not in it yet. This
// bounds the length of history in frames where light changes.
const MOST_LATE_LIGHT: f32 = 0.05;

fn longest_in_light() -> f32 {
    return MOST_LATE_LIGHT / max(frame.lights.change, 1e-6);
}

// Whether an eye has moved or turned, or its gaze has moved.
fn has_moved(now: View, before: View) -> bool {
    return any(now.origin != before.origin) || any(now.right != before.right) || any(now.up != before.up)
        || any(now.forward != before.forward) || any(now.gaze != before.gaze);
}
