"""LeRobot's followers as drivers of MoBeE. Does not import LeRobot.

    from lerobot.robots.so_follower import SO101Follower, SO101FollowerConfig
    import mobee, mobee.lerobot

    model = mobee.load("configs/robots/so101.xml")
    follower = SO101Follower(SO101FollowerConfig(port="/dev/ttyACM0", id="left", disable_torque_on_disconnect=False))
    mobee.run("so101.toml", agent=MyPolicy(), driver=mobee.lerobot.Guarded(follower, model), clock="real")
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ._driver import Axis, Driver, Sample
from ._error import MobeeError
from ._native import Robot

__all__ = ["Follower", "Guarded"]

# one count of an encoder of 4096 counts, rad
_COUNT = 2.0 * pi / 4095.0


class Follower(Protocol):
    """What `Guarded` uses of LeRobot's ``Robot``."""

    @property
    def is_connected(self) -> bool:
        """Whether it is connected."""
        ...

    @property
    def is_calibrated(self) -> bool:
        """Whether its motors have the calibration of its file."""
        ...

    def connect(self, calibrate: bool = True) -> None:
        """Opens the bus, and configures the motors."""
        ...

    def get_observation(self) -> Any:
        """Positions as ``{"elbow_flex.pos": 12.3, ...}``, beside other values."""
        ...

    def send_action(self, action: dict[str, Any]) -> Any:
        """Sends motors to positions ``{"elbow_flex.pos": 12.3, ...}``."""
        ...

    def disconnect(self) -> None:
        """Closes the bus."""
        ...


