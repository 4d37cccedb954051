// Motion since the previous frame, and its limits on history.

//!include frame

// Whether the scene is dynamic. Eyes may move in any scene.
override HAS_MOTION: bool = false;

// True if the previous frame's history is lost in any row from `begin` up to, but not including, `end`.
fn are_lost(begin: i32, end: i32) -> bool {
    return max(begin, i32(frame.history.lost_begin)) < min(end, i32(frame.history.lost_end));
}

// Maximum fraction of a history's light that may be outdated: light that has gone, or new light that the history lacks.
// While lights change, it bounds the length of history in frames.
const MOST_LATE_LIGHT: f32 = 0.05;

fn longest_in_light() -> f32 {
    return MOST_LATE_LIGHT / max(frame.lights.change, 1e-6);
}

// Whether an eye has moved or turned, or its gaze has moved.
fn has_moved(now: View, before: View) -> bool {
    return any(now.origin != before.origin) || any(now.right != before.right) || any(now.up != before.up)
        || any(now.forward != before.forward) || any(now.gaze != before.gaze);
}
