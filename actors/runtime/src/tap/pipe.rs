//! One sink behind its bounded queue, on its own thread.

use super::{Kept, OpenSink, Pictures, SinkSpec};
use crate::clock::ClockKind;
use crate::load::Load;
use crate::stream::StreamCounters;
use mobee_contract::{Entry, Event, Pose, SeenPicture, Sink, Time};
use mobee_model::Contact;
use std::collections::{BTreeMap, VecDeque};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Time for which entries wait for more, so that the sink's thread is woken rarely.
const BATCH_TIME: Duration = Duration::from_millis(20);
/// Number of [`BATCH_TIME`] intervals after which an idle sink is flushed: it must notice that it can no longer
/// write even if nothing happens.
const IDLE_TURNS: u32 = 25;

/// Least interval between two images of one camera ([`Pictures::Few`]).
const IMAGE_INTERVAL: Duration = Duration::from_millis(200);
/// Most images that are queued for a sink.
const MAX_QUEUED_IMAGES: usize = 64;

/// Counters of a sink at its end.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SinkReport {
    /// Name of the sink.
    pub name: String,
    /// Entries that were reported to it.
    pub sent: u64,
    /// Entries that it has written.
    pub handled: u64,
    /// Entries that were still queued when the sink was closed after an error.
    pub queued: u64,
    /// Entries dropped.
    pub dropped: u64,
    /// Reason for which it was not written to the end.
    pub error: Option<String>,
}

impl SinkReport {
    /// Returns the counters as the event that a run ends with.
    pub fn link(&self) -> Event {
        let SinkReport { name, sent, handled, queued, dropped, .. } = self.clone();
        Event::Link { link: name, sent, handled, queued, dropped, most: 0, capacity: 0 }
    }
}

pub(super) struct Pipe {
    spec: SinkSpec,
    /// Opens the sink; `None` until one is attached.
    open: Mutex<Option<OpenSink>>,
    virtual_time: bool,
    shared: Arc<SharedPipe>,
    thread: Mutex<Option<JoinHandle<()>>>,
}

struct SharedPipe {
    queue: Mutex<PipeQueue>,
    filled: Condvar,
    emptied: Condvar,
    /// Processor time that writing has taken.
    load: Load,
    /// Number of entries written and flushes made: a thread that makes no progress is abandoned at the end.
    steps: AtomicU64,
}

#[derive(Default)]
struct PipeQueue {
    entries: VecDeque<(Time, Entry)>,
    /// Entries that the thread has taken and not written yet.
    in_hand: usize,
    /// True if the sink's thread sleeps.
    asleep: bool,
    closed: bool,
    /// True if the sink is closed and its thread has ended.
    ended: bool,
    /// Reason for which the thread has ended early.
    error: Option<String>,
    /// Present state, for a sink that is opened later.
    kept: Kept,
    /// Number of threads that were started; only the newest one counts.
    threads: u64,
    /// Number of sinks that were attached during the run.
    attached: u64,
    /// Loss of an event that must not be lost.
    lost: Option<String>,
    sent: u64,
    handled: u64,
    dropped: u64,
    /// Per robot: the interval of its last pose, and whether it was in contact.
    last: BTreeMap<usize, (u64, bool)>,
    /// Per camera: time of its last image.
    pictures: BTreeMap<String, Time>,
}

impl PipeQueue {
    fn waiting_pictures(&self) -> usize {
        self.entries.iter().filter(|(_, e)| matches!(e, Entry::Picture { .. })).count()
    }
}

impl SharedPipe {
    fn lock(&self) -> MutexGuard<'_, PipeQueue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Ends a thread; no-op for one that was replaced.
    fn ended(&self, thread: u64, error: Option<String>) {
        let mut queue = self.lock();
        if queue.threads == thread {
            (queue.error, queue.ended) = (error, true);
            self.emptied.notify_all();
        }
    }
}