class JointUnits:
    """Conversion between LeRobot's numbers and rad or m.

    ===========  =================================================================  ==========================================
    unit         LeRobot's number                                                   joint
    ===========  =================================================================  ==========================================
    degrees      degrees (mm of a joint that slides) from the middle of its range   ``sign * value + offset``
    range        -100 to 100 of its calibrated range                                -100 is the model's lower limit, 100 upper
    percent      0 to 100 of its calibrated range, as LeRobot's grippers            0 is the model's lower limit, 100 upper
    ===========  =================================================================  ==========================================

    Parameters
    ----------
    robot : Robot
        The model.
    unit : "degrees" or "range"
        Of all joints that are not in `percent`.
    percent : sequence of str
        Joints in percent.
    offset : dict from joint to float
        Joint's position at LeRobot's 0, rad or m; only for degrees. Default: 0.
    inverted : sequence of str
        Joints for which greater numbers are smaller positions.
    """

    def __init__(
        self,
        robot: Robot,
        unit: str,
        percent: Sequence[str] = (),
        offset: Mapping[str, float] | None = None,
        inverted: Sequence[str] = (),
    ) -> None:
        if unit not in ("degrees", "range"):
            raise MobeeError("unit", f"there is no unit {unit!r}", "unit", "give degrees or range")
        offset = dict(offset or {})
        names = robot.joint_names
        for place, given in (("percent", percent), ("offset", offset), ("inverted", inverted)):
            for name in [given] if isinstance(given, str) else given:
                if name not in names or isinstance(given, str):
                    raise MobeeError("joints", f"the robot has no joint {name!r}", place, f"give some of {', '.join(names)}")
        scale, zero = np.empty(robot.dof), np.empty(robot.dof)
        for i, (name, angle) in enumerate(zip(names, robot.units, strict=True)):
            lower, upper = float(robot.lower[i]), float(robot.upper[i])
            if name in percent or unit == "range":
                if name in offset:
                    raise MobeeError("unit", f"joint {name!r} has an offset, and no unit of degrees", "offset", "give it for degrees only")
                least, most = (0.0, 100.0) if name in percent else (-100.0, 100.0)
                if name in inverted:
                    least, most = most, least
                scale[i] = (upper - lower) / (most - least)
                zero[i] = lower - least * scale[i]
            else:
                scale[i] = (0.001 if angle == "m" else pi / 180.0) * (-1.0 if name in inverted else 1.0)
                zero[i] = offset.get(name, 0.0)
        if not (np.isfinite(scale).all() and np.isfinite(zero).all()):
            raise MobeeError("not_finite", "an offset or a limit is not finite", "offset", "give finite numbers, rad or m")
        self._scale, self._zero = scale, zero

    def positions(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """From LeRobot's numbers ``(dof,)`` or ``(N, dof)`` to rad or m."""
        return np.asarray(values * self._scale + self._zero)

    def values(self, q: NDArray[np.float64]) -> NDArray[np.float64]:
        """From rad or m to LeRobot's numbers."""
        return np.asarray((q - self._zero) / self._scale)


class Guarded(Driver):
    """A follower of LeRobot as a driver: each motion is checked, and rolled back if it leads into something.

    The follower belongs to the run: nothing else may send it actions meanwhile. It receives actions along a trajectory within the limits of
    speed and acceleration, 50 times per second, each near the one before: its own ``max_relative_target`` is not needed. LeRobot's followers
    switch the torque off for a moment whenever they connect: support the arm, or let it rest.

    Parameters
    ----------
    robot : Follower
        Any object with LeRobot's ``Robot`` protocol, without cameras: they would be waited for in each cycle.
    model : Robot
        The model of the same arm. Its joints have the names of LeRobot's motors, unless `motors` says otherwise.
    unit : "degrees" or "range", optional
        Unit of its positions, see `JointUnits`. Default: by ``robot.config.use_degrees``.
    percent : sequence of str
        Joints in 0 to 100, as LeRobot's grippers.
    motors : dict from joint to str
        Names of motors that differ from those of their joints.
    offset, inverted
        See `JointUnits`.
    max_speed, max_acceleration : float
        Of every joint, rad/s and rad/s^2 (m/s and m/s^2).
    hold_error : float
        By how much a joint may rest beside its target under weight, rad.
    axes : dict from joint to Axis
        Joints that differ from these numbers.
    period : float
        Time between two readings, s.
    releases_torque : bool
        Accepts a follower that switches its torque off at the end: the arm falls, unless it rests by then.

    Raises
    ------
    MobeeError
        code ``lerobot``, ``unit``, ``joints``: the follower does not fit.
    """

    def __init__(
        self,
        robot: Follower,
        model: Robot,
        *,
        unit: Literal["degrees", "range"] | None = None,
        percent: Sequence[str] = ("gripper",),
        motors: Mapping[str, str] | None = None,
        offset: Mapping[str, float] | None = None,
        inverted: Sequence[str] = (),
        max_speed: float = 1.0,
        max_acceleration: float = 7.0,
        hold_error: float = 0.1,
        axes: Mapping[str, Axis] | None = None,
        period: float = 0.02,
        releases_torque: bool = False,
    ) -> None:
        config = getattr(robot, "config", None)
        if getattr(robot, "cameras", None):
            raise MobeeError("lerobot", "the follower has cameras, which each reading waits for", "robot", "configure it without cameras")
        if getattr(config, "disable_torque_on_disconnect", False) and not releases_torque:
            what = "the follower switches its torque off at the end, and the arm falls"
            remedy = "set disable_torque_on_disconnect=False in its configuration, or pass releases_torque=True"
            raise MobeeError("lerobot", what, "robot.config.disable_torque_on_disconnect", remedy)
        self._robot = robot
        self._connects = not robot.is_connected
        self._is_calibrated = self._is_sent = False
        names = list(model.joint_names)
        given = dict(axes or {})
        renamed = dict(motors or {})
        for place, some in (("motors", renamed), ("axes", given)):
            for name in some:
                if name not in names:
                    raise MobeeError("joints", f"the model has no joint {name!r}", place, f"give some of {', '.join(names)}")
        percent = [name for name in percent if name in names] if percent == ("gripper",) else percent
        self._units = JointUnits(model, _unit(unit, config), percent, offset, inverted)
        self._keys = [f"{renamed.get(name, name)}.pos" for name in names]
        _check_features(robot, self._keys)
        self.axes = [
            given.get(name)
            or Axis(name, max_speed, max_acceleration, unit="m" if angle == "m" else "rad", hold_error=hold_error, resolution=_COUNT)
            for name, angle in zip(names, model.units, strict=True)
        ]
        self.period = period
        self.latency = max(0.06, 3.0 * period)
        self.connect_s = 30.0

    def connect(self) -> None:
        """Connects the follower, unless it is connected."""
        if not self._robot.is_connected:
            self._robot.connect(calibrate=False)
        # asked once: a disturbed bus would deny it
        if not (self._is_calibrated or self._robot.is_calibrated):
            raise MobeeError("lerobot", "the follower is not calibrated", "robot", "calibrate it: lerobot-calibrate")
        self._is_calibrated = True

    def read(self) -> Sample | None:
        """The follower's observation; None if its bus does not answer."""
        try:
            seen = self._robot.get_observation()
            held = None if self._is_sent else self._held()
        except ConnectionError:
            if not self._robot.is_connected:
                raise
            return None
        try:
            values = np.array([float(seen[key]) for key in self._keys])
        except (KeyError, TypeError, ValueError) as e:
            what = f"the observation has no number for each joint: {type(e).__name__} {e}"
            raise MobeeError("lerobot", what, "robot.get_observation", f"its keys must be {', '.join(self._keys)}") from None
        return Sample(self._units.positions(values), held=held)

    def _held(self) -> NDArray[np.float64] | None:
        """The goals of motors on a bus of LeRobot, before the first action."""
        sync_read = getattr(getattr(self._robot, "bus", None), "sync_read", None)
        if sync_read is None:
            return None
        goals = sync_read("Goal_Position")
        values = np.array([float(goals[key.removesuffix(".pos")]) for key in self._keys])
        return self._units.positions(values)

    def command(self, targets: NDArray[np.float64]) -> None:
        """An action of the follower."""
        self._is_sent = True
        values = self._units.values(targets)
        self._robot.send_action(dict(zip(self._keys, values.tolist(), strict=True)))

    def close(self) -> None:
        """Disconnects the follower, if it was not connected before."""
        if self._connects and self._robot.is_connected:
            self._robot.disconnect()


def _unit(unit: str | None, config: Any) -> str:
    uses_degrees = getattr(config, "use_degrees", None)
    if uses_degrees is None and unit is None:
        raise MobeeError("unit", "the follower's configuration has no use_degrees", "unit", 'give "degrees" or "range"')
    of_config = None if uses_degrees is None else ("degrees" if uses_degrees else "range")
    if unit is not None and of_config is not None and unit != of_config:
        raise MobeeError("unit", f"the follower has use_degrees={bool(uses_degrees)}", "unit", f'give "{of_config}"')
    return unit or of_config or ""


def _check_features(robot: Any, keys: Sequence[str]) -> None:
    features = getattr(robot, "action_features", None)
    if features is None:
        return
    known = sorted(key for key in features if key.endswith(".pos"))
    if known != sorted(keys):
        what = f"the follower's positions are {', '.join(known)}; the model's are {', '.join(sorted(keys))}"
        raise MobeeError("joints", what, "robot.action_features", "give the follower's model, and `motors` where names differ")
