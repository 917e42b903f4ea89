//! True if a step of a batch goes faster on many threads or on one.

use std::time::Duration;

/// Work that is worth waking other threads.
const WORTH_THREADS: Duration = Duration::from_micros(80);

/// After so many steps in the way that was faster of late the other one is tried again.
const TRIED_AGAIN: u32 = 64;

/// Recent times of steps, on one thread and on many.
///
/// Many threads are slower where a step is short, and where other programs have the processors: the
/// last thread to be woken is waited for. No bit of a step depends on the choice.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pace {
    alone: Option<Duration>,
    together: Option<Duration>,
    /// Steps since the slower way was tried.
    since: u32,
}

impl Pace {
    /// Returns `true` if the next step is for many threads.
    pub(super) fn chooses_threads(&mut self) -> bool {
        let Some(alone) = self.alone else { return false };
        let Some(together) = self.together else { return alone > WORTH_THREADS };
        let faster = together < alone;
        if self.since < TRIED_AGAIN {
            self.since += 1;
            return faster;
        }
        self.since = 0;
        !faster && alone > WORTH_THREADS
    }

    /// Takes note of how long a step took.
    pub(super) fn note(&mut self, threads: bool, took: Duration) {
        let known = if threads { &mut self.together } else { &mut self.alone };
        // One try in a while counts for more than one of many.
        let slower = self.since == 0;
        *known = Some(known.map_or(took, |known| if slower { (known + took) / 2 } else { (known * 7 + took) / 8 }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps of which `cost` says how long they take, from one thread or many; how many of the last
    /// 600 were for many.
    fn threaded(pace: &mut Pace, cost: impl Fn(bool) -> u64) -> usize {
        let mut step = || {
            let threads = pace.chooses_threads();
            pace.note(threads, Duration::from_micros(cost(threads)));
            threads
        };
        (0..800).filter(|n| step() && *n >= 200).count()
    }

    #[test]
    fn short_steps_are_for_one_thread_always() {
        assert_eq!(threaded(&mut Pace::default(), |_| 10), 0);
        assert_eq!(threaded(&mut Pace::default(), |threads| if threads { 1 } else { 79 }), 0);
    }

    #[test]
    fn long_steps_are_for_those_that_are_faster() {
        let mut pace = Pace::default();
        let idle = threaded(&mut pace, |threads| if threads { 300 } else { 500 });
        assert!((580..600).contains(&idle), "{idle}");
        // Other programs come, and go.
        let busy = threaded(&mut pace, |threads| if threads { 900 } else { 600 });
        assert!((1..20).contains(&busy), "{busy}");
        let again = threaded(&mut pace, |threads| if threads { 300 } else { 500 });
        assert!((580..600).contains(&again), "{again}");
    }

    #[test]
    fn steps_that_get_long_are_tried_on_threads() {
        let mut pace = Pace::default();
        assert_eq!(threaded(&mut pace, |_| 20), 0);
        assert!(threaded(&mut pace, |threads| if threads { 200 } else { 400 }) > 580);
    }
}
