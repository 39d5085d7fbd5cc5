//! Progress of long work, and a way to stop it: for callers that have a user in front of them.
//!
//! Work that knows nothing of it costs one look at a thread's own pointer for each model that is tried.

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::Arc;

#[derive(Debug, Default)]
struct Shared {
    tried: AtomicU64,
    thousandths: AtomicU64,
    stop: AtomicBool,
}

/// A piece of work, with all threads that it starts by [`inherit`].
#[derive(Debug, Clone, Default)]
pub struct Work {
    shared: Arc<Shared>,
    /// Part of the whole that is done now, from and to, in thousandths.
    part: Option<(f64, f64)>,
}

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
        self.shared.tried.load(Ordering::Relaxed)
    }

    /// Share that is done by the work's own estimate, 0 to 1: it never falls, and its steps are not of equal length.
    #[must_use]
    pub fn share(&self) -> f64 {
        self.shared.thousandths.load(Ordering::Relaxed) as f64 / 1000.0
    }

    /// Stops it at the next model.
    pub fn stop(&self) {
        self.shared.stop.store(true, Ordering::Relaxed);
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
        let Some(Work { shared, .. }) = work else { return };
        shared.tried.fetch_add(1, Ordering::Relaxed);
        if shared.stop.load(Ordering::Relaxed) {
            std::panic::resume_unwind(Box::new(Stopped));
        }
    });
}

/// This share of the work, or of the part that is done now ([`part`]), is done, 0 to 1; a smaller one than before changes nothing.
pub fn reached(share: f64) {
    CURRENT.with_borrow(|work| {
        if let Some(Work { shared, part }) = work {
            let (from, to) = part.unwrap_or((0.0, 1000.0));
            let thousandths = from + share.clamp(0.0, 1.0) * (to - from);
            shared.thousandths.fetch_max(thousandths as u64, Ordering::Relaxed);
        }
    });
}

/// Runs a job that is a part of the work: its shares count from `from` to `to`, 0 to 1.
pub fn part<T>(from: f64, to: f64, job: impl FnOnce() -> T) -> T {
    let narrower = CURRENT.with_borrow(|work| {
        work.as_ref().map(|w| {
            let (low, high) = w.part.unwrap_or((0.0, 1000.0));
            let at = |share: f64| low + share * (high - low);
            Work { shared: w.shared.clone(), part: Some((at(from), at(to))) }
        })
    });
    let result = continued(narrower, job);
    reached(to);
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_is_counted_and_stops_with_its_threads() {
        step();
        let work = Work::new();
        reached(0.7);
        let counted = || {
            reached(0.25);
            reached(0.1);
            part(0.2, 0.4, || reached(0.5));
            (0..5).for_each(|_| step());
        };
        assert_eq!(work.run(counted), Some(()));
        assert_eq!((work.done(), work.share()), (5, 0.4));
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
