"""Drivers in Python: runs by the wall clock with simulated motors, faults, promises, followers of LeRobot."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import mobee
import mobee.conformance
import mobee.lerobot
from mobee._native import DriverLine

ROBOTS = Path(__file__).parents[2] / "configs/robots"
JOINTS = mobee.load(ROBOTS / "ur5.xml").joint_names
ELBOW = 2
File = Callable[[str], Path]


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> File:
    """A configuration of one robot without a driver; runs are written beside it."""
    monkeypatch.chdir(tmp_path)

    def write(robot: str) -> Path:
        path = tmp_path / "arm.toml"
        controller = "{ period_ms = 20, history = 6000, stale_ms = 200 }"
        path.write_text(f'[[robot]]\nname = "arm"\nmodel = "{ROBOTS / robot}"\ncontroller = {controller}\n')
        return path

    return write


class Motors(mobee.Driver):
    """Motors that are where they are sent, until a fault."""

    axes = [mobee.Axis(name, max_speed=2.0, max_acceleration=8.0) for name in JOINTS]

    def __init__(self, fault: Callable[[Motors], Any] | None = None) -> None:
        self.q: NDArray[np.float64] = np.zeros(len(JOINTS))
        self.fault = fault
        self.calls: list[str] = []
        self.greatest_step = 0.0

    def connect(self) -> None:
        self.calls.append("connect")

    def read(self) -> mobee.Sample | None:
        if self.fault is not None and abs(self.q[ELBOW]) > 0.15:
            fault, self.fault = self.fault, None
            sample: mobee.Sample = fault(self)
            return sample
        return mobee.Sample(self.q)

    def command(self, targets: NDArray[np.float64]) -> None:
        self.greatest_step = max(self.greatest_step, float(np.abs(targets - self.q).max()))
        self.q = targets

    def stop(self) -> None:
        self.calls.append("stop")

    def close(self) -> None:
        self.calls.append("close")


class Goals(mobee.Agent):
    """Moves one joint to positions in turn."""

    def __init__(self, *goals: float, joint: int = ELBOW, speed: float = 0.5) -> None:
        self.left, self.joint, self.speed = list(goals), joint, speed

    def next(self, last: Any, view: mobee.View) -> Any:
        if not self.left:
            return mobee.Done()
        return mobee.MoveTo([self.left.pop(0)], joints=[view.joint_names[self.joint]], speed=self.speed)


def outcomes(run: mobee.Run) -> list[str]:
    return [event["outcome"] for event in run.journal.of("outcome")]


def is_late(run: mobee.Run) -> bool:
    """Whether a cycle was late: the machine was busy, or the driver was slow."""
    return any("took longer than" in event["text"] for event in run.journal.of("warning"))


def test_motions_commit_and_roll_back_by_the_wall_clock(file: File, tmp_path: Path) -> None:
    for attempt in range(4):
        motors = Motors()
        # folded so far, the arm touches itself
        agent = Goals(1.9, 2.9, 1.6)
        run = mobee.run(file("ur5.xml"), agent=agent, driver=motors, clock="real", for_s=30, out=tmp_path / f"run-{attempt}")
        if not is_late(run):
            break
    assert outcomes(run) == ["committed", "rolled_back", "committed"] and run.check() and run.ok
    assert run.errors == [] and run.warnings == []
    assert abs(motors.q[ELBOW] - 1.6) < 1e-3
    # 1 rad/s: two periods at most
    assert motors.greatest_step < 0.025
    assert motors.calls == ["connect", "stop", "close"]


def sleeps(seconds: float) -> Callable[[Motors], mobee.Sample]:
    def sleep(motors: Motors) -> mobee.Sample:
        time.sleep(seconds)
        return mobee.Sample(motors.q)

    return sleep


def raises(motors: Motors) -> Any:
    raise ValueError("servo 3 is hot")


def test_an_exception_is_a_fault_of_the_board_and_the_driver_is_connected_again(file: File, tmp_path: Path) -> None:
    motors = Motors(raises)
    with pytest.warns(mobee.MobeeWarning, match="ValueError: servo 3 is hot"):
        run = mobee.run(file("ur5.xml"), agent=Goals(0.5, 0.0), driver=motors, clock="real", for_s=20, out=tmp_path / "run")
    first, *others = run.journal.of("outcome")
    assert first["outcome"] == "faulted" and first["cause"] == {"board_fault": "ValueError: servo 3 is hot"}
    assert [event["outcome"] for event in others] == ["committed"] and run.check()
    (traceback,) = run.errors
    assert 'raise ValueError("servo 3 is hot")' in traceback
    assert motors.calls[:3] == ["connect", "stop", "connect"] and motors.calls[-1] == "close"


def test_a_late_cycle_is_a_lost_reading_and_the_arm_brakes(file: File, tmp_path: Path) -> None:
    motors = Motors(sleeps(0.08))
    run = mobee.run(file("ur5.xml"), agent=Goals(0.5, 0.1), driver=motors, clock="real", for_s=20, out=tmp_path / "run")
    assert outcomes(run) == ["rolled_back", "committed"] and run.check() and run.errors == [] and is_late(run)
    assert motors.greatest_step < 0.025


def test_a_reading_that_is_lost_stops_nothing(file: File, tmp_path: Path) -> None:
    class Loses(Motors):
        count = 0

        def read(self) -> mobee.Sample | None:
            self.count += 1
            return None if self.count % 4 == 3 else super().read()

    run = mobee.run(file("ur5.xml"), agent=Goals(0.5), driver=Loses, clock="real", for_s=20, out=tmp_path / "run")
    assert outcomes(run) == ["committed"] or is_late(run)
    with pytest.raises(mobee.MobeeError, match="`read` returns None"):
        mobee.run(file("ur5.xml"), agent=Goals(0.5), driver=type("Never", (Reads,), {"connect_s": 0.2})(None), clock="real")


def test_a_stalled_driver_is_lost_and_makes_no_step_afterwards(file: File, tmp_path: Path) -> None:
    motors = Motors(sleeps(0.6))
    run = mobee.run(file("ur5.xml"), agent=Goals(0.5, 0.0), driver=motors, clock="real", for_s=20, out=tmp_path / "run")
    first = run.journal.of("outcome")[0]
    assert first["outcome"] == "faulted" and first["cause"] == "stale"
    assert outcomes(run)[1:] == ["committed"] and run.check()
    # the trajectory stood while nobody was sent along it
    assert motors.greatest_step < 0.025


class Reads(Motors):
    """Returns something else than a sample."""

    def __init__(self, given: Any) -> None:
        super().__init__()
        self.given = given

    def read(self) -> mobee.Sample | None:
        sample: mobee.Sample = self.given
        return sample


class Hostile:
    def __array__(self, *arguments: Any, **names: Any) -> Any:
        raise RuntimeError("no array")


BAD_SAMPLES: dict[str, tuple[Any, str]] = {
    "text alone": ("q", "read returned str"),
    "array": (np.zeros(6), "read returned ndarray"),
    "nan": (mobee.Sample([0, 0, np.nan, 0, 0, 0]), "number 2 is NaN"),
    "infinite": (mobee.Sample([0, 0, 0, -np.inf, 0, 0]), "number 3 is -inf"),
    "short": (mobee.Sample(np.zeros(5)), r"it has shape \(5,\)"),
    "batch": (mobee.Sample(np.zeros((1, 6))), r"it has shape \(1, 6\)"),
    "text": (mobee.Sample("here"), "dtype"),
    "complex": (mobee.Sample(np.zeros(6) * 1j), "dtype"),
    "hostile": (mobee.Sample(Hostile()), "no array"),
    "external": (mobee.Sample(np.zeros(6), external=[1.0]), "external"),
    "limits": (mobee.Sample([7.0, 0, 0, 0, 0, 0]), "outside its limits"),
}


@pytest.mark.parametrize("case", BAD_SAMPLES)
def test_readings_are_checked_before_anything_moves(case: str, file: File) -> None:
    given, text = BAD_SAMPLES[case]
    driver = Reads(given)
    with pytest.raises(mobee.MobeeError, match=text) as raised:
        mobee.run(file("ur5.xml"), agent=Goals(0.5), driver=driver, clock="real", for_s=5)
    assert "Reads.read" in str(raised.value) and raised.value.__cause__ is not None
    assert driver.greatest_step == 0.0 and driver.calls[-1] == "close"


def axes(change: Callable[[list[Any]], Any]) -> type[Motors]:
    given: list[Any] = list(Motors.axes)
    changed = change(given)
    return type("Changed", (Motors,), {"axes": given if changed is None else changed})


def test_axes_that_do_not_fit_are_refused_at_their_place(file: File) -> None:
    bad: list[tuple[type[Motors], str]] = [
        (axes(lambda all: all.pop() and None), "lacks joint"),
        (axes(lambda all: [*all, mobee.Axis("wrist_4")]), "no joint"),
        (axes(lambda all: [*all, all[0]]), "twice"),
        (axes(lambda all: []), "is empty"),
        (axes(lambda all: "axes"), "axes has str"),
        (axes(lambda all: 3), "axes is int"),
        (axes(lambda all: [mobee.Axis(JOINTS[0], max_speed=np.nan), *all[1:]]), r"axes\[0\].max_speed"),
        (axes(lambda all: [mobee.Axis(JOINTS[0], unit="m"), *all[1:]]), "another unit"),
        (axes(lambda all: [mobee.Axis(JOINTS[0], unit="deg"), *all[1:]]), "its unit"),  # type: ignore[arg-type]
        (axes(lambda all: [mobee.Axis(JOINTS[0], lower=1.0, upper=0.5), *all[1:]]), "lower limit"),
        (axes(lambda all: [mobee.Axis(JOINTS[0], lower=50.0, upper=60.0), *all[1:]]), "outside those of the model"),
        (type("Slow", (Motors,), {"period": 5.0}), "Slow.period"),
        (type("Slow", (Motors,), {"latency": "short"}), "Slow.latency"),
    ]
    for driver, text in bad:
        with pytest.raises(mobee.MobeeError, match=text) as raised:
            mobee.run(file("ur5.xml"), agent=Goals(0.5), driver=driver, clock="real", for_s=5)
        assert raised.value.remedy, text


def test_a_driver_needs_the_real_clock_and_a_robot(file: File) -> None:
    with pytest.raises(mobee.MobeeError, match='pass clock="real"'):
        mobee.run(file("ur5.xml"), agent=Goals(0.5), driver=Motors())
    with pytest.raises(mobee.MobeeError, match="leg"):
        mobee.run(file("ur5.xml"), agent=Goals(0.5), driver={"leg": Motors()}, clock="real")
    with pytest.raises(mobee.MobeeError, match="driver is int"):
        mobee.run(file("ur5.xml"), agent=Goals(0.5), driver=3, clock="real")  # type: ignore[arg-type]
    with pytest.raises(mobee.MobeeError, match="none was passed"):
        kind = 'robot.arm.driver={ kind = "python" }'
        mobee.run(file("ur5.xml"), agent=Goals(0.5), clock="real", set=[kind])


class Never(Motors):
    connect_s = 0.3

    def connect(self) -> None:
        raise ConnectionError("no such port")


class Blocks(Motors):
    connect_s = 0.3

    def connect(self) -> None:
        time.sleep(0.5)


def test_a_driver_that_does_not_connect_is_an_error(file: File) -> None:
    with pytest.raises(mobee.MobeeError, match="ConnectionError: no such port") as raised:
        mobee.run(file("ur5.xml"), agent=Goals(0.5), driver=Never, clock="real")
    assert isinstance(raised.value.__cause__, ConnectionError)
    with pytest.raises(mobee.MobeeError, match="gives no reading within 0.3 s"):
        mobee.run(file("ur5.xml"), agent=Goals(0.5), driver=Blocks, clock="real")


# promises


class Bench(mobee.Driver):
    """Motors with a lag of 15 ms."""

    axes = [mobee.Axis(name, max_speed=1.0, max_acceleration=7.0, lower=-0.3, upper=0.3) for name in "abc"]

    def __init__(self) -> None:
        self.q = self.targets = np.zeros(3)
        self.at = time.monotonic()

    def read(self) -> mobee.Sample:
        now = time.monotonic()
        self.q = self.targets + (self.q - self.targets) * np.exp((self.at - now) / 0.015)
        self.at = now
        return mobee.Sample(self.q)

    def command(self, targets: NDArray[np.float64]) -> None:
        self.targets = targets


def test_a_driver_keeps_every_promise() -> None:
    mobee.conformance.check(Bench, attempts=20, at_once=8)


class Overshoots(Bench):
    def command(self, targets: NDArray[np.float64]) -> None:
        super().command(1.2 * targets)


class Raises(Bench):
    def read(self) -> mobee.Sample:
        raise OSError("the cable is cut")


def test_broken_promises_are_named() -> None:
    promise = "one motor moves to its target and the others rest"
    with pytest.raises(mobee.MobeeError, match=promise) as raised:
        mobee.conformance.check(Overshoots, promise, attempts=1)
    assert raised.value.code == "conformance" and "motor a is at" in raised.value.message
    with pytest.raises(mobee.MobeeError, match="OSError: the cable is cut") as raised:
        mobee.conformance.check(Raises, "the board describes itself", attempts=1)
    assert isinstance(raised.value.__cause__, OSError)
    with pytest.raises(mobee.MobeeError, match="no promise"):
        mobee.conformance.check(Bench, "no such promise")
    with pytest.raises(mobee.MobeeError, match="has no limits"):
        mobee.conformance.check(Motors, promise)
    with pytest.raises(mobee.MobeeError, match="needs a new one"):
        mobee.conformance.check(Bench())  # type: ignore[arg-type]


# the line itself, in hostile hands


def line() -> DriverLine:
    return DriverLine("test.Arm", Bench.axes, period=0.01, latency=0.04, connect_s=1.0)


def test_a_line_can_be_used_at_any_time() -> None:
    one = line()
    assert one.wait() == "again"
    assert one.reply(mobee.Sample(np.zeros(3))) == (None, False)
    one.fail(ValueError("before anything"))
    one.leave()
    one.end()
    assert one.wait() is None
    one.end()
    assert one.wait() is None and one.cycles()[0] == 0
    with pytest.raises(mobee.MobeeError, match="in use, or was used before"):
        from mobee._native import keep_promise

        keep_promise(one, mobee.conformance.PROMISES[0])
    with pytest.raises(TypeError):
        one.fail("no exception")  # type: ignore[arg-type]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_line_belongs_to_its_process() -> None:
    program = f"""
