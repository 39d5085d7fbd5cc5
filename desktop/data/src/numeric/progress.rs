//! Progress of long work, and a way to stop it: for callers that have a user in front of them.
//!
//! Work that knows nothing of it costs one look at a thread's own pointer for each model that is tried.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::Arc;

#[derive(Debug, Default)]
struct Shared {
    tried: AtomicU64,
    stop: AtomicBool,
}

/// A piece of work, with all threads that it starts by [`inherit`].
#[derive(Debug, Clone, Default)]
pub struct Work(Arc<Shared>);

thread_local! {
    static CURRENT: RefCell<Option<Work>> = const { RefCell::new(None) };
}

/// Payload that unwinds the stack of work that was stopped.
struct Stopped;

impl Work {
    /// None done yet.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Models that were tried so far.
    #[must_use]
    pub fn done(&self) -> u64 {
        self.0.tried.load(Ordering::Relaxed)
    }

    /// Stops it at the next model.
    pub fn stop(&self) {
        self.0.stop.store(true, Ordering::Relaxed);
    }

    /// Runs a job as this work; `None` where it was stopped, or panicked.
    pub fn run<T>(&self, job: impl FnOnce() -> T) -> Option<T> {
        let before = CURRENT.replace(Some(self.clone()));
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(job));
        CURRENT.set(before);
        result.ok()
    }
}

/// The work of this thread, for a thread that it starts: hand it to [`continued`] there.
#[must_use]
pub fn inherit() -> Option<Work> {
    CURRENT.with_borrow(Clone::clone)
}

/// Goes on with the work of another thread in this one.
pub fn continued<T>(work: Option<Work>, job: impl FnOnce() -> T) -> T {
    let before = CURRENT.replace(work);
    let result = job();
    CURRENT.set(before);
    result
}

/// Another model is to be tried: counts it, and unwinds where the work is to stop.
pub fn step() {
    CURRENT.with_borrow(|work| {
        let Some(Work(shared)) = work else { return };
        shared.tried.fetch_add(1, Ordering::Relaxed);
        if shared.stop.load(Ordering::Relaxed) {
            std::panic::resume_unwind(Box::new(Stopped));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_counted_and_stops_with_its_threads() {
        step();
        let work = Work::new();
        assert_eq!(work.run(|| (0..5).for_each(|_| step())), Some(()));
        assert_eq!(work.done(), 5);
        let ended = work.run(|| {
            let own = inherit();
            std::thread::scope(|s| {
                let other = s.spawn(|| {
                    continued(own, || loop {
                        step();
                    });
                });
                while work.done() < 1000 {
                    std::thread::yield_now();
                }
                work.stop();
                assert!(other.join().is_err(), "unwound");
            });
            step();
        });
        assert_eq!(ended, None);
        step();
    }
}
