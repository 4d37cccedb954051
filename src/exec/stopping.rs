//! Ends waits for devices early.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Interval at which waits check the flag.
pub const CHECK_INTERVAL: Duration = Duration::from_millis(50);

/// Time for which a wait for a frame goes on once the flag is set. Frames that end in this time are complete.
const GRACE: Duration = Duration::from_millis(250);

/// Flag that ends a renderer's waits, see [`super::Builder::stop`].
#[derive(Clone, Debug, Default)]
pub struct StopFlag(Option<Arc<AtomicBool>>);

impl From<Arc<AtomicBool>> for StopFlag {
    fn from(flag: Arc<AtomicBool>) -> Self {
        Self(Some(flag))
    }
}

impl StopFlag {
    /// Returns true if anything can set the flag.
    pub fn exists(&self) -> bool {
        self.0.is_some()
    }

    pub fn is_set(&self) -> bool {
        self.0.as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed))
    }

    /// Begins a wait for a frame. The returned function is called repeatedly, and returns false once the wait has gone
    /// on for [`GRACE`] with the flag set.
    pub fn begin_wait(&self) -> impl FnMut() -> bool + use<> {
        let (flag, mut seen) = (self.clone(), None);
        move || {
            if !flag.is_set() {
                return true;
            }
            seen.get_or_insert_with(Instant::now).elapsed() < GRACE
        }
    }

    /// Runs `work` on a thread with this name and returns its result. Returns `None` as soon as the flag is set; the
    /// thread then goes on until the process ends. Without a flag, `work` runs on this thread.
    ///
    /// # Errors
    /// An I/O error if the thread cannot be started.
    pub fn unless_set<T: Send + 'static>(
        &self,
        name: &str,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> io::Result<Option<T>> {
        if self.0.is_none() {
            return Ok(Some(work()));
        }
        let (done, result) = channel();
        let worker = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            // The receiver is gone if the flag was set.
            let _ = done.send(work());
        })?;
        loop {
            match result.recv_timeout(CHECK_INTERVAL) {
                Ok(found) => return Ok(Some(found)),
                Err(RecvTimeoutError::Timeout) if self.is_set() => return Ok(None),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    // The thread has sent nothing, so it has panicked.
                    if let Err(panic) = worker.join() {
                        std::panic::resume_unwind(panic);
                    }
                    return Ok(None);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_end_after_grace_once_the_flag_is_set() {
        let flag = Arc::new(AtomicBool::new(false));
        let stop = StopFlag::from(Arc::clone(&flag));
        let (mut goes_on, mut without_flag) = (stop.begin_wait(), StopFlag::default().begin_wait());
        assert!(goes_on() && without_flag());
        flag.store(true, Ordering::Relaxed);
        assert!(goes_on());
        std::thread::sleep(GRACE);
        assert!(!goes_on() && without_flag());
    }

    #[test]
    fn work_is_left_behind_once_the_flag_is_set() {
        let flag = Arc::new(AtomicBool::new(false));
        let stop = StopFlag::from(Arc::clone(&flag));
        assert_eq!(stop.unless_set("work", || 7).unwrap(), Some(7));
        flag.store(true, Ordering::Relaxed);
        let (release, held) = channel::<()>();
        assert_eq!(stop.unless_set("work", move || held.recv().is_ok()).unwrap(), None);
        drop(release);
        assert_eq!(StopFlag::default().unless_set("work", || 7).unwrap(), Some(7));
    }
}