import os, sys, mobee
sys.path.insert(0, {str(Path(__file__).parent)!r})
import test_drivers
line = test_drivers.line()
if os.fork() == 0:
    for call in (line.wait, lambda: line.reply(mobee.Sample([0, 0, 0])), lambda: line.fail(ValueError())):
        try:
            call()
        except mobee.MobeeError as e:
            assert e.code == "fork" and e.remedy
        else:
            os._exit(3)
    line.end()
    os._exit(0)
sys.exit(os.waitstatus_to_exitcode(os.wait()[1]))
"""
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", program], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_an_interpreter_that_ends_in_mid_cycle_does_not_abort() -> None:
    program = f"""
import sys, threading, time, mobee
sys.path.insert(0, {str(Path(__file__).parent)!r})
import test_drivers
from mobee import _driver
_driver._JOIN_S = 0.2
from mobee._native import keep_promise
class Stuck(test_drivers.Bench):
    def read(self):
        time.sleep(1000.0)
for driver in (test_drivers.Bench, Stuck):
    serving = _driver.start(driver)
    promise = lambda line=serving.line: keep_promise(line, mobee.conformance.PROMISES[0])
    threading.Thread(target=promise, daemon=True).start()
time.sleep(0.3)
print("ends")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and done.stdout == "ends\n", f"{done.returncode}: {done.stderr[-2000:]}"


