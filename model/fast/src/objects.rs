//! Objects in a program of robots: each adds a solid per shape, and units of its own. A change of one object replaces
//! only these.

use crate::bound::REFERENCE;
use crate::kernel::Block;
use crate::lanes::WIDTH;
use crate::levers::far;
use crate::program::{Code, Program, Relative, Step, UnitKey, UnitTest};
use crate::robots::{PartGroup, RATED_POSES, RobotProgram, RobotUnit};
use crate::solids::{PairSide, Sized, pair_test};
use crate::steps::{BoundSizes, Unit, score};
use mobee_model::{Object, ObjectClass, Scene, Shape};
use nalgebra::Vector3;
use std::cmp::Reverse;
use std::ops::Range;
use std::sync::Arc;

/// Number of shapes of a group from which an elongated object is first compared with the group's ball.
const MIN_SHAPES_FOR_BALLS: usize = 3;
/// Number of unused pairs, relative to the used ones, with which a program is compiled again.
const MAX_UNUSED: usize = 2;

/// The objects of a program.
#[derive(Clone, Debug, Default)]
pub(crate) struct Objects {
    /// One per shape, in order of object and shape.
    slots: Vec<ObjectSlot>,
    /// Unused solids.
    free: Vec<usize>,
}

/// A shape of an object in a program.
#[derive(Clone, Debug)]
struct ObjectSlot {
    id: (u32, u16),
    object: Arc<Object>,
    /// Its solid in the program.
    solid: usize,
    /// Room for its pairs and steps.
    pairs: Range<usize>,
    steps: Range<usize>,
    /// Number of its pairs that are to be checked, and of those that are in the program.
    selected: usize,
    kept: usize,
    /// Maximum distance of its points from the world's origin, meters.
    far: f64,
}

/// A unit with its motion and place in the order.
type OrderedUnit = (UnitKey, UnitTest, Relative);

impl Objects {
    /// Numbers of pairs to check, and of those that are in the program.
    pub fn pairs(&self) -> (usize, usize) {
        self.slots.iter().fold((0, 0), |(all, kept), slot| (all + slot.selected, kept + slot.kept))
    }

    /// Updates the objects of a program to those of a scene of the same robots.
    ///
    /// # Arguments
    /// * `block`: gets the new objects placed.
    /// * `select`: true for a pair that is checked; called for changed objects.
    ///
    /// # Returns
    /// False if the program can't be updated and must be compiled again; then it is unusable.
    pub fn update(
        &mut self,
        robots: &RobotProgram,
        program: &mut Program,
        block: &mut Block,
        scene: &Scene,
        select: &impl Fn(u32, u32) -> bool,
    ) -> bool {
        let mut old = std::mem::take(&mut self.slots).into_iter().peekable();
        let mut replaced = Vec::new();
        let mut units = Vec::new();
        let mut marked = vec![false; program.robot_solids];
        let colliders = scene.robot_colliders() as u32..;
        for (collider, (id, object, s)) in colliders.zip(shapes(scene)) {
            while let Some(slot) = old.next_if(|slot| slot.id < (id, s)) {
                replaced.push(slot.id);
                self.free.push(slot.solid);
            }
            let known = old.next_if(|slot| slot.id == (id, s));
            let mut slot = match known {
                Some(slot) if Arc::ptr_eq(&slot.object, object) => {
                    program.colliders[slot.solid] = collider;
                    self.slots.push(slot);
                    continue;
                }
                Some(slot) => {
                    replaced.push(slot.id);
                    ObjectSlot { object: object.clone(), ..slot }
                }
                None => ObjectSlot {
                    id: (id, s),
                    object: object.clone(),
                    solid: self.solid(robots, program),
                    pairs: 0..0,
                    steps: 0..0,
                    selected: 0,
                    kept: 0,
                    far: 0.0,
                },
            };
            program.colliders[slot.solid] = collider;
            let writer = ObjectWriter::new(robots, program, scene, (&slot, collider), select, &mut marked);
            let Some(writer) = writer else { return false };
            units.extend(writer.write(&mut slot));
            self.slots.push(slot);
        }
        for slot in old {
            replaced.push(slot.id);
            self.free.push(slot.solid);
        }
        merge(program, &replaced, units);
        let far = self.slots.iter().map(|slot| slot.far).fold(0.0, f64::max);
        robots.complete(program, far);
        block.resize(program);
        self.slots.iter().for_each(|slot| block.place_object(program, slot.solid));
        let used: usize = self.slots.iter().map(|slot| slot.kept).sum();
        program.objects.pairs.len() <= MAX_UNUSED * used + 4096
    }

