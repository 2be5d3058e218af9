//! The detector's shell.

use super::{Eye, Looking, PATIENCE, PartMaker, Seen};
use crate::runtime::attempt::{Given, attempt};
use crate::wiring::SharedContext;
use mobee_contract::{Detector, Event, Frame, Region, SeenPicture, SwapPart, SwapStep, limit_regions};
use ractor::{Actor, ActorProcessingErr, ActorRef, RpcReplyPort};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The detector's actor.
pub struct DetectorActor;

/// What it hears.
pub enum DetectorMsg {
    /// There is a frame.
    Frames,
    /// A new detector looks on: what it sees is told beside what this one sees, and goes no further.
    LookOn {
        /// Makes it.
        maker: PartMaker<dyn Detector>,
        /// How long it may take for a frame.
        budget: Duration,
    },
    /// Another detector takes over, with what this one has learned unless it is to begin anew; answered when it has.
    TakeOver {
        /// Makes it.
        maker: PartMaker<dyn Detector>,
        /// Whether it begins anew.
        fresh: bool,
        /// Who waits.
        reply: RpcReplyPort<()>,
    },
}

/// What it keeps.
pub struct Detecting {
    shared: Arc<SharedContext>,
    eye: Arc<Eye>,
    /// Away while it looks at a frame.
    detector: Option<Box<dyn Detector>>,
    /// A new one that looks on, and how long it may take for a frame.
    onlooker: Option<(Box<dyn Detector>, Duration)>,
    /// Whether it was said that it tells numbers that are none.
    told_unsound: bool,
}

impl Detecting {
    /// Makes the detector in force. One that does not take what was learned begins anew.
    fn make(&mut self) -> Result<(), String> {
        let Looking { maker, state } = self.eye.seat.part();
        let mut detector = maker()?;
        if let Some(state) = state {
            let _ = detector.import(state);
        }
        self.detector = Some(detector);
        Ok(())
    }

    /// Makes another detector the one in force.
    fn take_over(&mut self, maker: PartMaker<dyn Detector>, fresh: bool) -> Result<(), String> {
        self.onlooker = None;
        let now = self.shared.clock.now();
        let state = self.eye.seat.part().state.filter(|_| !fresh);
        if !self.eye.seat.take_over(Looking { maker, state }, now) {
            return Ok(());
        }
        // told first: what its making breaks is a reason to revert
        self.shared.tell_beside(&self.eye.name, SwapPart::Detector, SwapStep::TookOver { gap: 0.0, map: None });
        self.make()
    }

    /// Lets the onlooker see a frame, if there is one. If it fails, it is gone, and its exchange is told why.
    async fn look_on(&mut self, frame: &Frame) {
        let Some((mut detector, budget)) = self.onlooker.take() else { return };
        let (frame, exposed, most) = (frame.clone(), frame.exposed, self.eye.max_regions);
        let look = move || {
            let mut regions = detector.detect(&frame);
            let failure = detector.failure();
            regions.retain(Region::is_finite);
            let omitted = detector.omitted() + limit_regions(&mut regions, most);
            // it is not waited for by a virtual clock, but one that is too slow is so by any
            let cost = if detector.takes() > budget { detector.takes() } else { Duration::ZERO };
            Given { value: (detector, regions, omitted, failure), cost }
        };
        match attempt(&self.shared.clock, budget, look).await {
            Ok((detector, regions, omitted, None)) => {
                self.onlooker = Some((detector, budget));
                let camera = self.eye.name.clone();
                self.shared.tell(Event::Sighted { camera, exposed, regions, omitted, is_shadow: true });
            }
            Ok((.., Some(why))) | Err(why) => *self.eye.onlooker_fault.lock() = Some(why),
        }
    }