impl Pipe {
    pub(super) fn spawn(clock: ClockKind, spec: SinkSpec) -> Result<Pipe, String> {
        let spec = SinkSpec { capacity: spec.capacity.max(1), ..spec };
        let shared = SharedPipe {
            queue: Mutex::default(),
            filled: Condvar::new(),
            emptied: Condvar::new(),
            load: Load::default(),
            steps: AtomicU64::new(0),
        };
        shared.lock().ended = true;
        let pipe = Pipe {
            open: Mutex::new(spec.open.clone()),
            spec,
            virtual_time: clock == ClockKind::Virtual,
            shared: Arc::new(shared),
            thread: Mutex::new(None),
        };
        pipe.open().map_err(|e| format!("{}: {e}", pipe.spec.name))?;
        Ok(pipe)
    }

    pub(super) fn name(&self) -> &str {
        &self.spec.name
    }

    pub(super) fn is_essential(&self) -> bool {
        self.spec.essential
    }

    /// Opens or reopens the sink, if there is one, and starts its thread, which begins with the queued entries.
    pub(super) fn open(&self) -> Result<(), String> {
        let attached = self.attached();
        let open = self.open.lock().unwrap_or_else(PoisonError::into_inner).clone();
        open.map_or(Ok(()), |open| self.start(open()?, attached))
    }

    /// Replaces the present sink, whose thread ends by itself when it can. `open` reopens the new one.
    pub(super) fn attach(&self, sink: Box<dyn Sink>, open: OpenSink) -> Result<(), String> {
        *self.open.lock().unwrap_or_else(PoisonError::into_inner) = Some(open);
        self.drop_queued();
        let attached = {
            let mut queue = self.shared.lock();
            queue.attached += 1;
            queue.attached
        };
        self.start(sink, attached)
    }

    /// Starts the thread of a sink, unless another one was attached in between.
    fn start(&self, mut sink: Box<dyn Sink>, attached: u64) -> Result<(), String> {
        let (mine, kept) = {
            let mut queue = self.shared.lock();
            if queue.attached != attached {
                return Ok(());
            }
            queue.dropped += std::mem::take(&mut queue.in_hand) as u64;
            (queue.error, queue.ended) = (None, false);
            queue.threads += 1;
            (queue.threads, queue.kept.clone())
        };
        let shared = self.shared.clone();
        let work = move || {
            let end = catch_unwind(AssertUnwindSafe(|| {
                for (at, entry) in kept.entries() {
                    sink.write(at, &entry)?;
                    shared.steps.fetch_add(1, Ordering::Relaxed);
                }
                serve(&shared, sink.as_mut(), mine)
            }));
            // Dropping the sink writes its buffered entries.
            let closed = catch_unwind(AssertUnwindSafe(|| drop(sink)));
            let error = match end.and_then(|end| closed.map(|()| end)) {
                Ok(Ok(())) => None,
                Ok(Err(e)) => Some(e),
                Err(panic) => Some(panic_text(panic.as_ref())),
            };
            shared.ended(mine, error);
        };
        let thread = std::thread::Builder::new().name(self.spec.name.clone()).spawn(work);
        let thread = thread.map_err(|e| {
            let why = format!("no thread: {e}");
            self.shared.ended(mine, Some(why.clone()));
            why
        })?;
        *self.thread.lock().unwrap_or_else(PoisonError::into_inner) = Some(thread);
        Ok(())
    }

    pub(super) fn push_pose(&self, at: Time, robot: usize, q: &Pose, contacts: &Arc<[Contact]>) {
        let Some(period) = self.spec.poses else { return };
        let mut queue = self.shared.lock();
        if queue.threads == 0 {
            return;
        }
        let now = (at.0.checked_div(u64::try_from(period.as_nanos()).unwrap_or(u64::MAX)), !contacts.is_empty());
        if let (Some(span), touching) = now
            && queue.last.insert(robot, (span, touching)) == Some((span, touching))
        {
            return;
        }
        let entry = Entry::Pose { robot, q: q.clone(), contacts: contacts.clone() };
        self.put(queue, at, entry);
    }

