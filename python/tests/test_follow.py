"""A robot that follows set-points of a program, in virtual time; one test by a real clock."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mobee

ROBOT = Path(__file__).parents[2] / "configs/robots/so101.xml"
WORLD = """<WorldList version="1.0"><object name="table" type="obstacle" persistent="1" px="0.2" pz="-0.03">
<box width="1.0" height="1.2" depth="0.04"/></object></WorldList>"""
FILE = """
world.file = "table.xml"
[[robot]]
name = "so101"
model = {model!r}
controller = {{ period_ms = 10, history = 6000, reserve_mm = 10 {controller} }}
driver = {{ kind = "sim", profile = "{profile}", max_speed_deg_per_s = 60, max_acceleration_deg_per_s2 = 400 {driver} }}
"""


def written(folder: Path, profile: str = "so101", driver: str = "", controller: str = "") -> Path:
    (folder / "table.xml").write_text(WORLD)
    file = folder / "so101.toml"
    if profile == "so101":
        # as that of the driver `feetech`
        driver += ', servo = { stop = "commanded" }'
    file.write_text(FILE.format(model=str(ROBOT), profile=profile, driver=driver, controller=controller))
    return file


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return written(tmp_path)


@pytest.fixture
def robot(file: Path, tmp_path: Path) -> Iterator[mobee.Follow]:
    with mobee.Follow(file, clock="virtual", seed=1, out=tmp_path / "run") as robot:
        yield robot


def down(robot: mobee.Follow) -> Any:
    """A configuration with the gripper in the table."""
    q = robot.view.q.copy()
    q[1] += 1.2
    return q


def test_set_points_are_followed(robot: mobee.Follow) -> None:
    start = robot.view
    for k in range(60):
        q = start.q.copy()
        q[0] += 0.15 * (1 - np.cos(0.1 * k))
        sent = robot.send(q)
        assert k < 30 or np.allclose(sent, q, atol=0.02), "slowly at first, until it is known by how much the arm sags"
    assert robot.info["counts"]["held"] == 0 and robot.view.at == pytest.approx(start.at + 2.0, abs=0.02)
    assert robot.info["robot"] == "moving" and robot.info["last"] is None
    assert np.allclose(robot.view.q, sent, atol=0.12), "an arm that lags and sags"
    robot.sleep(2.0)
    assert robot.info["robot"] == "rest" and robot.info["last"]["outcome"] == "committed", "it stalls: the robot holds"
    run = robot.close()
    assert run is not None and run is robot.close()
    assert run.check() and len(run.journal.of("commit")) == len(run.journal.of("outcome")) == 1
    with pytest.raises(mobee.MobeeError, match="closed"):
        robot.send(q)


def test_the_table_is_not_touched_and_the_reason_is_given(robot: mobee.Follow, caplog: pytest.LogCaptureFixture) -> None:
    goal, scene = down(robot), robot.view.scene
    with caplog.at_level(logging.WARNING, "mobee.follow"):
        for _ in range(90):
            sent = robot.send(goal)
            assert scene.free(sent) and scene.distance(robot.view.q) > 0.01
    assert not np.allclose(sent, goal, atol=0.1)
    info = robot.info
    assert (info["status"], info["code"]) == ("held", "blocked") and "table" in info["reason"]
    assert any("table" in record.message for record in caplog.records) and len(caplog.records) < 10, "a log line at each change"
    assert info["counts"]["rolled_back"] == 0 and np.allclose(sent, robot.view.q, atol=0.12)
    # and it is not stuck there
    for _ in range(60):
        sent = robot.send(goal * [1, 0, 1, 1, 1, 1])
    assert robot.info["status"] == "sent"


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_holds(robot: mobee.Follow, wrong: float) -> None:
    rest, at = robot.view.q, robot.view.at
    q = rest.copy()
    q[3] = wrong
    for _ in range(5):
        assert np.allclose(robot.send(q), rest, atol=0.02)
    assert robot.info["code"] == "not_finite" and "wrist_flex" in robot.info["reason"]
    assert robot.view.at == pytest.approx(at + 5 / 30, abs=0.02) and robot.info["robot"] == "rest"
    chunk = robot.send_chunk([rest, q])
    assert (chunk.status, chunk.outcome, len(chunk.sent)) == ("held", "refused", 0)


def test_jumps_are_shortened_to_what_the_motors_can_do(robot: mobee.Follow) -> None:
    start = robot.view.q.copy()
    goal = start.copy()
    goal[0] = 1.5
    steps = [start]
    while not np.allclose(steps[-1], goal, atol=1e-3):
        steps.append(robot.send(goal))
        assert len(steps) < 90
    moved = np.abs(np.diff(np.array(steps)[:, 0]))
    assert moved.max() <= np.radians(60) / 30 and robot.info["counts"]["codes"]["speed"] > 10
    far = robot.send(goal + 100)
    assert np.all(far <= robot.robot.upper + 1e-9) and robot.info["code"] == "limits"


def test_an_old_observation_holds(robot: mobee.Follow) -> None:
    q = robot.view.q
    robot.send(q, seen_at=robot.view.at)
    assert robot.info["status"] == "sent"
    robot.send(q, seen_at=robot.view.at - 2.0)
    assert (robot.info["status"], robot.info["code"]) == ("held", "stale")
    chunk = robot.send_chunk([q, q], seen_at=robot.view.at - 2.0)
    assert (chunk.code, chunk.outcome, chunk.given) == ("stale", "refused", 2)


def test_a_chunk_is_one_transaction_with_one_outcome(robot: mobee.Follow) -> None:
    q = robot.view.q
    points = q + np.linspace(0, 1, 31)[1:, None] * np.array([0.6, 0, 0, 0, 0.4, 0])
    chunk = robot.send_chunk(points)
    assert chunk.status in ("sent", "limited") and chunk.outcome is None and np.allclose(chunk.sent[-1], points[-1], atol=1e-3)
    assert chunk.wait() == "committed" and chunk.account is not None and chunk.account["id"] == chunk.id
    assert np.allclose(robot.view.q, points[-1], atol=0.12)
    # the rest of a chunk is replaced by the next one, which continues its transaction
    first = robot.send_chunk(points[::-1])
    robot.sleep(0.3)
    second = robot.send_chunk(robot.view.q + np.zeros((5, 1)))
    assert first.id == second.id != chunk.id
    assert first.wait() == second.wait() == "committed"
    into = robot.send_chunk(np.linspace(robot.view.q, down(robot), 40)[1:])
    assert (into.status, into.code) == ("limited", "blocked") and 0 < len(into.sent) < 40 and "table" in into.reason
    assert robot.view.scene.free(into.sent).all() and into.wait() == "committed"
    run = robot.close()
    assert run is not None and run.summary["counters"]["contacts"] == 0 and run.check()


def test_a_push_into_something_unknown_is_rolled_back_without_blocking(tmp_path: Path) -> None:
    post = ', unknown = [{ name = "post", size_m = [0.04, 0.04, 0.5], at_m = [0.28, 0.12, 0.15] }]'
    file = written(tmp_path, driver=post, controller=", stall_deg = 8")
    with mobee.Follow(file, clock="virtual", seed=1, out=tmp_path / "run") as robot:
        start = robot.view.q.copy()
        goal = start.copy()
        goal[0] = -1.2
        codes = set()
        for _ in range(240):
            before = robot.view.at
            sent = robot.send(goal)
            assert np.isfinite(sent).all() and robot.view.at - before == pytest.approx(1 / 30, abs=0.011)
            codes.add(robot.info["code"])
            if robot.info["last"] is not None and robot.info["robot"] == "rest":
                break
        assert robot.info["last"]["outcome"] == "rolled_back" and "rolling_back" in codes, robot.info
        # away from the post it goes on after half a second
        for _ in range(60):
            sent = robot.send(start)
        assert robot.info["status"] in ("sent", "limited") and robot.info["counts"]["faulted"] == 0
        run = robot.close()
    assert run is not None and run.check()
    assert len(run.journal.of("commit")) == len(run.journal.of("outcome"))


def test_equal_set_points_give_equal_runs(file: Path, tmp_path: Path) -> None:
    def hashed(k: int, seed: int) -> str | None:
        rng = np.random.default_rng(seed)
        with mobee.Follow(file, clock="virtual", seed=1, out=tmp_path / f"run-{k}") as robot:
            for _ in range(60):
                robot.send(robot.view.q + rng.normal(0, 0.1, 6))
                time.sleep(rng.uniform(0, 0.002))
            run = robot.close()
        assert run is not None
        return run.hash

    assert hashed(1, 5) == hashed(2, 5) != hashed(3, 6)


def test_a_robot_that_begins_beside_an_obstacle_may_leave_it(tmp_path: Path) -> None:
    model, world = mobee.load(ROBOT), mobee.World()
    world.add("table", mobee.Box((1.0, 1.2, 0.04)), position=(0.2, 0, -0.03))
    scene = mobee.Scene(model, world)
    lift = next(deg for deg in np.arange(0, 60, 0.05) if scene.distance(model.home + np.radians([0, deg, 0, 0, 0, 0])) < 0.014)
    file = written(tmp_path, profile="ideal", driver=f", start_deg = {{ shoulder_lift = {lift} }}")
    with mobee.Follow(file, clock="virtual", seed=1, out=tmp_path / "run", clearance=0.004) as robot:
        start = robot.view.q
        up, into = start - [0, 0.2, 0, 0, 0, 0], start + [0, 0.2, 0, 0, 0, 0]
        robot.send(into)
        assert (robot.info["status"], robot.info["code"]) == ("held", "blocked") and "table" in robot.info["reason"]
        for _ in range(45):
            robot.send(up)
        assert np.allclose(robot.view.q, up, atol=0.01)


def test_arguments_are_checked(file: Path, robot: mobee.Follow) -> None:
    for given, code in [({"rate": 0}, "bounds"), ({"speed": 2}, "bounds"), ({"hold_after": "x"}, "type"), ({"robot": "r2"}, "config")]:
        with pytest.raises(mobee.MobeeError) as e:
            mobee.Follow(file, clock="virtual", **given)  # type: ignore[arg-type]
        assert e.value.code in (code, "robots"), e.value
    for q in [np.zeros(5), np.zeros((2, 6)), "no", None]:
        with pytest.raises(mobee.MobeeError):
            robot.send(q)  # type: ignore[arg-type]
    for q in [np.zeros(6), np.zeros((0, 6)), np.zeros((2, 5))]:
        with pytest.raises(mobee.MobeeError):
            robot.send_chunk(q)


def test_a_run_that_ends_is_over(file: Path, tmp_path: Path) -> None:
    with mobee.Follow(file, clock="virtual", seed=1, for_s=2.0, out=tmp_path / "run") as robot:
        with pytest.raises(mobee.MobeeError) as e:
            for _ in range(90):
                robot.send(robot.view.q)
        assert e.value.code == "over"
        run = robot.close()
    assert run is not None and run.summary["reason"] == "time"


def test_by_a_real_clock_no_call_waits_for_the_robot(tmp_path: Path) -> None:
    file = written(tmp_path, profile="ideal")
    with mobee.Follow(file, clock="real", out=tmp_path / "run", rate=50) as robot:
        assert robot.is_real
        start, goal, took = robot.view.q.copy(), down(robot), []
        views: list[float] = []
        ended = threading.Event()

        def look() -> None:
            while not ended.is_set():
                views.append(robot.view.at)
                time.sleep(0.002)

        looks = threading.Thread(target=look)
        looks.start()
        due = time.perf_counter()
        for k in range(150):
            began = time.perf_counter()
            sent = robot.send(goal if k % 50 < 40 else start)
            took.append(time.perf_counter() - began)
            assert robot.view.scene.free(sent)
            due += 0.02
            time.sleep(max(0.0, due - time.perf_counter()))
        ended.set()
        looks.join()
        counts = robot.info["counts"]
        run = robot.close()
    assert max(took) < 0.2, f"median {np.median(took):.4f} s, most {max(took):.4f} s: a rollback takes a second"
    assert len(set(views)) > 100 and views == sorted(views), "the newest reading from another thread"
    assert counts["sent"] + counts["limited"] > 50, counts
    assert run is not None and run.check(), run.check().violations
    assert run.summary["counters"]["hard_contacts"] == 0
