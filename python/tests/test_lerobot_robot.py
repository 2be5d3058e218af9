"""The plug-in of LeRobot, without LeRobot: modules of its names stand for it."""

from __future__ import annotations

import sys
import types
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mobee
from test_follow import written

PLUGIN = Path(__file__).parents[1] / "lerobot_robot_mobee"


class Robot:
    """As LeRobot's base class, without files."""

    def __init__(self, config: Any) -> None:
        self.id = config.id

    def __str__(self) -> str:
        return f"{self.id} {type(self).__name__}"

    def __enter__(self) -> Any:
        self.connect()  # type: ignore[attr-defined]
        return self

    def __exit__(self, *_: object) -> None:
        self.disconnect()  # type: ignore[attr-defined]


@dataclass(kw_only=True)
class RobotConfig:
    id: str | None = None

    known = {}  # noqa: RUF012

    @classmethod
    def register_subclass(cls, name: str) -> Any:
        def register(of: type) -> type:
            cls.known[name] = of
            return of

        return register


class Camera:
    """A camera of LeRobot."""

    height, width, is_connected = 2, 3, False

    def connect(self) -> None:
        self.is_connected = True

    def disconnect(self) -> None:
        self.is_connected = False

    def read_latest(self) -> Any:
        return np.zeros((2, 3, 3), np.uint8)


@pytest.fixture
def plugin(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    cameras = types.ModuleType("lerobot.cameras")
    cameras.CameraConfig = object  # type: ignore[attr-defined]
    cameras.make_cameras_from_configs = lambda configs: {name: Camera() for name in configs}  # type: ignore[attr-defined]
    robots = types.ModuleType("lerobot.robots")
    robots.Robot, robots.RobotConfig = Robot, RobotConfig  # type: ignore[attr-defined]
    for module in (types.ModuleType("lerobot"), cameras, robots):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    for name in [name for name in sys.modules if name.startswith("lerobot_robot_mobee")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(PLUGIN))
    import lerobot_robot_mobee

    yield lerobot_robot_mobee
    for name in [name for name in sys.modules if name.startswith("lerobot_robot_mobee")]:
        del sys.modules[name]


def test_it_is_found_by_its_name_and_type(plugin: Any) -> None:
    project = (PLUGIN / "pyproject.toml").read_text()
    assert 'name = "lerobot_robot_mobee"' in project, "LeRobot imports the distribution's name as a module"
    assert RobotConfig.known["mobee"] is plugin.MobeeConfig
    assert plugin.Mobee.config_class is plugin.MobeeConfig and plugin.Mobee.name == "mobee"


def test_a_policy_drives_the_robot_in_units_of_lerobot(plugin: Any, tmp_path: Path) -> None:
    config = plugin.MobeeConfig(id="arm", file=str(written(tmp_path)), clock="virtual", out=str(tmp_path / "run"), cameras={"top": None})
    robot = plugin.Mobee(config)
    names = ["shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper"]
    assert list(robot.action_features) == [f"{name}.pos" for name in names], "unconnected, too"
    assert robot.observation_features == {**robot.action_features, "top": (2, 3, 3)}
    assert not robot.is_connected and robot.is_calibrated
    for call in (robot.get_observation, robot.disconnect, lambda: robot.send_action({}), lambda: robot.info):
        with pytest.raises(ConnectionError):
            call()
    with robot:
        assert robot.is_connected
        with pytest.raises(ConnectionError):
            robot.connect()
        seen = robot.get_observation()
        assert set(seen) == set(robot.observation_features) and seen["top"].shape == (2, 3, 3)
        assert seen["gripper.pos"] == pytest.approx(100 / 11, abs=0.5), "zero is 10 of 110 degrees from its closed end"
        wanted = {name: value for name, value in seen.items() if name != "top"}
        for _ in range(90):
            seen = robot.get_observation()
            wanted = {**wanted, "shoulder_pan.pos": min(20.0, seen["shoulder_pan.pos"] + 8), "gripper.pos": 40.0}
            sent = robot.send_action(wanted)
            assert set(sent) == set(robot.action_features) and all(type(value) is float for value in sent.values())
        assert sent == pytest.approx(wanted, abs=0.1)
        seen = robot.get_observation()
        assert seen["shoulder_pan.pos"] == pytest.approx(20, abs=1) and seen["gripper.pos"] == pytest.approx(40, abs=2)
        down = {**wanted, "shoulder_lift.pos": 80.0}
        for _ in range(90):
            robot.get_observation()
            held = robot.send_action(down)
        assert held["shoulder_lift.pos"] < 60 and robot.info["code"] == "blocked"
        chunk = robot.send_chunk([{**held, "shoulder_pan.pos": 20.0 - k} for k in range(10)])
        assert robot.actions_of(chunk.sent)[-1]["shoulder_pan.pos"] == pytest.approx(11, abs=0.1) and chunk.wait() == "committed"
        with pytest.raises(mobee.MobeeError, match="no joint 'elbow'"):
            robot.send_action({"elbow.pos": 1.0})
        robot.send_action({"shoulder_pan.pos": float("nan")})
        assert robot.info["code"] in ("not_finite", "stale")
    assert not robot.is_connected and robot.run is not None and robot.run.check()
    assert robot.run.summary["counters"]["contacts"] == 0


def test_ranges_instead_of_degrees(plugin: Any, tmp_path: Path) -> None:
    config = plugin.MobeeConfig(id="arm", file=str(written(tmp_path, "ideal")), clock="virtual", out=str(tmp_path / "run"), use_degrees=False)
    with plugin.Mobee(config) as robot:
        assert robot.get_observation()["shoulder_pan.pos"] == pytest.approx(0.0, abs=0.5)
        for _ in range(90):
            robot.send_action({"shoulder_pan.pos": 50.0})
            robot.get_observation()
        assert robot.get_observation()["shoulder_pan.pos"] == pytest.approx(50.0, abs=0.5)
