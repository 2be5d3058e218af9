from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from lerobot.cameras import CameraConfig, make_cameras_from_configs
from lerobot.robots import Robot, RobotConfig

import mobee

try:
    from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
except ImportError:  # other versions of LeRobot

    class DeviceNotConnectedError(ConnectionError):  # type: ignore[no-redef]
        """The robot is not connected."""

    class DeviceAlreadyConnectedError(ConnectionError):  # type: ignore[no-redef]
        """The robot is connected already."""


_LOG = logging.getLogger(__name__)


@RobotConfig.register_subclass("mobee")
@dataclass
class MobeeConfig(RobotConfig):
    """Settings of a robot that MoBeE drives. Units of actions and observations are those of LeRobot's followers.

    Attributes
    ----------
    file : str
        Configuration of MoBeE: the robot with its driver, its controller and the world. ``mobee new`` writes one.
    robot : str, optional
        The robot of the file, if there are several.
    fps : float
        Actions per second.
    use_degrees : bool
        Joints in degrees (mm if they slide), zero where the model has it; else -100 to 100 of the range between the model's limits.
    grippers : list of str
        Joints in 0 to 100 of the range between the model's limits.
    speed : float
        Share of the joints' greatest speed.
    clearance_m : float
        Distance that is kept beyond that of the controller, m.
    hold_after_s : float
        Age of the last action at which the motion ends, s.
    max_age_s : float
        An action is not sent if the last observation is older, s.
    recover : bool
        Frees a robot that holds after a contact.
    clock : "real" or "virtual"
        With "virtual", a simulated robot goes on by a period with each action.
    out : str, optional
        Folder of the run's journal; default: ``runs/NAME-TIME``.
    set : list of str
        Assignments as of ``mobee run --set``.
    cameras : dict of CameraConfig
        Cameras of LeRobot, read as its followers do.
    """

    file: str = ""
    robot: str | None = None
    fps: float = 30.0
    use_degrees: bool = True
    grippers: list[str] = field(default_factory=lambda: ["gripper"])
    speed: float = 1.0
    clearance_m: float = 0.0
    hold_after_s: float = 0.5
    max_age_s: float = 0.5
    recover: bool = True
    clock: str = "real"
    out: str | None = None
    set: list[str] = field(default_factory=list)
    cameras: dict[str, CameraConfig] = field(default_factory=dict)


