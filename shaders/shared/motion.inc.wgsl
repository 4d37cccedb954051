// Where a surface was seen before.

// Whether anything but the eyes moves.
override HAS_MOTION: bool = false;

struct Previous {
    views: array<View, 2>,
}

// Whether rows of the frame before are among those of which nothing is known.
fn are_lost(begin: i32, end: i32) -> bool {
    return max(begin, i32(frame.history.lost_begin)) < min(end, i32(frame.history.lost_end));
}

// Whether an eye is anywhere else than it was, or looks another way.
fn has_moved(now: View, before: View) -> bool {
    return any(now.origin != before.origin) || any(now.right != before.right) || any(now.up != before.up)
        || any(now.forward != before.forward);
}