    /// A solid for a shape: an unused one, or a new one.
    fn solid(&mut self, robots: &RobotProgram, program: &mut Program) -> usize {
        self.free.pop().unwrap_or_else(|| {
            let solid = Sized::of_object(&Shape::Sphere { radius: 0.0 }, &Default::default(), robots.world);
            program.solids.push(solid.placed(program.axes));
            program.axes += 3;
            // Nothing rotates an object.
            program.extents.push(0.0);
            program.colliders.push(0);
            program.solids.len() - 1
        })
    }
}

/// The shapes of a scene's obstacles, in order of its colliders.
fn shapes(scene: &Scene) -> impl Iterator<Item = (u32, &Arc<Object>, u16)> {
    let obstacles = scene.objects().filter(|(_, object)| object.class == ObjectClass::Obstacle);
    obstacles.flat_map(|(id, object)| (0..object.shapes.len() as u16).map(move |s| (id, object, s)))
}

/// Replaces the units of some shapes by others, in order.
fn merge(program: &mut Program, replaced: &[(u32, u16)], mut new: Vec<OrderedUnit>) {
    if replaced.is_empty() && new.is_empty() {
        return;
    }
    new.sort_unstable_by_key(|(key, ..)| *key);
    let is_kept = |key: &UnitKey| key.object.is_none_or(|object| !replaced.contains(&object));
    let count = program.units.len() + new.len();
    let units = std::mem::replace(&mut program.units, Vec::with_capacity(count));
    let motions = std::mem::replace(&mut program.unit_motions, Vec::with_capacity(count));
    let keys = std::mem::replace(&mut program.unit_keys, Vec::with_capacity(count));
    let kept = keys.into_iter().zip(units).zip(motions).filter(|((key, _), _)| is_kept(key));
    let mut new = new.into_iter().peekable();
    let mut add = |(key, unit, motion): OrderedUnit| {
        program.unit_keys.push(key);
        program.units.push(unit);
        program.unit_motions.push(motion);
    };
    for ((key, unit), motion) in kept {
        while let Some(earlier) = new.next_if(|(new, ..)| *new < key) {
            add(earlier);
        }
        add((key, unit, motion));
    }
    new.for_each(add);
}

/// Writes the code of one shape of an object.
struct ObjectWriter<'a> {
    robots: &'a RobotProgram,
    code: &'a mut Code,
    scene: &'a Scene,
    collider: u32,
    /// The robots' colliders.
    colliders: &'a [u32],
    /// Number of balls: solids are numbered after them.
    balls: usize,
    solid: usize,
    shape: Sized,
    side: PairSide,
    size: BoundSizes,
    /// Per solid of the robots: true if it may meet the shape.
    marked: &'a mut [bool],
    selected: usize,
}

impl<'a> ObjectWriter<'a> {
    /// Places the shape and marks the solids that it may meet; `None` if one is not in the program.
    fn new(
        robots: &'a RobotProgram,
        program: &'a mut Program,
        scene: &'a Scene,
        (slot, collider): (&ObjectSlot, u32),
        select: &impl Fn(u32, u32) -> bool,
        marked: &'a mut [bool],
    ) -> Option<Self> {
        let primitive = slot.object.shapes.get(usize::from(slot.id.1))?;
        let shape = Sized::of_object(&primitive.shape, &(slot.object.pose * primitive.pose), robots.world);
        let first_axis = program.solids[slot.solid].first_axis;
        program.solids[slot.solid] = shape.placed(first_axis);
        marked.fill(false);
        let ball = shape.ball();
        let distance = robots.layout.clearance() + REFERENCE;
        let mut selected = 0;
        for a in scene.tested_against(collider).iter().filter(|a| select(**a, collider)) {
            let own = robots.place.get(*a as usize).copied().flatten()?;
            let swept = &robots.swept[own];
            let reach = swept.radius + ball.radius + distance;
            marked[own] = (swept.center - ball.center).norm_squared() <= reach * reach;
            selected += 1;
        }
        Some(ObjectWriter {
            robots,
            colliders: &program.colliders,
            balls: program.balls.len(),
            code: &mut program.objects,
            scene,
            collider,
            solid: slot.solid,
            side: shape.side(),
            size: shape.size(),
            shape,
            marked,
            selected,
        })
    }

