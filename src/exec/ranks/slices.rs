//! How soon the thread that carries packets gets a core when it has something to do.

/// A request for time slices of this length, nanoseconds, instead of some milliseconds.
const SLICE_NS: u64 = 100_000;

/// `struct sched_attr` of Linux (sched_setattr(2)), in its first version.
#[repr(C)]
#[derive(Default)]
struct Attributes {
    size: u32,
    policy: u32,
    flags: u64,
    nice: i32,
    priority: u32,
    runtime_ns: u64,
    deadline_ns: u64,
    period_ns: u64,
}

/// Asks for short time slices for this thread. It takes no larger share of a core by that, but goes before threads that
/// compute when it wakes up, where ranks have no cores to spare. Linux 6.12 and later do so (Documentation/scheduler/sched-eevdf.rst);
/// others ignore it, and so does this what they answer.
pub fn ask_for_short_ones() {
    let mut attributes = Attributes::default();
    let size = size_of::<Attributes>() as u32;
    // SAFETY: the kernel writes no more than `size` bytes, which is what there is; 0 is this thread.
    let found = unsafe { libc::syscall(libc::SYS_sched_getattr, 0, &raw mut attributes, size, 0) };
    if found == 0 && attributes.policy == libc::SCHED_OTHER as u32 {
        attributes.runtime_ns = SLICE_NS;
        // SAFETY: the kernel reads as many bytes as `size` in it says, which it has written there.
        unsafe { libc::syscall(libc::SYS_sched_setattr, 0, &raw const attributes, 0) };
    }
}
