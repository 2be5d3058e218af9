//! I10 and I1: the death of any actor stops the robot; nothing moves on its restart.

use crate::common::Trial;
use mobee_runtime::system::{Control, Reason};
use std::time::Duration;

#[test]
fn any_actor_may_die_in_mid_motion() {
    for actor in ["arm/driver", "arm/history", "model", "arm/supervise", "arm/reflex", "arm/agent"] {
        let controls = vec![(Duration::from_millis(1200), Control::Kill(actor.into()))];
        let poses = vec![[90.0, 0.0, 0.0], [0.0, 0.0, 0.0]];
        let ran = Trial { controls, poses, ..Trial::default() }.run();
        assert_eq!(ran.end.reason, Reason::Done, "{actor}\n{}", ran.lines());
        assert_eq!(ran.end.counts.commits, ran.end.counts.outcomes(), "{actor}\n{}", ran.lines());
        assert!(ran.end.counts.restarts >= 1, "{actor}");
        assert!(ran.lines().contains("Restarted"), "{actor}");
        assert_eq!(ran.violations(), [], "{actor}\n{}", ran.lines());
    }
}