# followers of LeRobot


class Config:
    use_degrees = True
    disable_torque_on_disconnect = False


class FakeFollower:
    """An SO-101 as LeRobot presents it: degrees, the gripper in percent."""

    name = "so101_follower"
    motors = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")

    def __init__(self) -> None:
        self.config: Any = Config()
        self.cameras: dict[str, Any] = {}
        self.is_connected = False
        self.is_calibrated = True
        self.at = dict.fromkeys(self.action_features, 0.0) | {"gripper.pos": 50.0}
        self.calls: list[str] = []
        self.sent: list[dict[str, float]] = []
        self.reads = 0

    @property
    def action_features(self) -> dict[str, type]:
        return {f"{motor}.pos": float for motor in self.motors}

    def connect(self, calibrate: bool = True) -> None:
        assert not calibrate
        self.is_connected = True
        self.calls.append("connect")

    def get_observation(self) -> dict[str, Any]:
        assert self.is_connected
        self.reads += 1
        if self.reads % 10 == 0:
            raise ConnectionError("There is no status packet!")
        return {**self.at, "temperature": 30}

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        assert self.is_connected and action.keys() == self.at.keys() and all(type(v) is float for v in action.values())
        self.sent.append(action)
        self.at = dict(action)
        return action

    def disconnect(self) -> None:
        self.is_connected = False
        self.calls.append("disconnect")


