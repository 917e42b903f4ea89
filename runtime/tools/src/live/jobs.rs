//! Requests that take time: a queue with its own thread, in which newer requests of a channel
//! replace older ones.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use lsp_server::RequestId;
use serde_json::Value;

use super::wire::{Fault, FaultKind};

/// Time for which a running request is left alone though a newer one waits: a control that moves
/// shows pictures on the way.
const GRACE: Duration = Duration::from_millis(250);
/// Most requests that wait.
const MOST: usize = 64;

/// A request.
pub(crate) struct Job {
    pub(crate) id: RequestId,
    pub(crate) method: String,
    pub(crate) params: Value,
    /// Requests of one channel replace each other.
    pub(crate) channel: Option<String>,
    pub(crate) stop: Arc<Stop>,
}

/// The signal to stop a request.
#[derive(Debug)]
pub(crate) struct Stop {
    /// Read by the integration.
    flag: Arc<AtomicBool>,
    reason: AtomicU8,
    /// A newer request waits.
    replaced: AtomicBool,
    begin: Mutex<Option<Instant>>,
}

const RUNNING: u8 = 0;
const CANCELLED: u8 = 1;
const OVERTAKEN: u8 = 2;

impl Stop {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self { flag: Arc::default(), reason: AtomicU8::new(RUNNING), replaced: AtomicBool::new(false), begin: Mutex::new(None) })
    }

    /// The flag that interrupts an integration, see [`smpl_runtime::interrupt::follow`].
    pub(crate) fn flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.flag)
    }

    fn set(&self, reason: u8) {
        let _ = self.reason.compare_exchange(RUNNING, reason, Ordering::Relaxed, Ordering::Relaxed);
        self.flag.store(true, Ordering::Relaxed);
    }

    fn begin(&self) {
        *self.begin.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
    }

    /// Looks whether the request is to stop; called between the steps of a run.
    ///
    /// # Errors
    /// [`FaultKind::Cancelled`] or [`FaultKind::Overtaken`].
    pub(crate) fn check(&self) -> Result<(), Fault> {
        if self.replaced.load(Ordering::Relaxed) && self.is_beyond_grace() {
            self.set(OVERTAKEN);
        }
        if self.flag.load(Ordering::Relaxed) { Err(self.fault()) } else { Ok(()) }
    }

    /// The error of a request that was stopped.
    pub(crate) fn fault(&self) -> Fault {
        match self.reason.load(Ordering::Relaxed) {
            OVERTAKEN => Fault::new(FaultKind::Overtaken, "overtaken by a newer request"),
            _ => Fault::new(FaultKind::Cancelled, "cancelled"),
        }
    }

    /// The error of the stop where there was one, else `fault`: what fails after a stop fails by
    /// it.
    pub(crate) fn or(&self, fault: Fault) -> Fault {
        if self.flag.load(Ordering::Relaxed) { self.fault() } else { fault }
    }

    fn is_beyond_grace(&self) -> bool {
        let begin = *self.begin.lock().unwrap_or_else(PoisonError::into_inner);
        begin.is_some_and(|begin| begin.elapsed() > GRACE)
    }
}

#[derive(Default)]
struct State {
    waiting: VecDeque<Job>,
    running: Option<(RequestId, Option<String>, Arc<Stop>)>,
    closed: bool,
}

/// A queue of requests.
#[derive(Default)]
pub(crate) struct Lane {
    state: Mutex<State>,
    wake: Condvar,
}

impl Lane {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a request; returns those that get no turn, with their errors.
    pub(crate) fn push(&self, job: Job) -> Vec<(RequestId, Fault)> {
        let mut state = self.lock();
        let mut refused = Vec::new();
        if job.channel.is_some() {
            let (older, kept): (VecDeque<Job>, VecDeque<Job>) = state.waiting.drain(..).partition(|waiting| waiting.channel == job.channel);
            state.waiting = kept;
            refused.extend(older.into_iter().map(|job| (job.id, Fault::new(FaultKind::Overtaken, "overtaken by a newer request"))));
            if let Some((_, channel, stop)) = &state.running
                && *channel == job.channel
            {
                stop.replaced.store(true, Ordering::Relaxed);
                if stop.is_beyond_grace() {
                    stop.set(OVERTAKEN);
                }
            }
        }
        if state.waiting.len() >= MOST || state.closed {
            refused.push((job.id, Fault::new(FaultKind::Internal, "too many requests wait; send fewer at once")));
        } else {
            state.waiting.push_back(job);
        }
        drop(state);
        self.wake.notify_one();
        refused
    }