    /// Looks at the newest frame; `false`: there is none.
    async fn look(&mut self) -> Result<bool, String> {
        let Some(frame) = self.eye.frames.pop() else { return Ok(false) };
        let shown = frame.clone();
        let mut detector = self.detector.take().ok_or("the detector is away")?;
        let (exposed, intrinsics, most) = (frame.exposed, frame.intrinsics, self.eye.max_regions);
        let look = move || {
            let (mut regions, cost) = (detector.detect(&frame), detector.takes());
            let all = regions.len();
            regions.retain(Region::is_finite);
            let is_sound = regions.len() == all;
            let omitted = detector.omitted() + limit_regions(&mut regions, most);
            let told = (detector.export(), detector.mask(), detector.complaint());
            let answer = detector.failure().map_or(Ok((regions, omitted)), Err);
            Given { value: (detector, answer, is_sound, told), cost }
        };
        let budget = self.eye.seat.budget().unwrap_or(PATIENCE);
        let seen = attempt(&self.shared.clock, budget, look).await?;
        let (detector, answer, is_sound, (state, mask, complaint)) = seen;
        let (regions, omitted) = answer?;
        self.detector = Some(detector);
        self.eye.seat.change(|looking| looking.state = state);
        self.eye.seat.answered(self.shared.clock.now());
        if let Some(seen) = &self.eye.seen {
            let camera = self.eye.name.as_str().into();
            seen.push(Seen { camera, intrinsics, exposed, regions: regions.clone() });
        }
        if let Some(what) = complaint {
            self.shared.tell(Event::Warning { text: format!("{}: {what}", self.eye.name) });
        }
        if !is_sound && !std::mem::replace(&mut self.told_unsound, true) {
            let text = format!("{}: its detector told numbers that are none: what has them is left out", self.eye.name);
            self.shared.tell(Event::Warning { text });
        }
        if omitted > 0 {
            self.tell_omitted(omitted);
        }
        let mount = self.eye.mount.lock().clone();
        let seen = SeenPicture { frame: shown.clone(), regions: regions.as_slice().into(), mask, mount };
        self.shared.taps.picture(self.shared.clock.now(), &self.eye.name, &Arc::new(seen));
        self.shared.tell(Event::Sighted { camera: self.eye.name.clone(), exposed, regions, omitted, is_shadow: false });
        self.look_on(&shown).await;
        Ok(true)
    }
}

impl Detecting {
    /// Warns of regions that are left out, once in a run.
    fn tell_omitted(&self, omitted: u64) {
        if self.eye.told_omitted.swap(true, Ordering::Relaxed) {
            return;
        }
        let (name, most) = (&self.eye.name, self.eye.max_regions);
        let text = format!(
            "{name}: its detector found {omitted} regions in one picture beyond the first {most} of each object; they are left out and \
             counted. If they are noise, train the detector again; else raise `max_regions`"
        );
        self.shared.tell(Event::Warning { text });
    }
}

impl Actor for DetectorActor {
    type Msg = DetectorMsg;
    type State = Detecting;
    type Arguments = (Arc<SharedContext>, Arc<Eye>);

    async fn pre_start(
        &self,
        myself: ActorRef<DetectorMsg>,
        (shared, eye): Self::Arguments,
    ) -> Result<Detecting, ActorProcessingErr> {
        let mut detecting = Detecting { shared, eye, detector: None, onlooker: None, told_unsound: false };
        detecting.make()?;
        detecting.eye.detector.connect(myself.clone());
        detecting.eye.frames.attach(Box::new(move || myself.send_message(DetectorMsg::Frames).is_ok()));
        Ok(detecting)
    }

    async fn handle(
        &self,
        myself: ActorRef<DetectorMsg>,
        message: DetectorMsg,
        detecting: &mut Detecting,
    ) -> Result<(), ActorProcessingErr> {
        match message {
            // one at a time: other messages have their turn although there is always a newer frame
            DetectorMsg::Frames if detecting.look().await? => myself.send_message(DetectorMsg::Frames)?,
            DetectorMsg::Frames => {}
            DetectorMsg::LookOn { maker, budget } => match maker() {
                Ok(detector) => detecting.onlooker = Some((detector, budget)),
                Err(why) => *detecting.eye.onlooker_fault.lock() = Some(why),
            },
            DetectorMsg::TakeOver { maker, fresh, reply } => {
                detecting.take_over(maker, fresh)?;
                // who asked may have gone
                let _ = reply.send(());
            }
        }
        Ok(())
    }
}