@pytest.fixture(scope="session")
def so101() -> mobee.Robot:
    return mobee.load(ROBOTS / "so101.xml")


def test_a_guarded_follower_commits_and_rolls_back(so101: mobee.Robot, file: File, tmp_path: Path) -> None:
    elbow = so101.joint_names.index("elbow_flex")
    for attempt in range(4):
        follower = FakeFollower()
        arm = mobee.lerobot.Guarded(follower, so101)
        # with the elbow at 90 degrees the arm touches itself
        agent = Goals(*np.radians([30.0, 90.0]), joint=elbow, speed=0.8)
        run = mobee.run(file("so101.xml"), agent=agent, driver=arm, clock="real", for_s=20, out=tmp_path / f"run-{attempt}")
        if not is_late(run):
            break
    assert outcomes(run) == ["committed", "rolled_back"] and run.check()
    assert abs(follower.at["elbow_flex.pos"] - 30.0) < 0.3 and abs(follower.at["gripper.pos"] - 50.0) < 0.1
    farthest = arm._units.positions(np.array([list(action.values()) for action in follower.sent]))
    assert mobee.Scene(so101).free(farthest).all() and farthest[:, elbow].max() > np.radians(60.0)
    assert follower.calls == ["connect", "disconnect"]
    steps = [abs(b["elbow_flex.pos"] - a["elbow_flex.pos"]) for a, b in zip(follower.sent, follower.sent[1:], strict=False)]
    # 0.8 rad/s for two periods at most
    assert max(steps) < 2.0


