//! Reduces the scheduling latency of the thread that carries packets.

/// Length of the requested time slices, in nanoseconds. The default is some milliseconds.
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

/// Requests short time slices for this thread. They do not give it a larger fraction of a core, but it runs before
/// compute threads when it wakes up, which matters if ranks have no cores to spare. Linux 6.12 and later support this
/// (Documentation/scheduler/sched-eevdf.rst). On other kernels the request has no effect, and errors are ignored.
pub fn ask_for_short_ones() {
    let mut attributes = Attributes::default();
    let size = size_of::<Attributes>() as u32;
    // SAFETY: the kernel writes no more than `size` bytes, which is the size of the struct; 0 is this thread.
    let found = unsafe { libc::syscall(libc::SYS_sched_getattr, 0, &raw mut attributes, size, 0) };
    if found == 0 && attributes.policy == libc::SCHED_OTHER as u32 {
        attributes.runtime_ns = SLICE_NS;
        // SAFETY: the kernel reads as many bytes as the struct's `size` says, which the kernel itself has written
        // there.
        unsafe { libc::syscall(libc::SYS_sched_setattr, 0, &raw const attributes, 0) };
    }
}
