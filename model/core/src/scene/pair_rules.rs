//! Pairs with rules of their own: those of the robots' files, and those of a query, such as a pick that ends in
//! contact.
//!
//! A rule names two things: links, parts and markers of the query's robot (a marker stands for the rigid body that
//! carries it), objects, and other robots as a whole.

use super::{Scene, SceneError, ShapeId};
use crate::engine::Engine;
use crate::robot::Robot;
use mobee_text::suggestion;
use std::collections::BTreeSet;
use std::sync::Arc;

/// A rule for the pairs of two named things.
///
/// # Examples
/// ```
/// use mobee_model::PairRule;
/// let pick = PairRule::may_touch("gripper:cup").expect("two names");
/// assert_eq!((pick.names[1].as_str(), pick.clearance), ("cup", None));
/// assert!(PairRule::may_touch("gripper").is_none());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PairRule {
    /// The two names, in any order.
    pub names: [String; 2],
    /// Clearance of the pairs, meters, where it is lower than that of the query; `None`: they may touch.
    pub clearance: Option<f64>,
}

impl PairRule {
    /// A pair that may touch, written `A:B`; `None` if these are not two names.
    pub fn may_touch(names: &str) -> Option<PairRule> {
        let (a, b) = names.split_once(':')?;
        let names = [a.trim(), b.trim()];
        let sound = names.iter().all(|name| !name.is_empty() && !name.contains(':'));
        sound.then(|| PairRule { names: names.map(str::to_owned), clearance: None })
    }

    /// A pair with a clearance of its own, meters, written `A:B`; `None` if these are not two names.
    pub fn near(names: &str, clearance: f64) -> Option<PairRule> {
        Some(PairRule { clearance: Some(clearance), ..Self::may_touch(names)? })
    }
}

/// Pairs that other rules may change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum RuleChange {
    /// None: the rules are the same.
    None,
    /// Pairs with objects.
    Objects,
    /// Pairs of the robots, too.
    Robots,
}

/// A rule with the shapes that it is about.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ResolvedRule {
    sides: [RuleSide; 2],
    clearance: Option<f64>,
}

impl ResolvedRule {
    fn concerns(&self, (a, b): (ShapeId, ShapeId)) -> bool {
        let [one, other] = &self.sides;
        (one.has(a) && other.has(b)) || (one.has(b) && other.has(a))
    }

    fn has_object(&self) -> bool {
        self.sides.iter().any(|side| matches!(side, RuleSide::Object(_)))
    }

    /// True if the shape belongs to one of its two things.
    pub fn names(&self, id: ShapeId) -> bool {
        self.sides.iter().any(|side| side.has(id))
    }
}

/// The shapes of one name.
#[derive(Clone, Debug, PartialEq)]
enum RuleSide {
    Object(u32),
    /// Nodes of a robot.
    Nodes(u16, BTreeSet<u16>),
    Robot(u16),
}

impl RuleSide {
    fn has(&self, id: ShapeId) -> bool {
        match (self, id) {
            (RuleSide::Object(own), ShapeId::Object { object, .. }) => *own == object,
            (RuleSide::Nodes(own, nodes), ShapeId::Robot { robot, node, .. }) => *own == robot && nodes.contains(&node),
            (RuleSide::Robot(own), ShapeId::Robot { robot, .. }) => *own == robot,
            _ => false,
        }
    }
}

/// Treatment of a pair by all queries.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PairPolicy {
    /// The clearance of the query applies.
    General,
    /// Its own clearance applies where it is lower, meters.
    Near(f64),
    /// It is not tested.
    MayTouch,
}

/// Finds the policy of a pair: the most permissive of all rules.
pub(super) fn rule_of(robots: &[Arc<Robot>], rules: &[ResolvedRule], (a, b): (ShapeId, ShapeId)) -> PairPolicy {
    let mut least = own_clearance(robots, a, b);
    for rule in rules {
        if rule.concerns((a, b)) {
            let Some(clearance) = rule.clearance else { return PairPolicy::MayTouch };
            least = Some(least.map_or(clearance, |least| least.min(clearance)));
        }
    }
    least.map_or(PairPolicy::General, PairPolicy::Near)
}

/// The clearance that the file of a robot gives a pair of its nodes.
fn own_clearance(robots: &[Arc<Robot>], a: ShapeId, b: ShapeId) -> Option<f64> {
    let (ShapeId::Robot { robot, node: a, .. }, ShapeId::Robot { robot: other, node: b, .. }) = (a, b) else {
        return None;
    };
    let nodes = (usize::from(a.min(b)), usize::from(a.max(b)));
    let near = &robots.get(usize::from(robot)).filter(|_| robot == other)?.near;
    near.iter().find(|pair| pair.nodes == nodes).map(|pair| pair.clearance)
}

impl<E: Engine> Scene<E> {
    /// The same scene with rules for pairs, instead of those that it has: its queries, and plans in it, follow them.
    /// The epoch is unchanged.
    ///
    /// # Arguments
    /// * `robot`: the robot whose links, parts and markers the rules name, an index into [`Scene::robots`].
    ///
    /// # Errors
    /// A name that does not exist, with the known ones; a name of two things; a clearance that is negative or not
    /// finite.
    pub fn with_pair_rules(&self, robot: usize, rules: &[PairRule]) -> Result<Self, SceneError> {
        let rules = rules.iter().map(|rule| self.resolve_rule(robot, rule)).collect::<Result<_, _>>()?;
        Ok(self.ruled(rules))
    }