def test_units_of_followers_are_those_of_lerobot(so101: mobee.Robot) -> None:
    rng = np.random.default_rng(1)
    q = rng.uniform(so101.lower, so101.upper, (20, so101.dof))
    pan, gripper = so101.joint_names.index("shoulder_pan"), so101.joint_names.index("gripper")
    for unit in ("degrees", "range"):
        offset = {"shoulder_pan": 0.3} if unit == "degrees" else {}
        units = mobee.lerobot.JointUnits(so101, unit, ["gripper"], offset, ["shoulder_lift", "gripper"])
        assert np.allclose(units.positions(units.values(q)), q)
        ends = units.values(np.array([so101.lower, so101.upper]))
        assert np.allclose(ends[:, gripper], [100.0, 0.0])
        if unit == "range":
            assert np.allclose(ends[:, pan], [-100.0, 100.0])
        else:
            assert np.isclose(units.positions(np.full(so101.dof, 90.0))[pan], np.pi / 2 + 0.3)
            assert np.isclose(units.positions(np.full(so101.dof, 90.0))[so101.joint_names.index("shoulder_lift")], -np.pi / 2)


def test_followers_that_do_not_fit_are_refused(so101: mobee.Robot, ur5: mobee.Robot, file: File) -> None:
    def refused(text: str, model: mobee.Robot = so101, **options: Any) -> None:
        follower = FakeFollower()
        follower.config = options.pop("config", follower.config)
        follower.cameras = options.pop("cameras", {})
        with pytest.raises(mobee.MobeeError, match=text) as raised:
            mobee.lerobot.Guarded(follower, model, **options)
        assert raised.value.remedy

    drops = type("Drops", (), {"use_degrees": True, "disable_torque_on_disconnect": True})()
    refused("the arm falls", config=drops)
    refused("has cameras", cameras={"wrist": object()})
    refused("no use_degrees", config=None)
    refused("use_degrees=True", unit="range")
    refused("the model's are", model=ur5)
    refused("no joint 'gripper'", percent="gripper")
    refused("no joint 'hand'", motors={"hand": "gripper"})
    refused("unit of degrees", offset={"gripper": 0.1})
    refused("not finite", offset={"shoulder_pan": np.nan})

    follower = FakeFollower()
    follower.is_calibrated = False
    with pytest.raises(mobee.MobeeError, match="lerobot-calibrate"):
        mobee.run(file("so101.xml"), agent=Goals(0.1), driver=mobee.lerobot.Guarded(follower, so101), clock="real")
    follower = FakeFollower()
    del follower.at["gripper.pos"]
    with pytest.raises(mobee.MobeeError, match="no number for each joint"):
        mobee.run(file("so101.xml"), agent=Goals(0.1), driver=mobee.lerobot.Guarded(follower, so101), clock="real")
    assert follower.calls[-1] == "disconnect"


def test_a_driver_behind_set_points(file: File) -> None:
    arm = Motors()
    with mobee.Follow(file("ur5.xml"), driver=arm, clock="real", rate=30, out=Path("follow")) as robot:
        goal = robot.view.q.copy()
        goal[ELBOW] += 0.2
        for _ in range(40):
            sent = robot.send(goal)
            robot.sleep(1 / 30)
        assert abs(sent[ELBOW] - goal[ELBOW]) < 1e-6
        assert abs(arm.q[ELBOW] - goal[ELBOW]) < 1e-3
    assert arm.calls[0] == "connect" and arm.calls[-1] == "close"
    run = robot.close()
    assert run is not None and run.summary["counters"]["committed"] == 1 and not run.check().violations
    with pytest.raises(mobee.MobeeError, match="wall clock"):
        mobee.Follow(file("ur5.xml"), driver=Motors(), clock="virtual")
