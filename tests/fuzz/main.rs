//! Damaged and hostile input. For any bytes, reading ends in bounded memory with a scene or an error, and a scene that
//! was read can be prepared for tracing.
//!
//! `DIPTYCH_FUZZ_CASES` sets the number of cases of each test.

mod allocations;
mod bytes;
#[path = "../common/effort.rs"]
mod effort;
mod files;
mod glb;
mod images;
mod motion;
mod shots;

use std::fmt::Debug;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use diptych::scene::budget::ByteSize;
use proptest::strategy::Strategy;
use proptest::test_runner::{Config, TestRunner};

/// Time after which a case counts as hung.
const PATIENCE: Duration = Duration::from_secs(20);

/// Lock for one test at a time, because allocations are counted for the whole process.
static TURN: Mutex<()> = Mutex::new(());

fn turn() -> MutexGuard<'static, ()> {
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Memory budget of a scene in these tests, and the maximum that the program may allocate in all.
const BUDGET: ByteSize = ByteSize(64 << 20);
const ALLOWED_BYTES: usize = 65 << 20;

/// Runs `case` on `cases` values, or on as many as the environment requests. A case may have `allowed_bytes` allocated
/// at once.
fn hold<S: Strategy>(cases: u32, allowed_bytes: usize, strategy: S, case: impl Fn(S::Value))
where
    S::Value: Debug,
{
    let _turn = turn();
    let cases = std::env::var("DIPTYCH_FUZZ_CASES").ok().map_or(cases, |n| n.parse().expect("a number of cases"));
    let config = Config { cases, failure_persistence: None, max_shrink_iters: 2000, ..Config::default() };
    let result = TestRunner::new(config).run(&strategy, |value| {
        let (begin, before) = (Instant::now(), allocations::start());
        case(value);
        let peak = allocations::peak() - before;
        assert!(begin.elapsed() < PATIENCE, "took {:?}", begin.elapsed());
        assert!(peak <= allowed_bytes, "allocated {peak} bytes, more than {allowed_bytes}");
        Ok(())
    });
    result.unwrap_or_else(|failure| panic!("{failure}"));
}
