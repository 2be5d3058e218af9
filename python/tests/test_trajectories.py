"""Times along a plan: within the limits, and never beside the proved edges."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mobee

START = np.array([0.0, -1.2, 1.2, 0.0, 0.0, 0.0])
GOAL = np.array([1.5, -1.2, 1.2, 0.0, 0.0, 0.0])


@pytest.fixture()
def plan(ur5: mobee.Robot) -> mobee.Plan:
    world = mobee.World()
    world.add("post", mobee.Cylinder(0.05, 2.0), position=(0.5, 0.3, 0))
    plan = mobee.Scene(ur5, world, clearance=0.005).plan(START, GOAL)
    assert isinstance(plan, mobee.Plan) and len(plan.path) > 2
    return plan


def test_limits_hold_and_are_used(plan: mobee.Plan) -> None:
    limits: dict[str, Any] = {"velocity": [2.0, 2, 2, 3, 3, 3], "acceleration": 5.0, "jerk": 40.0}
    t = plan.time_parameterize(**limits, every=0.001)
    assert len(t) == len(t.times) == len(t.q) and t.q.shape == t.velocity.shape == t.acceleration.shape
    assert t.times[0] == 0 and t.times[-1] == t.duration and (np.diff(t.times) > 0).all()
    assert (abs(t.velocity) <= np.array(limits["velocity"]) + 1e-9).all()
    assert (abs(t.acceleration) <= 5 + 1e-9).all()
    dt = np.diff(t.times)[:, None]
    steady = dt[:, 0] > 1e-4
    assert (abs(np.diff(t.acceleration, axis=0) / dt)[steady] <= 40 * 1.001 + 1e-6).all()
    # the numbers belong together
    assert np.allclose((np.diff(t.q, axis=0) / dt)[steady], (t.velocity[:-1] + t.velocity[1:])[steady] / 2, atol=1e-4)
    # some limit of some joint is reached on every edge
    ratio = np.max(np.hstack([abs(t.velocity) / limits["velocity"], abs(t.acceleration) / 5]), axis=1)
    corners = [int(np.flatnonzero((t.q == q).all(axis=1))[0]) for q in plan.path]
    for a, b in zip(corners, corners[1:]):
        jerk = abs(np.diff(t.acceleration[a : b + 1], axis=0) / np.diff(t.times[a : b + 1])[:, None]).max() / 40
        assert max(ratio[a : b + 1].max(), jerk) > 0.99


def test_it_stays_on_the_edges_and_rests_at_corners(plan: mobee.Plan) -> None:
    t = plan.time_parameterize(velocity=1.0, acceleration=2.0, jerk=10.0)
    assert np.array_equal(t.q[0], plan.path[0]) and np.array_equal(t.q[-1], plan.path[-1])
    for q in plan.path:
        (at,) = np.flatnonzero((t.q == q).all(axis=1))
        assert (t.velocity[at] == 0).all() and (t.acceleration[at] == 0).all()
    for q in t.q:
        off = min(distance(q, a, b) for a, b in zip(plan.path, plan.path[1:]))
        assert off < 1e-12


def distance(q: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    share = np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return float(np.linalg.norm(q - a - share * (b - a)))


def test_a_single_edge_takes_as_long_as_theory_says(ur5: mobee.Robot) -> None:
    plan = mobee.Scene(ur5).plan(START, START + [1.0, 0.5, 0, 0, 0, 0])
    assert isinstance(plan, mobee.Plan) and len(plan.path) == 2
    v, a, j = 0.5, 2.0, 20.0
    t = plan.time_parameterize(velocity=v, acceleration=a, jerk=j)
    # seven segments: d / v + v / a + a / j
    assert t.duration == pytest.approx(1.0 / v + v / a + a / j, abs=1e-9)
    assert np.allclose(t.velocity[:, 1] * 2, t.velocity[:, 0]), "joints move in proportion"
    assert (np.diff(t.times) <= 0.01 + 1e-9).all()


@pytest.mark.parametrize(
    "limits",
    [
        {"velocity": 0.0},
        {"velocity": -1.0},
        {"velocity": np.nan},
        {"acceleration": np.inf},
        {"jerk": [1.0, 2.0]},
        {"jerk": "fast"},
        {"every": 0.0},
        {"every": 1e-6},
    ],
)
def test_limits_that_are_none_are_refused(plan: mobee.Plan, limits: dict[str, Any]) -> None:
    with pytest.raises(mobee.MobeeError):
        plan.time_parameterize(**{"velocity": 1.0, "acceleration": 1.0, "jerk": 0.001, **limits})


def test_limits_of_all_magnitudes(plan: mobee.Plan) -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        v, a, j = 10.0 ** rng.uniform(-2, 3, 3)
        t = plan.time_parameterize(velocity=v, acceleration=a, jerk=j, every=1.0)
        assert np.isfinite(t.q).all() and np.array_equal(t.q[-1], plan.path[-1]) and t.duration > 0
