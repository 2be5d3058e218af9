"""Pictures: what is drawn is where the collision model has it."""

from __future__ import annotations

import gc
import socket
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mobee
from mobee._native import shape_poses, shapes_of

rerun = pytest.importorskip("rerun", reason="rerun-sdk is not installed: pip install 'mobee[show]'")


@pytest.fixture(scope="module")
def scene(rail: mobee.Robot) -> mobee.Scene:
    world = mobee.World()
    tilted = {"quat_xyzw": (0.2, 0.4, 0.1, 0.8888194417315589)}
    world.add("box", mobee.Box((0.1, 0.2, 0.3)), position=(0.3, 0.2, 0.4), **tilted)
    world.add("ball", mobee.Sphere(0.1), position=(0.9, 0.05, 0.7))
    world.add("can", mobee.Cylinder(radius=0.08, length=0.3), position=(0.3, -0.3, 0.3), **tilted)
    world.add("pill", mobee.Capsule(radius=0.05, length=0.3), position=(-0.3, -0.2, 0.6), **tilted)
    return mobee.Scene(rail, world, clearance=0.01)


def some(scene: mobee.Scene, count: int) -> Any:
    (robot,) = scene.robots
    return np.random.default_rng(1).uniform(robot.lower, robot.upper, (count, scene.dof))


def depth(kind: str, sizes: Any, point: Any) -> float:
    """Depth of a point within a shape, m."""
    x, y, z = np.abs(point)
    if kind == "box":
        return float(np.min(np.array(sizes) - np.abs(point)))
    radius, length, _ = sizes
    if kind == "cylinder":
        return float(min(radius - np.hypot(x, y), length / 2 - z))
    return float(radius - np.linalg.norm([x, y, max(z - length / 2, 0.0)]))


def test_contact_points_are_on_the_surfaces_of_the_drawn_shapes(scene: mobee.Scene) -> None:
    q = some(scene, 50)
    poses, shapes = shape_poses(scene, q), shapes_of(scene)
    assert poses.shape == (50, len(shapes), 7) and np.allclose(np.linalg.norm(poses[..., 3:], axis=-1), 1.0)
    assert np.array_equal(shape_poses(scene, q[7])[0], poses[7])
    names = [name for name, _, _ in shapes]
    assert len(set(names)) == len(names)
    seen = set()
    for row, found in zip(poses, scene.contacts(q, within=0.5), strict=True):
        for contact in found:
            # overlapping shapes have deepest points instead, and a hull's surface is within its shape
            for name, point in zip((contact.a, contact.b), contact.points, strict=True):
                i = names.index(name)
                if contact.distance <= 0.01 or ":" in name:
                    continue
                x, y, z, w = row[i, 3:]
                rotation = np.array(
                    [
                        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
                    ]
                )
                assert abs(depth(shapes[i][1], shapes[i][2], rotation.T @ (point - row[i, :3]))) < 2e-3, (name, contact)
                seen.add(name)
    assert seen == {"box#0", "ball#0", "can#0", "pill#0"}


def chunks(file: Path) -> dict[str, list[Any]]:
    from rerun.experimental import RrdReader

    found: dict[str, list[Any]] = {}
    for chunk in RrdReader(file).stream():
        found.setdefault(chunk.entity_path, []).append(chunk)
    return found


@pytest.mark.filterwarnings("ignore:RRD file has no footer")
def test_a_file_has_the_shapes_the_path_and_the_contacts(scene: mobee.Scene, tmp_path: Path) -> None:
    q = some(scene, 400)
    touching, free = q[~np.asarray(scene.free(q))][:3], q[np.asarray(scene.free(q))]
    recording = scene.show(touching, to=tmp_path / "rows.rrd")
    assert isinstance(recording, rerun.RecordingStream)
    del recording
    gc.collect()
    found = chunks(tmp_path / "rows.rrd")
    assert {"/world/box/0", "/world/ball/0", "/world/can/0", "/world/pill/0", "/world/contacts"} <= found.keys()
    assert len([path for path in found if path.startswith("/world/rail")]) == sum(":" in name for name, _, _ in shapes_of(scene))
    assert sum(chunk.num_rows for chunk in found["/world/contacts"]) == 3 and "row" in found["/world/contacts"][0].timeline_names

    plan = scene.plan(free[0], free[1])
    assert plan
    for i, path in enumerate((plan, plan.path)):
        del path
        scene.show(path=(plan, plan.path)[i], to=str(tmp_path / f"path-{i}.rrd"))
        gc.collect()
        found = chunks(tmp_path / f"path-{i}.rrd")
        assert "/world/trace" in found
        moving = [chunk for of in found.values() for chunk in of if "time" in chunk.timeline_names]
        pictures = 1 + sum(int(np.ceil(np.abs(edge).max() / 0.02)) for edge in np.diff(plan.path, axis=0))
        assert max(chunk.num_rows for chunk in moving) == pictures
    # a recording of one's own
    own = rerun.RecordingStream("own")
    own.save(tmp_path / "own.rrd")
    assert scene.show(to=own) is own
    del own
    gc.collect()
    assert "/world/box/0" in chunks(tmp_path / "own.rrd")


@pytest.mark.parametrize(
    ("arguments", "code", "place"),
    [
        ({"q": np.zeros(4), "path": np.zeros((2, 4))}, "twice", "path"),
        ({"q": np.zeros(5)}, "shape", "q"),
        ({"q": np.zeros((0, 4))}, "shape", "q"),
        ({"q": np.ma.masked_array(np.zeros(4), mask=[1, 0, 0, 0])}, "dtype", "q"),
        ({"q": np.full(4, np.nan)}, "not_finite", "q"),
        ({"q": np.full(4, 1e3)}, "limits", "q"),
        ({"q": np.zeros((10_001, 4))}, "too_many", "q"),
        ({"path": np.zeros(4)}, "shape", "path"),
        ({"path": np.zeros((0, 4))}, "shape", "path"),
        ({"path": [[0.0] * 4, [1e9] * 4]}, "too_many", "path"),
        ({"path": np.full((2, 4), np.nan)}, "not_finite", "path"),
        ({"path": "there"}, "dtype", "path"),
        ({"to": "scene.png"}, "file", "to"),
        ({"to": "no/such/folder/scene.rrd"}, "file", "no/such/folder/scene.rrd"),
        ({"to": 5}, "type", "to"),
    ],
)
def test_what_is_wrong_is_named(scene: mobee.Scene, arguments: Any, code: str, place: str, tmp_path: Path) -> None:
    arguments.setdefault("to", str(tmp_path / "scene.rrd"))
    with pytest.raises(mobee.MobeeError) as caught:
        scene.show(**arguments)
    assert caught.value.code == code and str(caught.value.place).startswith(place) and caught.value.remedy


def test_a_viewer_that_does_not_start_is_an_error_and_no_wait_without_end(scene: mobee.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    from mobee import _show

    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        monkeypatch.setattr(_show, "_PORT", port)
        monkeypatch.setattr(rerun, "spawn", lambda **options: None)
        _show._open_viewer(rerun)
    monkeypatch.setattr(_show, "_VIEWER_S", 0.2)
    with pytest.raises(mobee.MobeeError, match="the viewer does not start") as caught:
        scene.show()
    assert caught.value.code == "viewer" and "scene.rrd" in caught.value.remedy


def test_the_missing_package_is_named(scene: mobee.Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(mobee.MobeeError, match=r"rerun-sdk is not installed(.|\n)*mobee\[show\]"):
        scene.show()
