"""Plans: every edge is certified, and what can't be planned has a reason."""

from __future__ import annotations

import numpy as np
import pytest

import mobee


@pytest.fixture()
def scene(ur5: mobee.Robot) -> mobee.Scene:
    world = mobee.World()
    world.add("post", mobee.Cylinder(0.05, 2.0), position=(0.5, 0.3, 0))
    return mobee.Scene(ur5, world, clearance=0.005)


START = np.array([0.0, -1.2, 1.2, 0.0, 0.0, 0.0])
GOAL = np.array([1.5, -1.2, 1.2, 0.0, 0.0, 0.0])
# what is near the flange
PARTS = ["wrist_1_link", "wrist_2_link", "wrist_3_link", "ee_link"]


def test_every_edge_of_a_plan_is_certified(scene: mobee.Scene) -> None:
    assert isinstance(scene.edge(START, GOAL), mobee.Blocked), "the post is in the way"
    plan = scene.plan(START, GOAL)
    assert isinstance(plan, mobee.Plan) and plan
    assert np.allclose(plan.path[0], START) and np.allclose(plan.path[-1], GOAL)
    assert all(isinstance(v, mobee.Free) for v in scene.edge(plan.path[:-1], plan.path[1:]))
    assert plan.length == pytest.approx(np.linalg.norm(np.diff(plan.path, axis=0), axis=1).sum())
    again = scene.plan(START, GOAL)
    assert isinstance(again, mobee.Plan) and np.array_equal(again.path, plan.path), "equal seeds, equal paths"
    longer = scene.plan(START, GOAL, shorten=False)
    assert isinstance(longer, mobee.Plan) and longer.length >= plan.length


def test_the_nearest_goal_that_can_be_reached_is_taken(scene: mobee.Scene, ur5: mobee.Robot) -> None:
    beyond_the_post = GOAL.copy()
    nearer = START - 0.1
    assert scene.free(nearer)
    plan = scene.plan(START, np.stack([beyond_the_post, nearer]))
    assert isinstance(plan, mobee.Plan) and plan.goal == 1
    # a pose of a frame: the goals are what inverse kinematics finds
    goals = [solution.q for solution in ur5.ik(ur5.fk(GOAL, "ee_link"), "ee_link", seed=START, scene=scene)]
    plan = scene.plan(START, goals)
    assert isinstance(plan, mobee.Plan)
    assert np.allclose(ur5.fk(plan.path[-1], "ee_link"), ur5.fk(GOAL, "ee_link"), atol=2e-3)


def test_a_pick_may_touch_what_it_picks_and_nothing_else(ur5: mobee.Robot) -> None:
    world = mobee.World()
    world.add("post", mobee.Cylinder(0.05, 2.0), position=(0.5, 0.3, 0))
    at_goal = ur5.fk(GOAL, "ee_link")[:3, 3]
    world.add("cup", mobee.Sphere(0.03), position=at_goal)
    scene = mobee.Scene(ur5, world, clearance=0.005)
    refused = scene.plan(START, GOAL)
    assert isinstance(refused, mobee.NoPlan) and refused.code == "blocked" and "cup" in refused.reason
    pick = scene.plan(START, GOAL, may_touch=[f"{part}:cup" for part in PARTS])
    assert isinstance(pick, mobee.Plan)
    assert len(pick.path) > 2, "the post is in the way as before"
    assert isinstance(scene.plan(START, GOAL, pair_clearances={f"{part}:cup": 0.0 for part in PARTS}), mobee.NoPlan)
    with pytest.raises(mobee.MobeeError) as caught:
        scene.plan(START, GOAL, may_touch=[f"{PARTS[0]}:cap"])
    assert caught.value.code == "pair" and "cup" in caught.value.remedy
    with pytest.raises(mobee.MobeeError):
        scene.plan(START, GOAL, may_touch=["cup"])


def test_what_cannot_be_planned_has_a_reason(scene: mobee.Scene, ur5: mobee.Robot) -> None:
    folded = ur5.home.copy()
    folded[2] = 3.1
    assert not scene.free(folded)
    blocked = scene.plan(START, folded)
    assert isinstance(blocked, mobee.NoPlan) and not blocked
    assert blocked.code == "blocked" and "too near" in blocked.reason
    exhausted = scene.plan(START, GOAL, budget=5)
    assert isinstance(exhausted, mobee.NoPlan) and exhausted.code == "exhausted"
    late = scene.plan(START, GOAL, time_limit=1e-9)
    assert isinstance(late, mobee.NoPlan) and late.code == "exhausted" and "time limit" in late.reason
    in_time = scene.plan(START, GOAL, time_limit=60.0)
    assert (in_time.path == scene.plan(START, GOAL).path).all()
    for wrong in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(mobee.MobeeError) as caught:
            scene.plan(START, GOAL, time_limit=wrong)
        assert caught.value.place == "time_limit"
    with pytest.raises(mobee.MobeeError):
        scene.plan(np.stack([START, START]), GOAL)


def test_one_robot_moves_and_the_others_stand(ur5: mobee.Robot, rail: mobee.Robot) -> None:
    base = np.eye(4)
    base[:3, 3] = (0.8, 0.8, 0)
    both = mobee.Scene([ur5, rail], bases=[np.eye(4), base])
    start = np.concatenate([START, rail.home])
    plan = both.plan(start, np.concatenate([GOAL, rail.home]))
    assert isinstance(plan, mobee.Plan) and (plan.path[:, 6:] == rail.home).all()
    moved = rail.home.copy()
    moved[1] += 0.2
    with pytest.raises(mobee.MobeeError) as caught:
        both.plan(start, np.concatenate([GOAL, moved]))
    assert caught.value.code == "robots"