    /// Cancels a request; true if it waited, so that its error is to be sent.
    pub(crate) fn cancel(&self, id: &RequestId) -> bool {
        let mut state = self.lock();
        let before = state.waiting.len();
        state.waiting.retain(|job| job.id != *id);
        if let Some((running, _, stop)) = &state.running
            && running == id
        {
            stop.set(CANCELLED);
        }
        state.waiting.len() < before
    }

    /// Ends the lane: nothing new begins, and what runs is interrupted.
    pub(crate) fn close(&self) {
        let mut state = self.lock();
        state.closed = true;
        state.waiting.clear();
        if let Some((_, _, stop)) = &state.running {
            stop.set(CANCELLED);
        }
        drop(state);
        self.wake.notify_all();
    }

    /// Works on requests until the lane is closed.
    pub(crate) fn work(&self, mut each: impl FnMut(Job)) {
        loop {
            let mut state = self.lock();
            let job = loop {
                if state.closed {
                    return;
                }
                match state.waiting.pop_front() {
                    Some(job) => break job,
                    None => state = self.wake.wait(state).unwrap_or_else(PoisonError::into_inner),
                }
            };
            job.stop.begin();
            state.running = Some((job.id.clone(), job.channel.clone(), Arc::clone(&job.stop)));
            drop(state);
            each(job);
            self.lock().running = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn job(id: i32, channel: &str) -> Job {
        let channel = (!channel.is_empty()).then(|| channel.to_owned());
        Job { id: id.into(), method: String::new(), params: Value::Null, channel, stop: Stop::new() }
    }

    #[test]
    fn a_newer_request_replaces_those_of_its_channel_that_wait() {
        let lane = Lane::default();
        assert!(lane.push(job(1, "a")).is_empty() && lane.push(job(2, "b")).is_empty() && lane.push(job(3, "")).is_empty());
        let refused = lane.push(job(4, "a"));
        assert_eq!(refused.len(), 1);
        assert_eq!((refused[0].0.clone(), refused[0].1.kind), (1.into(), FaultKind::Overtaken));
        assert!(lane.cancel(&2.into()) && !lane.cancel(&2.into()));
        lane.close();
        assert_eq!(lane.push(job(5, "")).len(), 1);
    }

    #[test]
    fn requests_beyond_the_limit_are_refused() {
        let lane = Lane::default();
        let refused: usize = (0..100).map(|id| lane.push(job(id, "")).len()).sum();
        assert_eq!(refused, 100 - MOST);
    }

    #[test]
    fn a_running_request_is_left_alone_for_a_while_and_stopped_then() {
        let lane = Arc::new(Lane::default());
        lane.push(job(1, "a"));
        let (out, seen) = std::sync::mpsc::channel();
        let worker = std::thread::spawn({
            let lane = Arc::clone(&lane);
            move || {
                lane.work(|job| {
                    let begin = Instant::now();
                    let _ = out.send((job.id.clone(), Duration::ZERO, None));
                    while job.id == 1.into() {
                        if let Err(fault) = job.stop.check() {
                            let _ = out.send((job.id, begin.elapsed(), Some(fault.kind)));
                            break;
                        }
                    }
                });
            }
        });
        assert_eq!(seen.recv().expect("begun").0, 1.into());
        lane.push(job(2, "a"));
        let (id, after, kind) = seen.recv().expect("stopped");
        assert_eq!((id, kind), (1.into(), Some(FaultKind::Overtaken)));
        assert!(after >= GRACE && after < 8 * GRACE, "{after:?}");
        assert_eq!(seen.recv().expect("the newer one").0, 2.into());
        lane.close();
        worker.join().expect("no panic");
    }
}
