//! Requests to stop a long computation: Ctrl-C where another program's interpreter runs this one.
//!
//! Whoever embeds the runtime says with [`set_hook`] how to ask for such a request. Computations
//! call a [`Pace`] as they go on. It counts, and reads the clock every few milliseconds, so that
//! the hook is called every 100 ms on a thread and costs nothing in between. Threads of a pool read
//! a flag, which the thread that waits for them sets.

use std::cell::{Cell, RefCell};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Time between two questions.
pub const PERIOD: Duration = Duration::from_millis(100);
/// Time between two looks at the clock, about.
const GLANCE: Duration = Duration::from_millis(5);
/// Most counts between two looks at the clock.
const MOST: u32 = 1 << 16;

static HOOK: OnceLock<fn() -> bool> = OnceLock::new();

thread_local! {
    /// When this thread last asked.
    static ASKED: Cell<Option<Instant>> = const { Cell::new(None) };
    /// Flag of this thread instead of the hook.
    static FLAG: RefCell<Option<Arc<AtomicBool>>> = const { RefCell::new(None) };
    /// True if it has one. The first look at a value that is dropped with its thread allocates,
    /// which a step must not.
    static FOLLOWS: Cell<bool> = const { Cell::new(false) };
}

/// Says whom to ask; the first one stays. After it has returned `true` once, it must return `true`
/// until the computation has returned.
pub fn set_hook(ask: fn() -> bool) {
    let _ = HOOK.set(ask);
}

/// Makes this thread read a flag instead of the hook.
pub fn follow(flag: Arc<AtomicBool>) {
    FLAG.with(|mine| *mine.borrow_mut() = Some(flag));
    FOLLOWS.set(true);
}

/// Returns `true` if the computation shall stop now.
#[must_use]
pub fn requested() -> bool {
    if FOLLOWS.get() {
        return FLAG.with(|flag| flag.borrow().as_ref().is_some_and(|flag| flag.load(Ordering::Relaxed)));
    }
    HOOK.get().is_some_and(|ask| ask())
}

/// Counts a computation's parts, and asks now and then whether it is to stop.
#[derive(Debug)]
pub struct Pace {
    left: u32,
    every: u32,
    looked: Option<Instant>,
}

impl Default for Pace {
    fn default() -> Self {
        Self { left: 1, every: 1, looked: None }
    }
}

impl Pace {
    /// Counts one part; whether the computation is to stop.
    #[inline]
    pub(crate) fn stops(&mut self) -> bool {
        self.left -= 1;
        self.left == 0 && self.look()
    }

    /// Looks at the clock, and fits the number of parts between looks to what they take.
    #[cold]
    fn look(&mut self) -> bool {
        let now = Instant::now();
        match self.looked.map(|last| now - last) {
            Some(passed) if passed < GLANCE / 2 => self.every = (self.every * 2).min(MOST),
            Some(passed) if passed > GLANCE * 2 => self.every = (self.every / 4).max(1),
            _ => {}
        }
        self.looked = Some(now);
        self.left = self.every;
        let last = ASKED.get();
        if last.is_some_and(|last| now - last < PERIOD) {
            return false;
        }
        ASKED.set(Some(now));
        last.is_some() && requested()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flag_is_seen_soon_and_only_when_it_is_set() {
        let flag = Arc::new(AtomicBool::new(false));
        let seen = std::thread::spawn({
            let flag = Arc::clone(&flag);
            move || {
                follow(Arc::clone(&flag));
                let mut pace = Pace::default();
                let begin = Instant::now();
                while begin.elapsed() < 3 * PERIOD {
                    assert!(!pace.stops());
                }
                flag.store(true, Ordering::Relaxed);
                let mut counts = 0_u64;
                while !pace.stops() {
                    counts += 1;
                }
                counts
            }
        });
        assert!(seen.join().expect("no panic") > 0);
    }
}