    /// Writes all units, into the slot's room if it is sufficient.
    fn write(mut self, slot: &mut ObjectSlot) -> Vec<OrderedUnit> {
        let (first_pair, first_step) = (self.code.pairs.len(), self.code.steps.len());
        let mut units = Vec::new();
        for (number, unit) in (0..).zip(&self.robots.units) {
            let (pairs, steps) = (self.code.pairs.len(), self.code.steps.len());
            self.unit(unit);
            let count = self.code.pairs.len() - pairs;
            if count == 0 {
                self.truncate(pairs, steps);
                continue;
            }
            let key = UnitKey { score: self.score(unit, count), object: Some(slot.id), number };
            let within_squared = self.robots.layout.near_squared(unit.ball, (self.size.ball, self.size.error));
            let b = self.balls + self.solid;
            let steps = steps..self.code.steps.len();
            let test = UnitTest { a: unit.ball, b, within_squared, is_object: true, steps };
            units.push((key, test, self.robots.in_world[unit.ball]));
        }
        (slot.selected, slot.kept) = (self.selected, self.code.pairs.len() - first_pair);
        slot.far = far(&self.shape.ends());
        let written = (first_pair..self.code.pairs.len(), first_step..self.code.steps.len());
        if written.0.len() <= slot.pairs.len() && written.1.len() <= slot.steps.len() {
            self.move_down(written, slot, &mut units);
        } else {
            (slot.pairs, slot.steps) = written;
        }
        units
    }

    /// Moves what was written last to the slot's room.
    fn move_down(
        &mut self,
        (pairs, steps): (Range<usize>, Range<usize>),
        slot: &ObjectSlot,
        units: &mut [OrderedUnit],
    ) {
        let (by_pairs, by_steps) = (pairs.start - slot.pairs.start, steps.start - slot.steps.start);
        for step in &mut self.code.steps[steps.clone()] {
            match step {
                Step::Pair(pair) => *pair -= by_pairs,
                Step::Near { skip, .. } | Step::Beside { skip, .. } => *skip -= by_steps as u32,
                Step::Region(_) | Step::Group(_) => {}
            }
        }
        for (i, pair) in pairs.clone().enumerate() {
            self.code.pairs.swap(slot.pairs.start + i, pair);
        }
        self.code.steps.copy_within(steps.clone(), slot.steps.start);
        self.code.motions.copy_within(steps.clone(), slot.steps.start);
        self.truncate(pairs.start, steps.start);
        for (_, unit, _) in units {
            unit.steps = unit.steps.start - by_steps..unit.steps.end - by_steps;
        }
    }

    fn truncate(&mut self, pairs: usize, steps: usize) {
        self.code.pairs.truncate(pairs);
        self.code.steps.truncate(steps);
        self.code.motions.truncate(steps);
    }

    /// Writes a unit: from the coarsest test to pairs of shapes. Its ball is already near that of the object.
    fn unit(&mut self, unit: &RobotUnit) {
        let may_meet = |w: &Self, group: &PartGroup| group.solids.iter().any(|s| w.marked[*s]);
        if let (Unit::Group(_), Some(group)) = (unit.unit, unit.parts.first().and_then(|part| part.groups.first())) {
            if may_meet(self, group) {
                self.group(group);
            }
            return;
        }
        self.beside(unit.ball, |w| {
            for part in &unit.parts {
                let groups: Vec<&PartGroup> = part.groups.iter().filter(|group| may_meet(w, group)).collect();
                if groups.is_empty() {
                    continue;
                }
                w.beside(part.ball, |w| {
                    for group in groups {
                        if let Some(branch) = group.branch {
                            w.push(Step::Region(branch + 1), Relative::default());
                        }
                        if group.group == part.ball {
                            w.pairs(group);
                        } else {
                            w.beside(group.group, |w| w.pairs(group));
                        }
                    }
                });
            }
        });
    }