    /// As [`Scene::with_pair_rules`], but rules with unknown names are ignored: an object may be absent now.
    pub fn with_pair_rules_of_present(&self, robot: usize, rules: &[PairRule]) -> Self {
        self.ruled(rules.iter().filter_map(|rule| self.resolve_rule(robot, rule).ok()).collect())
    }

    /// True if a rule concerns a tested pair: not links that are neighbors or that the robot's file disables, nor an
    /// object that is no obstacle.
    ///
    /// # Errors
    /// As [`Scene::with_pair_rules`].
    pub fn tests_pair_of(&self, robot: usize, rule: &PairRule) -> Result<bool, SceneError> {
        let rule = self.resolve_rule(robot, rule)?;
        let pairs = self.pairs().iter().filter_map(|(a, b)| Some((self.shape_id(*a)?, self.shape_id(*b)?)));
        Ok(pairs.into_iter().any(|pair| rule.concerns(pair)))
    }

    fn ruled(&self, rules: Arc<[ResolvedRule]>) -> Self {
        if rules == self.rules {
            return self.clone();
        }
        let of_robots = |rules: &[ResolvedRule]| -> Vec<ResolvedRule> {
            rules.iter().filter(|rule| !rule.has_object()).cloned().collect()
        };
        let change = if of_robots(&rules) == of_robots(&self.rules) { RuleChange::Objects } else { RuleChange::Robots };
        let world = Arc::new(self.world.among(&self.bodies, &self.objects, (&rules, change), |_| false));
        Scene { rules, world, ..self.clone() }
    }

    fn resolve_rule(&self, robot: usize, rule: &PairRule) -> Result<ResolvedRule, SceneError> {
        let [a, b] = &rule.names;
        if let Some(clearance) = rule.clearance.filter(|c| !(0.0..f64::INFINITY).contains(c)) {
            let what = format!("{a}:{b} has a clearance of {clearance} m");
            return Err(SceneError::PairRule { what, help: "give a number from 0 on".to_owned() });
        }
        let sides = [self.rule_side(robot, a)?, self.rule_side(robot, b)?];
        Ok(ResolvedRule { sides, clearance: rule.clearance })
    }

    /// The shapes of a name.
    fn rule_side(&self, robot: usize, name: &str) -> Result<RuleSide, SceneError> {
        let mut found = Vec::new();
        found.extend(self.object(name).map(|(id, _)| RuleSide::Object(id)));
        let others = self.robots().iter().enumerate().filter(|(r, _)| *r != robot);
        found.extend(others.filter(|(_, other)| other.name == name).map(|(r, _)| RuleSide::Robot(r as u16)));
        if let Some(own) = self.robots().get(robot) {
            let sets =
                [own.node_named(name).map(|n| BTreeSet::from([n as u16])), of_part(own, name), of_marker(own, name)];
            // A marker often has the name of the link that carries it: then the link is meant.
            found.extend(sets.into_iter().flatten().next().map(|nodes| RuleSide::Nodes(robot as u16, nodes)));
        }
        match (found.pop(), found.is_empty()) {
            (Some(one), true) => Ok(one),
            (Some(_), false) => {
                let what = format!("`{name}` is both an object or robot and a link, part or marker");
                Err(SceneError::PairRule { what, help: "give the object another name".to_owned() })
            }
            (None, _) => {
                let known = self.rule_names(robot);
                let known: Vec<&str> = known.iter().map(String::as_str).collect();
                let kinds = "link, part, marker or object";
                let what = format!("there is no {kinds} `{name}`");
                Err(SceneError::PairRule { what, help: suggestion(name, kinds, &known) })
            }
        }
    }

    /// All names that rules can use: objects first, since most rules name one.
    fn rule_names(&self, robot: usize) -> Vec<String> {
        let mut names: Vec<String> = self.objects().map(|(_, object)| object.name.clone()).collect();
        let others = self.robots().iter().enumerate().filter(|(r, _)| *r != robot);
        names.extend(others.map(|(_, other)| other.name.clone()));
        if let Some(own) = self.robots().get(robot) {
            names.extend(own.nodes.iter().filter_map(|n| n.name.as_deref().map(str::to_owned)));
            names.extend(own.parts.iter().map(|part| part.name.clone()));
            names.extend(own.markers.iter().map(|marker| marker.name.clone()));
        }
        let mut seen = BTreeSet::new();
        names.retain(|name| seen.insert(name.clone()));
        names
    }
}

/// The nodes of a part.
fn of_part(robot: &Robot, name: &str) -> Option<BTreeSet<u16>> {
    let part = robot.parts.iter().position(|part| part.name == name)?;
    Some(robot.nodes.iter().enumerate().filter(|(_, node)| node.part == part).map(|(n, _)| n as u16).collect())
}

/// The nodes of the rigid body that carries a marker.
fn of_marker(robot: &Robot, name: &str) -> Option<BTreeSet<u16>> {
    let marker = robot.markers.iter().find(|marker| marker.name == name)?;
    let body = robot.body(marker.node);
    Some((0..robot.nodes.len()).filter(|n| robot.body(*n) == body).map(|n| n as u16).collect())
}
