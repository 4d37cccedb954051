// Where a surface was seen before.

// Whether anything but the eyes moves.
override HAS_MOTION: bool = false;

struct Previous {
    views: array<View, 2>,
}

// Whether an eye is anywhere else than it was, or looks another way.
fn has_moved(now: View, before: View) -> bool {
    return any(now.origin != before.origin) || any(now.right != before.right) || any(now.up != before.up)
        || any(now.forward != before.forward);
}