    /// Writes a group that is a unit. The ball around a board contains much that is not near the board, so the group's
    /// ball is compared with the board itself; and likewise an object's ball with a board that is alone in its group.
    fn group(&mut self, group: &PartGroup) {
        let alone = group.solids.first().filter(|_| group.solids.len() == 1);
        let is_elongated = !self.shape.is_ball() && group.solids.len() >= MIN_SHAPES_FOR_BALLS;
        if self.shape.is_box() || is_elongated {
            self.beside(group.group, |w| w.pairs(group));
        } else if let Some(board) = alone.filter(|board| self.robots.layout.solids[**board].turn.is_some()) {
            let robots = self.robots;
            let size = &robots.layout.solids[*board];
            let within_squared = robots.layout.beside_squared((self.size.ball, self.size.error), size);
            let (ball, of) = ((self.balls + self.solid) as u32, *board as u32);
            let step = Step::Beside { ball, of, half: size.half as f32, within_squared, skip: 0 };
            self.push(Step::Group(group.group), Relative::default());
            self.within(step, robots.in_world[self.balls + board], |w| w.pairs(group));
        } else {
            self.pairs(group);
        }
    }

    /// Writes a test of a ball beside the object, and the steps to execute if it is positive in any lane.
    fn beside(&mut self, ball: usize, steps: impl FnOnce(&mut Self)) {
        let layout = &self.robots.layout;
        let within_squared = layout.beside_squared(layout.ball(ball), &self.size);
        let half = self.size.half as f32;
        let step = Step::Beside { ball: ball as u32, of: self.solid as u32, half, within_squared, skip: 0 };
        self.within(step, self.robots.in_world[ball], steps);
    }

    fn within(&mut self, test: Step, motion: Relative, steps: impl FnOnce(&mut Self)) {
        let first = self.code.steps.len();
        self.push(test, motion);
        steps(self);
        let end = self.code.steps.len() as u32;
        if let Some(Step::Near { skip, .. } | Step::Beside { skip, .. }) = self.code.steps.get_mut(first) {
            *skip = end;
        }
    }

    fn push(&mut self, step: Step, motion: Relative) {
        self.code.steps.push(step);
        self.code.motions.push(motion);
    }

    /// Writes the pairs of a group.
    fn pairs(&mut self, group: &PartGroup) {
        self.push(Step::Group(group.group), Relative::default());
        let clearance = self.robots.layout.clearance();
        for solid in group.solids.iter().filter(|s| self.marked[**s]) {
            let clearance = self.scene.pair_clearance((self.colliders[*solid], self.collider), clearance);
            let pair = pair_test((*solid, &self.robots.sides[*solid]), (self.solid, &self.side), clearance);
            self.code.steps.push(Step::Pair(self.code.pairs.len()));
            self.code.motions.push(self.robots.in_world[self.balls + solid]);
            self.code.pairs.push(pair);
        }
    }

    /// Estimate of the decisiveness of a unit: the nearer its ball to the object, the more lanes it decides.
    fn score(&self, unit: &RobotUnit, pairs: usize) -> Reverse<u32> {
        let (radius, _) = self.robots.layout.ball(unit.ball);
        let inverse = self.shape.pose.rotation.inverse().to_rotation_matrix();
        let rows: [[f32; 3]; 3] = std::array::from_fn(|i| {
            let row: Vector3<f64> = inverse.matrix().row(i).transpose();
            row.map(|x| x as f32).into()
        });
        let center: [f32; 3] = self.shape.pose.translation.vector.map(|x| x as f32).into();
        let (half, round): ([f32; 3], f32) = match self.shape.shape {
            Shape::Box { size } => ((size / 2.0).map(|x| x as f32).into(), 0.0),
            _ => ([0.0, self.size.half as f32, 0.0], self.size.radius as f32),
        };
        let reach = 1.0 / (radius as f32).max(1e-6);
        let mut sum = [0.0_f32; WIDTH];
        for [x, y, z] in &unit.samples {
            let mut squared = [0.0_f32; WIDTH];
            for (row, half) in rows.iter().zip(half) {
                for lane in 0..WIDTH {
                    let way = [x.0[lane] - center[0], y.0[lane] - center[1], z.0[lane] - center[2]];
                    let along = row[0] * way[0] + row[1] * way[1] + row[2] * way[2];
                    let over = (along.abs() - half).max(0.0);
                    squared[lane] += over * over;
                }
            }
            for lane in 0..WIDTH {
                let distance = (squared[lane].sqrt() - round).max(0.0);
                sum[lane] += (1.0 - distance * reach).max(0.0);
            }
        }
        score((sum.iter().sum::<f32>() * RATED_POSES) as u32, pairs)
    }
}
