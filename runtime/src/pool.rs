//! Threads that work for one caller, who waits and is asked meanwhile whether they are to stop.

use std::mem::ManuallyDrop;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use rayon::ThreadPool;

use crate::interrupt;

/// Threads that belong to a process: a child of a fork has none of them.
pub struct Pool {
    threads: ManuallyDrop<ThreadPool>,
    process: u32,
}

/// Most threads of a pool on a machine of few processors.
const MOST: usize = 64;

/// Number of processors that this process may use.
pub fn processors() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// Number of threads for so many independent tasks: at most one each, and no more than four a
/// processor or [`MOST`].
pub fn useful(threads: usize, tasks: usize) -> usize {
    threads.min(tasks).min(MOST.max(4 * processors())).max(1)
}

impl Pool {
    /// Threads that stop when the flag says so.
    pub fn new(count: usize, stop: &Arc<AtomicBool>) -> Result<Self, rayon::ThreadPoolBuildError> {
        let builder = rayon::ThreadPoolBuilder::new().num_threads(count).thread_name(|i| format!("smpl-{i}"));
        let stop = Arc::clone(stop);
        let threads = builder.start_handler(move |_| interrupt::follow(Arc::clone(&stop))).build()?;
        Ok(Self { threads: ManuallyDrop::new(threads), process: std::process::id() })
    }

    /// Number of threads.
    pub fn threads(&self) -> usize {
        self.threads.current_num_threads()
    }

    /// Returns `true` if this process made them.
    pub fn is_mine(&self) -> bool {
        self.process == std::process::id()
    }

    /// Runs `work` on the threads; the caller waits, and asks meanwhile whether they are to stop.
    pub fn run(&self, stop: &AtomicBool, work: impl FnOnce() + Send) {
        let (done, caller) = (AtomicBool::new(false), thread::current());
        self.threads.in_place_scope(|scope| {
            scope.spawn(|_| {
                // Wakes the caller also when the work panics.
                let _wake = Wake { done: &done, caller: &caller };
                work();
            });
            while !done.load(Ordering::Acquire) {
                thread::park_timeout(interrupt::PERIOD);
                if !done.load(Ordering::Acquire) && interrupt::requested() {
                    stop.store(true, Ordering::Relaxed);
                }
            }
        });
    }
}

impl Drop for Pool {
    fn drop(&mut self) {
        if self.is_mine() {
            // SAFETY: dropped once, here. What a child of a fork has of it waits for threads that
            // are not there, and is left.
            unsafe { ManuallyDrop::drop(&mut self.threads) };
        }
    }
}

/// Says on its end that work is done.
struct Wake<'a> {
    done: &'a AtomicBool,
    caller: &'a thread::Thread,
}

impl Drop for Wake<'_> {
    fn drop(&mut self) {
        self.done.store(true, Ordering::Release);
        self.caller.unpark();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn threads_are_as_many_as_tasks_at_most_and_bounded() {
        assert_eq!(useful(3000, 3), 3);
        assert_eq!(useful(2, 100), 2);
        assert_eq!(useful(0, 0), 1);
        assert_eq!(useful(usize::MAX, usize::MAX), 64.max(4 * processors()));
    }
}
