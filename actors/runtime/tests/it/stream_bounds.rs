//! A bounded stream: never grows, rings once, and accounts for every item (I6, I7).

use mobee_runtime::clock::{ClockKind, runtime};
use mobee_runtime::stream::{Stream, StreamCounters};
use proptest::prelude::*;
use ractor::{Actor, ActorProcessingErr, ActorRef};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

fn bell(count: &Arc<AtomicUsize>) -> mobee_runtime::stream::Doorbell {
    let count = count.clone();
    Box::new(move || {
        count.fetch_add(1, Ordering::SeqCst);
        true
    })
}

#[test]
fn the_doorbell_rings_once_until_the_queue_is_empty_again() {
    let rings = Arc::new(AtomicUsize::new(0));
    let s = Stream::new("s", 4);
    s.attach(bell(&rings));
    (0..3).for_each(|i| s.push(i));
    assert_eq!(rings.load(Ordering::SeqCst), 1);
    assert_eq!((s.pop(), s.pop(), s.pop(), s.pop()), (Some(0), Some(1), Some(2), None));
    s.push(9);
    assert_eq!(rings.load(Ordering::SeqCst), 2);
}

#[test]
fn a_capacity_of_one_keeps_the_latest() {
    let s = Stream::new("s", 1);
    (0..100).for_each(|i| s.push(i));
    assert_eq!(s.pop(), Some(99));
    assert_eq!(s.counters(), StreamCounters { sent: 100, handled: 1, queued: 0, dropped: 99 });
}

#[test]
fn a_new_receiver_starts_afresh_and_the_loss_is_counted() {
    let rings = Arc::new(AtomicUsize::new(0));
    let s = Stream::new("s", 10);
    s.push(1);
    s.attach(bell(&rings));
    assert_eq!(rings.load(Ordering::SeqCst), 1, "what was pushed before the first receiver came is for it");
    s.push(2);
    s.attach(bell(&rings));
    assert_eq!((s.pop(), s.counters().dropped), (None, 2));
    s.push(3);
    assert_eq!((s.pop(), rings.load(Ordering::SeqCst)), (Some(3), 2));
}

proptest! {
    #[test]
    fn sent_is_handled_and_queued_and_dropped(capacity in 1_usize..5, acts in prop::collection::vec(0_u8..8, 0..200)) {
        let alive = Arc::new(AtomicUsize::new(0));
        let s = Stream::new("s", capacity);
        let mut next = 0_u32;
        let mut last = None;
        for act in acts {
            match act {
                0..=3 => { s.push(next); next += 1; }
                4 | 5 => if let Some(x) = s.pop() {
                    prop_assert!(last < Some(x), "in order");
                    last = Some(x);
                },
                6 => if let Some(x) = s.drain().last() { last = Some(*x); },
                _ => s.attach(bell(&alive)),
            }
            let c = s.counters();
            prop_assert_eq!(c.sent, u64::from(next));
            prop_assert_eq!(c.sent, c.handled + c.queued + c.dropped);
            prop_assert!(c.queued <= capacity as u64);
        }
    }
}

struct Receiver;

impl Actor for Receiver {
    type Msg = ();
    type State = (Stream<u64>, u64);
    type Arguments = Stream<u64>;

    async fn pre_start(&self, me: ActorRef<()>, stream: Stream<u64>) -> Result<Self::State, ActorProcessingErr> {
        stream.attach(Box::new(move || me.send_message(()).is_ok()));
        Ok((stream, 0))
    }
    async fn handle(&self, _: ActorRef<()>, (): (), state: &mut Self::State) -> Result<(), ActorProcessingErr> {
        while let Some(x) = state.0.pop() {
            assert_ne!(x, 500, "planned death");
            state.1 += 1;
        }
        Ok(())
    }
}

#[test]
fn a_stream_outlives_its_receiver() {
    runtime(ClockKind::Virtual).unwrap().block_on(async {
        let s = Stream::new("s", 8);
        Actor::spawn(None, Receiver, s.clone()).await.unwrap();
        for x in 0..=500 {
            s.push(x);
            tokio::task::yield_now().await;
        }
        (501..600).for_each(|x| s.push(x));
        assert_eq!(s.counters(), StreamCounters { sent: 600, handled: 501, queued: 8, dropped: 91 });
        Actor::spawn(None, Receiver, s.clone()).await.unwrap();
        for x in 600..1000 {
            s.push(x);
            tokio::task::yield_now().await;
        }
        tokio::task::yield_now().await;
        assert_eq!(s.counters(), StreamCounters { sent: 1000, handled: 901, queued: 0, dropped: 99 });
    });
}