    /// Queues a camera image. Images are large, so few are queued.
    pub(super) fn push_picture(&self, at: Time, camera: &str, seen: &Arc<SeenPicture>) {
        let mut queue = self.shared.lock();
        if queue.threads == 0 {
            return;
        }
        match &self.spec.pictures {
            Pictures::Few => {
                if queue.pictures.get(camera).is_some_and(|last| at < *last + IMAGE_INTERVAL) {
                    return;
                }
                queue.pictures.insert(camera.into(), at);
            }
            Pictures::All(cameras) if cameras.iter().any(|c| c == camera) => {
                while self.virtual_time && queue.waiting_pictures() >= MAX_QUEUED_IMAGES && queue.error.is_none() {
                    self.shared.filled.notify_one();
                    queue = self.shared.emptied.wait(queue).unwrap_or_else(PoisonError::into_inner);
                }
            }
            Pictures::All(_) | Pictures::None => return,
        }
        if queue.waiting_pictures() >= MAX_QUEUED_IMAGES {
            queue.sent += 1;
            queue.dropped += 1;
            return;
        }
        let entry = Entry::Picture { camera: camera.into(), seen: seen.clone() };
        self.put(queue, at, entry);
    }

    pub(super) fn push(&self, at: Time, entry: &Entry) {
        if self.spec.poses.is_none() && !matches!(entry, Entry::Event(_)) {
            return;
        }
        let mut queue = self.shared.lock();
        if self.spec.poses.is_some() {
            queue.kept.note(at, entry);
        }
        self.put(queue, at, entry.clone());
    }

    fn put(&self, mut queue: MutexGuard<'_, PipeQueue>, at: Time, entry: Entry) {
        if queue.closed || queue.threads == 0 {
            return;
        }
        queue.sent += 1;
        let full = |queue: &PipeQueue| queue.entries.len() + queue.in_hand >= self.spec.capacity;
        while self.virtual_time && full(&queue) && queue.error.is_none() {
            self.shared.filled.notify_one();
            queue = self.shared.emptied.wait(queue).unwrap_or_else(PoisonError::into_inner);
        }
        if full(&queue) {
            let pose = queue.entries.iter().position(|(_, e)| matches!(e, Entry::Pose { .. }));
            queue.dropped += 1;
            match pose {
                Some(oldest) => drop(queue.entries.remove(oldest)),
                None if matches!(entry, Entry::Pose { .. }) => return,
                None if self.spec.essential => {
                    let why = queue.error.clone().unwrap_or_else(|| "the disk can't keep up".into());
                    queue.lost.get_or_insert(format!("{} lost an event: {why}", self.spec.name));
                    return;
                }
                None => {
                    // The thread may have taken all of them.
                    if queue.entries.pop_front().is_none() {
                        return;
                    }
                }
            }
        }
        let urgent = !self.virtual_time && matches!(entry, Entry::Event(_));
        queue.entries.push_back((at, entry));
        if queue.asleep && (urgent || queue.entries.len() * 2 >= self.spec.capacity) {
            queue.asleep = false;
            self.shared.filled.notify_one();
        }
    }

    /// Reason for which the thread has ended early, if it has.
    pub(super) fn error(&self) -> Option<String> {
        self.shared.lock().error.clone()
    }

    /// Drops the queued entries, which can't be written, so that no producer waits for this sink.
    pub(super) fn drop_queued(&self) {
        let mut queue = self.shared.lock();
        queue.dropped += queue.entries.len() as u64;
        queue.entries.clear();
    }

    /// Number of sinks that were attached during the run.
    pub(super) fn attached(&self) -> u64 {
        self.shared.lock().attached
    }

    /// Entries dropped so far.
    pub(super) fn dropped(&self) -> u64 {
        self.shared.lock().dropped
    }

    /// Counters so far; entries that the thread has taken count as queued.
    pub(super) fn counters(&self) -> StreamCounters {
        let queue = self.shared.lock();
        let queued = (queue.entries.len() + queue.in_hand) as u64;
        StreamCounters { sent: queue.sent, handled: queue.handled, queued, dropped: queue.dropped }
    }

    /// Processor time that writing has taken so far.
    pub(super) fn busy(&self) -> Duration {
        self.shared.load.busy()
    }

