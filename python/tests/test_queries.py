"""Queries: verdicts are the Rust engine's, and agree with each other."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import mobee


def random(robot: mobee.Robot, count: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(robot.lower, robot.upper, (count, robot.dof))


def test_verdicts_and_distances_are_those_of_the_rust_engine(ur5: mobee.Robot) -> None:
    # written and checked by tests/pure.rs
    with open(Path(__file__).parent / "ur5_verdicts.csv") as file:
        rows = [[float(x) for x in row] for row in csv.reader(file)]
    table = np.array(rows)
    q, free, distance = table[:, :6], table[:, 6], table[:, 7]
    scene = mobee.Scene(ur5)
    assert 0 < free.sum() < len(free)
    assert np.array_equal(scene.free(q), free == 1)
    assert np.abs(scene.distance(q) - distance).max() < 1e-9
    assert [scene.free(row) for row in q] == [x == 1 for x in free]
    assert [len(c) > 0 for c in scene.contacts(q)] == [x == 0 for x in free]


def test_queries_agree(ur5: mobee.Robot) -> None:
    world = mobee.World()
    world.add("ball", mobee.Sphere(0.15), position=(0.4, 0.2, 0.5))
    scene = mobee.Scene(ur5, world, clearance=0.01)
    q = random(ur5, 2000)
    free, distance, contacts = scene.free(q), scene.distance(q), scene.contacts(q)
    assert np.array_equal(free, distance > 0.01)
    for i in range(len(q)):
        assert free[i] == (not contacts[i])
        if contacts[i]:
            nearest = min(contacts[i], key=lambda c: c.distance)
            assert nearest.distance == pytest.approx(distance[i], abs=1e-9)
            assert nearest.points.shape == (2, 3)
            apart = np.linalg.norm(nearest.points[0] - nearest.points[1])
            assert apart == pytest.approx(abs(nearest.distance), abs=1e-6)
    assert any(c.b == "ball#0" for found in contacts for c in found)
    assert isinstance(scene.free(q[0]), bool) and isinstance(scene.distance(q[0]), float)


def test_an_edge_is_proved_or_blocked_where_it_says(ur5: mobee.Robot) -> None:
    scene = mobee.Scene(ur5)
    free = random(ur5, 400)
    free = free[scene.free(free)]
    q0, q1 = free[:100], free[100:200]
    verdicts = scene.edge(q0, q1)
    assert {type(v) for v in verdicts} >= {mobee.Free, mobee.Blocked}
    steps = np.linspace(0, 1, 500)[:, None]
    for a, b, verdict in zip(q0, q1, verdicts):
        line = a + steps * (b - a)
        if verdict:
            assert scene.free(line).all()
        elif isinstance(verdict, mobee.Blocked):
            at = a + verdict.at * (b - a)
            assert not scene.free(at)
            assert verdict.by is not None and any({c.a, c.b} == set(verdict.by) for c in scene.contacts(at))
    assert repr(scene.edge(q0[0], q1[0])) == repr(verdicts[0])
    assert [repr(v) for v in scene.edge(q0[0], q1)] == [repr(scene.edge(q0[0], b)) for b in q1]


def test_what_is_beyond_a_limit_is_not_free_and_has_no_distance(ur5: mobee.Robot) -> None:
    scene = mobee.Scene(ur5)
    beyond = ur5.home.copy()
    beyond[5] = ur5.upper[5] + 0.01
    assert scene.free(ur5.home) and not scene.free(beyond)
    assert scene.free(np.stack([ur5.home, beyond])).tolist() == [True, False]
    edge = scene.edge(ur5.home, beyond)
    assert isinstance(edge, mobee.Blocked) and edge.by is None and 0.99 < edge.at < 1
    for query in (scene.distance, scene.contacts, lambda q: ur5.fk(q, "tool0")):
        with pytest.raises(mobee.MobeeError) as caught:
            query(np.stack([ur5.home, beyond]))
        assert (caught.value.code, caught.value.place) == ("limits", "q[1]")
        assert "wrist_3_joint" in caught.value.message
    # rounding is no violation
    assert scene.free(ur5.upper * (1 + 1e-13)) == scene.free(ur5.upper)


def test_shapes_stand_where_they_are_put(ur5: mobee.Robot) -> None:
    tip = ur5.fk(ur5.home, "ee_link")[:3, 3]
    for shape, size in [
        (mobee.Box((0.1, 0.2, 0.3)), (0.05, 0.1, 0.15)),
        (mobee.Cylinder(0.05, 0.3), (0.05, 0.05, 0.15)),
        (mobee.Capsule(0.05, 0.2), (0.05, 0.05, 0.15)),
        (mobee.Sphere(0.1), (0.1, 0.1, 0.1)),
    ]:
        for axis in range(3):
            world = mobee.World()
            pose = np.eye(4)
            pose[:3, 3] = tip
            pose[axis, 3] += size[axis] + 0.1
            world.add("it", shape, pose)
            near = [c for c in mobee.Scene(ur5, world).contacts(ur5.home, within=0.2) if c.b == "it#0"]
            assert near
            # the nearest point of the shape lies on its boundary
            local = near[0].points[1] - pose[:3, 3]
            assert (np.abs(local) <= np.asarray(size) + 1e-6).all(), (shape, axis)


def test_a_mesh_and_a_hull_are_enclosed(ur5: mobee.Robot) -> None:
    corners = np.array([[x, y, z] for x in (0, 0.1) for y in (0, 0.2) for z in (0, 0.3)])
    triangles = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    mesh, hull = mobee.Mesh(corners, triangles), mobee.Hull(corners)
    assert mesh.overshoot <= 0.01 and hull.overshoot <= 0.01
    with pytest.raises(mobee.MobeeError):
        mobee.Mesh(corners, [[0, 1, 8]])
    for shape in (mesh, hull):
        world = mobee.World()
        world.add("it", shape, position=(0.5, 0.5, 0.5))
        assert mobee.Scene(ur5, world).contacts(ur5.home, within=2.0)


def test_a_scene_is_a_snapshot_of_the_world(ur5: mobee.Robot) -> None:
    world = mobee.World()
    world.add("wall", mobee.Box((0.02, 4, 4)), position=(0.3, 0, 0))
    before = mobee.Scene(ur5, world)
    assert not before.free(ur5.home)
    world.move("wall", position=(3, 0, 0), quat_wxyz=(1, 0, 0, 0))
    assert mobee.Scene(ur5, world).free(ur5.home) and not before.free(ur5.home)
    world.remove("wall")
    assert len(world) == 0 and "wall" not in world
    with pytest.raises(mobee.MobeeError, match="no object named `wall`"):
        world.move("wall")
    world.add("a", mobee.Sphere(1.0))
    with pytest.raises(mobee.MobeeError, match="two objects named `a`"):
        world.add("a", mobee.Sphere(1.0))


def test_two_robots_share_a_configuration(ur5: mobee.Robot, rail: mobee.Robot) -> None:
    far, near = np.eye(4), np.eye(4)
    far[0, 3] = 5.0
    near[0, 3] = 0.3
    q = np.concatenate([ur5.home, rail.home])
    apart = mobee.Scene([ur5, rail], bases=[np.eye(4), far])
    assert apart.dof == 10 and apart.joint_names[6] == "rail_arm:slide"
    assert apart.free(q)
    together = mobee.Scene([ur5, rail], bases=[np.eye(4), near])
    found = together.contacts(q)
    assert found and found[0].a.startswith("ur5:") and found[0].b.startswith("rail_arm:")
    with pytest.raises(mobee.MobeeError, match="two robots named `ur5`"):
        mobee.Scene([ur5, ur5])
