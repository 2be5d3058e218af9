"""Roadmaps: verdicts of edges, paths over those that are proved free, files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mobee


@pytest.fixture(scope="module")
def scene(ur5: mobee.Robot) -> mobee.Scene:
    world = mobee.World()
    world.add("post", mobee.Cylinder(0.05, 2.0), position=(0.5, 0.3, 0))
    world.add("floor", mobee.Box((4, 4, 0.1)), position=(0, 0, -0.2))
    return mobee.Scene(ur5, world, clearance=0.005)


@pytest.fixture(scope="module")
def roadmap(ur5: mobee.Robot, scene: mobee.Scene) -> mobee.Roadmap:
    q = np.random.default_rng(2).uniform(ur5.lower / 2, ur5.upper / 2, (600, ur5.dof))
    return mobee.Roadmap(ur5, q[scene.free(q)], neighbors=6).validate(scene)


def test_its_verdicts_are_those_of_the_scene(roadmap: mobee.Roadmap, scene: mobee.Scene) -> None:
    assert roadmap.free is not None and roadmap.clearance == 0.005
    assert roadmap.edges.shape == (len(roadmap.free), 2) and len(roadmap) == len(roadmap.q)
    verdicts = scene.edge(roadmap.q[roadmap.edges[:, 0]], roadmap.q[roadmap.edges[:, 1]])
    assert np.array_equal(roadmap.free, [isinstance(v, mobee.Free) for v in verdicts])
    assert 0 < roadmap.free.sum() < len(roadmap.free)


def test_a_path_leads_over_proved_edges(roadmap: mobee.Roadmap, scene: mobee.Scene) -> None:
    found = [roadmap.path(0, goal) for goal in range(1, 40)]
    plans = [plan for plan in found if isinstance(plan, mobee.Plan)]
    assert plans, "the map is not a heap of islands"
    longest = max(plans, key=lambda plan: len(plan.path))
    assert len(longest.path) > 2 and np.array_equal(longest.path[0], roadmap.q[0])
    assert all(isinstance(v, mobee.Free) for v in scene.edge(longest.path[:-1], longest.path[1:]))
    timed = longest.time_parameterize(velocity=1.0, acceleration=2.0, jerk=20.0)
    assert timed.duration > 0


def test_improvement_joins_its_parts(roadmap: mobee.Roadmap, scene: mobee.Scene, ur5: mobee.Robot) -> None:
    sparse = mobee.Roadmap(ur5, roadmap.q[:30], neighbors=1).validate(scene)
    reached = sum(bool(sparse.path(0, goal)) for goal in range(len(sparse)))
    better = sparse.improve(scene, grow=20)
    assert len(better) > len(sparse) and better.free is not None
    assert np.allclose(better.q[:30], sparse.q, atol=1e-8)
    assert sum(bool(better.path(0, goal)) for goal in range(30)) > reached
    pruned = better.improve(scene, prune=True)
    assert all(pruned.path(0, goal) for goal in range(len(pruned)))
    again = sparse.improve(scene, grow=20)
    assert np.array_equal(again.q, better.q) and np.array_equal(again.edges, better.edges)


def test_a_map_outlives_its_file(roadmap: mobee.Roadmap, ur5: mobee.Robot, rail: mobee.Robot, tmp_path: Path) -> None:
    file = tmp_path / "map.json"
    roadmap.save(file)
    read = mobee.Roadmap.load(file, ur5)
    assert np.allclose(read.q, roadmap.q, atol=1e-8) and np.array_equal(read.edges, roadmap.edges)
    assert read.free is not None and roadmap.free is not None and np.array_equal(read.free, roadmap.free)
    with pytest.raises(mobee.MobeeError, match="exists already"):
        roadmap.save(file)
    with pytest.raises(mobee.MobeeError) as error:
        mobee.Roadmap.load(file, rail)
    assert error.value.code == "file" and str(file) in (error.value.place or "")
    file.write_text(file.read_text()[:-200])
    with pytest.raises(mobee.MobeeError) as error:
        mobee.Roadmap.load(file, ur5)
    assert error.value.code == "file"


def test_the_map_of_a_table_is_built(repository: Path) -> None:
    steps: list[tuple[str, float]] = []
    settings = repository / "configs/roadmaps/table.toml"
    roadmap = mobee.Roadmap.build(
        settings, set=["vertices=40", "spacing_mm=60"], progress=lambda *step: steps.append(step)
    )
    assert len(roadmap) == 40 and roadmap.free is None and len(roadmap.edges) > 40
    icub = mobee.load(repository / "configs/robots/icub.xml")
    table = mobee.World.load(repository / "configs/worlds/table.xml")
    scene = mobee.Scene(icub, table, clearance=0.012)
    assert scene.free(roadmap.q).all()
    valid = roadmap.validate(scene)
    assert valid.free is not None and valid.free.any()
    with pytest.raises(mobee.MobeeError) as error:
        mobee.Roadmap.build(settings, set=["vertices=0"])
    assert error.value.code == "config" and "vertices" in error.value.message


def test_what_is_no_vertex_and_what_has_no_verdicts(roadmap: mobee.Roadmap, ur5: mobee.Robot, rail: mobee.Robot) -> None:
    with pytest.raises(mobee.MobeeError, match='no vertex "9999"'):
        roadmap.path(0, 9999)
    fresh = mobee.Roadmap(ur5, roadmap.q[:5])
    with pytest.raises(mobee.MobeeError, match="no verdicts"):
        fresh.path(0, 1)
    with pytest.raises(mobee.MobeeError) as error:
        fresh.validate(mobee.Scene(rail))
    assert error.value.code == "robots"
    assert fresh.nearest(roadmap.q[3])[0] == 3 and sorted(fresh.nearest(roadmap.q[3])) == list(range(5))
    with pytest.raises(mobee.MobeeError, match="neighbors is 0"):
        mobee.Roadmap(ur5, roadmap.q[:5], neighbors=0)


def test_some_joints_of_a_robot(ur5: mobee.Robot) -> None:
    scene = mobee.Scene(ur5)
    q = np.tile(ur5.home, (4, 1))
    q[:, 0] = ur5.home[0] + np.linspace(0, 0.5, 4)
    roadmap = mobee.Roadmap(ur5, q, joints=[ur5.joint_names[0]], neighbors=2).validate(scene)
    plan = roadmap.path(0, 3)
    assert isinstance(plan, mobee.Plan) and np.allclose(plan.path[-1], q[-1])