    /// For an essential sink: the reason for which the record is incomplete, or is not being written now.
    pub(super) fn broken(&self) -> Option<String> {
        if !self.spec.essential {
            return None;
        }
        let queue = self.shared.lock();
        queue.lost.clone().or_else(|| queue.error.as_ref().map(|e| format!("{}: {e}", self.spec.name)))
    }

    /// Closes the sink, and waits for its thread as long as that makes progress. A thread that hangs is
    /// abandoned, so that a frozen viewer or disk does not block the end of the run.
    pub(super) fn finish(&self) -> SinkReport {
        if self.spec.essential && self.error().is_some() {
            // Try a last time: the disk may have space again.
            let _ = self.open();
        }
        let mut queue = self.shared.lock();
        queue.closed = true;
        self.shared.filled.notify_one();
        let steps = || self.shared.steps.load(Ordering::Relaxed);
        let mut hangs = false;
        while !queue.ended && !hangs {
            let before = steps();
            let waited = self.shared.emptied.wait_timeout(queue, self.spec.patience);
            let (locked, late) = waited.unwrap_or_else(PoisonError::into_inner);
            queue = locked;
            hangs = late.timed_out() && steps() == before;
        }
        let left = format!("it has not answered for {} s, and is left behind", self.spec.patience.as_secs());
        let report = SinkReport {
            name: self.spec.name.clone(),
            sent: queue.sent,
            handled: queue.handled,
            queued: (queue.entries.len() + queue.in_hand) as u64,
            dropped: queue.dropped,
            error: queue.lost.clone().or_else(|| queue.error.clone()).or((hangs && !queue.ended).then_some(left)),
        };
        drop(queue);
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(thread) = thread.filter(|_| !hangs) {
            // Its panic has been caught and reported.
            let _ = thread.join();
        }
        report
    }
}

/// Body of a sink's thread: writes entries until the pipe is closed or the sink is replaced. An entry that
/// failed returns to the queue.
fn serve(shared: &SharedPipe, sink: &mut dyn Sink, mine: u64) -> Result<(), String> {
    let mut batch = VecDeque::new();
    let mut dropped = shared.lock().dropped;
    loop {
        let mut queue = shared.lock();
        if queue.threads != mine {
            return Ok(());
        }
        if queue.entries.is_empty() && queue.closed {
            drop(queue);
            return sink.flush();
        }
        if queue.entries.is_empty() {
            drop(queue);
            shared.load.counts(|| sink.flush())?;
            shared.steps.fetch_add(1, Ordering::Relaxed);
            queue = shared.lock();
        }
        let mut turns = 0;
        while queue.entries.is_empty() && !queue.closed && queue.threads == mine && turns < IDLE_TURNS {
            turns += 1;
            queue.asleep = true;
            queue = shared.filled.wait_timeout(queue, BATCH_TIME).unwrap_or_else(PoisonError::into_inner).0;
            queue.asleep = false;
        }
        if queue.threads != mine {
            return Ok(());
        }
        std::mem::swap(&mut batch, &mut queue.entries);
        queue.in_hand = batch.len();
        // There is room for images again.
        shared.emptied.notify_all();
        let lost = std::mem::replace(&mut dropped, queue.dropped) != queue.dropped;
        drop(queue);
        let write = || {
            if lost {
                sink.lost();
            }
            while let Some((at, entry)) = batch.front() {
                sink.write(*at, entry)?;
                batch.pop_front();
                shared.steps.fetch_add(1, Ordering::Relaxed);
            }
            Ok(())
        };
        let end = catch_unwind(AssertUnwindSafe(|| shared.load.counts(write)));
        let mut queue = shared.lock();
        if queue.threads != mine {
            return Ok(());
        }
        queue.handled += (queue.in_hand - batch.len()) as u64;
        queue.in_hand = 0;
        if !batch.is_empty() {
            batch.append(&mut queue.entries);
            std::mem::swap(&mut batch, &mut queue.entries);
        }
        shared.emptied.notify_all();
        drop(queue);
        end.unwrap_or_else(|panic| Err(panic_text(panic.as_ref())))?;
    }
}

fn panic_text(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(ToString::to_string);
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
    format!("it panicked: {}", text.unwrap_or_else(|| "no message".into()))
}
