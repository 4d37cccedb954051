//! Values that one thread uses at a time.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

use anyhow::anyhow;

use crate::failure::Failure;

/// A value that one thread uses at a time. Callbacks in Python that run during a use cannot use the value again, since
/// they would wait for themselves.
pub struct Exclusive<T> {
    value: Mutex<T>,
    user: Mutex<Option<ThreadId>>,
}

impl<T> Exclusive<T> {
    pub fn new(value: T) -> Self {
        Self { value: Mutex::new(value), user: Mutex::default() }
    }

    /// Waits until no other thread uses the value. Call it without the interpreter's lock, which a callback of the other
    /// thread may need.
    ///
    /// # Errors
    /// [`Failure::Run`] in a callback that runs while the value is in use.
    pub fn lock(&self) -> Result<Guard<'_, T>, Failure> {
        let this = Some(thread::current().id());
        if *locked(&self.user) == this {
            return Err(Failure::Run(anyhow!("a callback cannot use the renderer or the player that calls it")));
        }
        let value = locked(&self.value);
        *locked(&self.user) = this;
        Ok(Guard { value, user: &self.user })
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The use of a value, which ends when the guard is dropped.
pub struct Guard<'a, T> {
    value: MutexGuard<'a, T>,
    user: &'a Mutex<Option<ThreadId>>,
}

impl<T> Deref for Guard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.value
    }
}

impl<T> DerefMut for Guard<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        &mut self.value
    }
}

impl<T> Drop for Guard<'_, T> {
    fn drop(&mut self) {
        *locked(self.user) = None;
    }
}