class Mobee(Robot):
    """A robot behind `mobee.Follow`: actions are simulated ahead, and `send_action` returns what was really sent."""

    config_class = MobeeConfig
    name = "mobee"

    def __init__(self, config: MobeeConfig) -> None:
        super().__init__(config)
        self.config = config
        self.cameras = make_cameras_from_configs(config.cameras)
        self._follow: mobee.Follow | None = None
        self._sent: np.ndarray | None = None
        self._seen_at: float | None = None
        #: The last run with its journal, after `disconnect`.
        self.run: mobee.Run | None = None

    @cached_property
    def _units(self) -> _Units:
        config = self.config
        names, lower, upper, kinds = mobee.Follow.joints(config.file, robot=config.robot, set=config.set)
        unknown = [name for name in config.grippers if name not in names]
        if unknown and config.grippers != ["gripper"]:
            raise mobee.MobeeError("joints", f"the robot has no joint {unknown[0]!r}", "grippers", f"give some of {', '.join(names)}")
        return _Units(names, lower, upper, kinds, config.grippers, config.use_degrees)

    @property
    def _camera_features(self) -> dict[str, tuple[int, ...]]:
        features: dict[str, tuple[int, ...]] = {}
        for name, camera in self.cameras.items():
            if getattr(camera, "use_rgb", True):
                features[name] = (camera.height, camera.width, 3)
            if getattr(camera, "use_depth", False):
                features[f"{name}_depth"] = (camera.height, camera.width, 1)
        return features

    @property
    def observation_features(self) -> dict[str, Any]:
        """``{joint}.pos``: float, and the cameras' shapes."""
        return {**self.action_features, **self._camera_features}

    @property
    def action_features(self) -> dict[str, Any]:
        """``{joint}.pos``: float."""
        return {f"{name}.pos": float for name in self._units.names}

    @property
    def is_connected(self) -> bool:
        """Whether the run is under way and the cameras are connected."""
        return self._follow is not None and all(camera.is_connected for camera in self.cameras.values())

    @property
    def is_calibrated(self) -> bool:
        """Always true: calibration belongs to the driver in MoBeE's file."""
        return True

    def calibrate(self) -> None:
        """Does nothing: see ``mobee calibrate``."""

    def configure(self) -> None:
        """Does nothing: settings are in MoBeE's file."""

    def connect(self, calibrate: bool = True) -> None:
        """Starts the run. The robot does not move before the first action."""
        if self._follow is not None:
            raise DeviceAlreadyConnectedError(f"{self} is already connected.")
        config = self.config
        follow = mobee.Follow(
            config.file,
            robot=config.robot,
            rate=config.fps,
            speed=config.speed,
            clearance=config.clearance_m,
            hold_after=config.hold_after_s,
            max_age=config.max_age_s,
            recover=config.recover,
            clock=config.clock,  # type: ignore[arg-type]
            set=config.set,
            out=config.out,
        )
        try:
            for camera in self.cameras.values():
                camera.connect()
        except BaseException:
            follow.close()
            raise
        self._follow, self._sent, self._seen_at = follow, None, None
        _LOG.info("%s connected: %s", self, follow)

    def _connected(self) -> mobee.Follow:
        if self._follow is None:
            raise DeviceNotConnectedError(f"{self} is not connected.")
        return self._follow

    @property
    def info(self) -> dict[str, Any]:
        """The last action and all of them: see ``mobee.Follow.info``."""
        return self._connected().info

    def get_observation(self) -> dict[str, Any]:
        """The newest reading, at once, and the newest images."""
        view = self._connected().view
        self._seen_at = view.at
        observation = self._units.out(view.q)
        for name, camera in self.cameras.items():
            if getattr(camera, "use_rgb", True):
                observation[name] = camera.read_latest() if hasattr(camera, "read_latest") else camera.async_read()
            if getattr(camera, "use_depth", False):
                observation[f"{name}_depth"] = camera.read_latest_depth()
        return observation

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Sends an action and returns what was really sent; waits for at most 4 ms. Joints that it does not name stay.

        Nothing is sent if it is not free, not finite, or while a motion is rolled back: then the configuration that is held is returned, and
        `info` and the log have the reason.
        """
        follow = self._connected()
        q = self._units.into([action], self._sent if self._sent is not None else follow.view.q)[0]
        self._sent = follow.send(q, seen_at=self._seen_at)
        return self._units.out(self._sent)

    def send_chunk(self, actions: Sequence[dict[str, Any]]) -> mobee.Chunk:
        """Sends the actions of a chunk, one period apart: one transaction, simulated ahead. See ``mobee.Follow.send_chunk``.

        ``chunk.sent`` is in rad or m; `actions_of` has it in the units of actions.
        """
        follow = self._connected()
        q = self._units.into(actions, self._sent if self._sent is not None else follow.view.q)
        chunk = follow.send_chunk(q, seen_at=self._seen_at)
        self._sent = chunk.sent[-1] if len(chunk.sent) else None
        return chunk

    def actions_of(self, q: np.ndarray) -> list[dict[str, Any]]:
        """Configurations (N, dof), rad or m, as actions."""
        return [self._units.out(row) for row in np.atleast_2d(q)]

    def disconnect(self) -> None:
        """Ends the run in order: the robot stops, and goes to its rest pose if MoBeE's file has one."""
        follow = self._connected()
        self._follow = None
        try:
            self.run = follow.close()
        finally:
            for camera in self.cameras.values():
                camera.disconnect()
        _LOG.info("%s disconnected: %s", self, self.run)


class _Units:
    """Configurations, rad or m, and the numbers of LeRobot: each is ``q * scale + offset``."""

    def __init__(
        self,
        names: list[str],
        lower: np.ndarray,
        upper: np.ndarray,
        kinds: list[str],
        grippers: Sequence[str],
        use_degrees: bool,
    ) -> None:
        self.names = names
        self.scale, self.offset = np.ones(len(names)), np.zeros(len(names))
        for j, name in enumerate(names):
            span = max(float(upper[j] - lower[j]), 1e-9)
            if name in grippers:
                self.scale[j], self.offset[j] = 100.0 / span, -100.0 * lower[j] / span
            elif use_degrees:
                self.scale[j] = np.degrees(1.0) if kinds[j] == "rad" else 1000.0
            else:
                self.scale[j], self.offset[j] = 200.0 / span, -200.0 * lower[j] / span - 100.0

    def out(self, q: np.ndarray) -> dict[str, Any]:
        return {f"{name}.pos": float(value) for name, value in zip(self.names, q * self.scale + self.offset)}

    def into(self, actions: Sequence[dict[str, Any]], held: np.ndarray) -> np.ndarray:
        rows = np.empty((len(actions), len(self.names)))
        for row, action in zip(rows, actions):
            given = {key.removesuffix(".pos"): value for key, value in action.items() if key.endswith(".pos")}
            unknown = [name for name in given if name not in self.names]
            if unknown or not given:
                what = f"the robot has no joint {unknown[0]!r}" if unknown else "the action has no joint"
                raise mobee.MobeeError("joints", what, "action", f"give some of {', '.join(f'{name}.pos' for name in self.names)}")
            row[:] = held
            for name, value in given.items():
                j = self.names.index(name)
                row[j] = (float(value) - self.offset[j]) / self.scale[j]
            held = row
        return rows
