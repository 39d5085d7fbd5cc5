//! The same work on several things, on all processors.

use std::sync::{Mutex, PoisonError};

/// The same work on each processor, but on no more than so many, until it is done on all.
pub fn on_all(most: usize, work: impl Fn() + Sync) {
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(most);
    if threads <= 1 {
        return work();
    }
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(&work);
        }
    });
}

/// Results of `work` on each item, in their order. One item, or one processor, needs no thread.
pub fn each<T: Send, R: Send>(items: Vec<T>, work: impl Fn(T) -> R + Sync) -> Vec<R> {
    let mut made: Vec<Option<R>> = items.iter().map(|_| None).collect();
    let most = items.len();
    let queue = Mutex::new(items.into_iter().zip(&mut made));
    on_all(most, || {
        loop {
            // (The lock is given back before the work.)
            let next = queue.lock().unwrap_or_else(PoisonError::into_inner).next();
            let Some((item, to)) = next else { break };
            *to = Some(work(item));
        }
    });
    // (A thread that panics has the scope panic: none is missing here.)
    made.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::each;

    #[test]
    fn the_order_is_that_of_the_items() {
        for n in [0usize, 1, 2, 1000] {
            assert_eq!(each((0..n).collect(), |k| k * k), (0..n).map(|k| k * k).collect::<Vec<_>>());
        }
    }
}
