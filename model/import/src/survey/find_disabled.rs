//! Pairs of links that need no test, or a clearance of their own.

use super::Subject;
use super::false_contacts::{MAX_COVERED_MOTORS, NEAR_M};
use crate::Surfaces;
use mobee_model::{LeftOut, NearPair, Robot, SceneError, random_poses};

/// Clearances that a pair of links that are always near can get, meters, the greatest first. The last one always fits.
pub(crate) const OWN_CLEARANCES_M: [f64; 4] = [0.006, 0.003, 0.001, 0.0];
/// Maximum share of poses that a pair's own clearance may block in addition to contacts.
const MAX_BLOCKED_SHARE: f64 = 0.05;
/// Share of poses with false contacts above which a pair that is always near is disabled: its test would block poses
/// at which the meshes are apart.
const MAX_FALSE_SHARE: f64 = 0.1;
/// Number of contacts of shapes for which the meshes of a pair that is always near are tested as well.
const JUDGED_CONTACTS: usize = 1000;

/// Results of a survey of all pairs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PairSurvey {
    /// Pairs to disable: see [`Robot::leave_out`].
    pub left_out: Vec<LeftOut>,
    /// Pairs to test with a clearance of their own: see [`Robot::bring_near`].
    pub near: Vec<NearPair>,
}

/// Observations about a pair that has been near at all poses so far, or whose meshes have not intersected.
struct PairObservation {
    nodes: (usize, usize),
    /// True if the poses cover the relative motion of the two.
    covered: bool,
    /// Number of poses at which its shapes were near.
    near: usize,
    /// Of the poses while it was near at all of them: the number at which it was within each own clearance.
    within: [usize; OWN_CLEARANCES_M.len()],
    /// True if the meshes intersected at any pose.
    met: bool,
    /// Number of contacts of shapes for which the meshes were tested, and of these the number with meshes apart.
    judged: usize,
    falsely: usize,
}

impl PairObservation {
    /// True if further poses may still show that the pair can be disabled.
    fn is_open(&self, poses: usize) -> bool {
        self.near == poses || (self.covered && !self.met)
    }

    /// Adds the pair to the survey, unless it is an ordinary one.
    fn conclude(&self, poses: usize, survey: &mut PairSurvey) {
        let [.., touching] = self.within;
        let always = self.near == poses;
        let falsely = touching as f64 * self.falsely as f64 / self.judged.max(1) as f64;
        let unseen = if self.met { "; contacts that their meshes make at times are not seen" } else { "" };
        let reason = match (self.near, always) {
            (0, _) => return,
            (_, true) if touching == poses => {
                let unseen = if self.falsely > 0 { unseen } else { "" };
                format!("in contact at each of {poses} poses{unseen}")
            }
            _ if self.covered && !self.met => format!("near, but never in contact at {poses} poses"),
            (_, true) if falsely > MAX_FALSE_SHARE * poses as f64 => {
                let mm = NEAR_M * 1e3;
                format!(
                    "never farther apart than {mm:.0} mm at {poses} poses, and often in contact by shapes alone{unseen}"
                )
            }
            (_, true) => {
                let blocked = |i: &usize| (self.within[*i] - touching) as f64 <= MAX_BLOCKED_SHARE * poses as f64;
                let own = (0..OWN_CLEARANCES_M.len()).find(blocked).map_or(0.0, |i| OWN_CLEARANCES_M[i]);
                let reason = format!("never farther apart than {:.0} mm at {poses} poses", NEAR_M * 1e3);
                survey.near.push(NearPair { nodes: self.nodes, clearance: own, reason });
                return;
            }
            _ => return,
        };
        survey.left_out.push(LeftOut { nodes: self.nodes, reason });
    }
}

/// The pairs of links that can be disabled according to random poses, and those that need a clearance of their own,
/// each with its reason.
///
/// Disabled are
/// * pairs whose shapes touch at every pose: a test could only block everything;
/// * pairs whose shapes come near although their meshes never intersect, and whose relative motion depends on at most
///   three motors, so that the poses cover it;
/// * pairs that are never farther apart than 12 mm and whose shapes often touch while the meshes are apart. The reason
///   mentions it if the meshes intersect at other poses.
///
/// All other pairs that are never farther apart than 12 mm get a clearance of their own: the greatest of 6, 3 and 1 mm
/// that blocks few more poses than contacts do, or 0.
///
/// A pair is never disabled because it touches often. Nor is a pair that was never near and that depends on many
/// motors: ten thousand poses of thirty motors are few, and a cheap test is better than an undetected contact.
///
/// # Arguments
/// * `poses`: number of poses; 10,000 or more.
/// * `progress`: called with the completed fraction, 0 to 1.
///
/// # Errors
/// If the robot can't be placed in a scene.
pub fn find_disabled_pairs(
    robot: &Robot,
    surfaces: &Surfaces,
    (poses, seed): (usize, u64),
    progress: &mut dyn FnMut(f64),
) -> Result<PairSurvey, SceneError> {
    let subject = Subject::new(robot, surfaces)?;
    let covered = |(a, b): (usize, usize)| robot.movers(Some(a), Some(b)).len() <= MAX_COVERED_MOTORS;
    let all = subject.tested.iter();
    let mut open: Vec<PairObservation> = all
        .map(|nodes| PairObservation {
            nodes: *nodes,
            covered: covered(*nodes),
            near: 0,
            within: Default::default(),
            met: false,
            judged: 0,
            falsely: 0,
        })
        .collect();
    for (done, q) in random_poses(robot, seed).take(poses).enumerate() {
        let placed = subject.place(&q);
        let frames = surfaces.frames(robot, &q);
        open.retain_mut(|pair| {
            let near = |margin: f64| subject.touching(&placed, pair.nodes, margin).next().is_some();
            if near(NEAR_M) {
                let always = pair.near == done;
                pair.near += 1;
                let [coarser @ .., _] = OWN_CLEARANCES_M;
                let touching = near(0.0);
                if always {
                    let [counts @ .., contacts] = &mut pair.within;
                    counts
                        .iter_mut()
                        .zip(coarser)
                        .for_each(|(count, own)| *count += usize::from(touching || near(own)));
                    *contacts += usize::from(touching);
                }
                // The shapes contain the meshes: if the shapes are apart, so are the meshes. Without meshes the shapes
                // alone decide.
                if touching && (!pair.met || (always && pair.judged < JUDGED_CONTACTS)) {
                    let met = subject.surfaces(pair.nodes).is_none_or(|(a, b)| surfaces.meet(&frames, a, b));
                    pair.met |= met;
                    pair.judged += 1;
                    pair.falsely += usize::from(!met);
                }
            }
            pair.is_open(done + 1)
        });
        if done % 64 == 0 {
            progress(done as f64 / poses.max(1) as f64);
        }
    }
    let mut survey = PairSurvey::default();
    open.iter().for_each(|pair| pair.conclude(poses, &mut survey));
    Ok(survey)
}
