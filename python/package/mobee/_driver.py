from __future__ import annotations

import atexit
import sys
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from ._error import MobeeError
from ._native import DriverLine

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

# a thread of Python that computes gives up the interpreter's lock no later than this, s
_SWITCH_INTERVAL = 0.0005
# a thread whose driver blocks is left alone after this, s
_JOIN_S = 5.0


@dataclass(frozen=True)
class Axis:
    """A motor of a `Driver`, in rad or m.

    Attributes
    ----------
    name : str
        The joint's name in the robot's model.
    max_speed, max_acceleration : float
        Greatest speed (rad/s or m/s) and acceleration, also in braking (rad/s^2 or m/s^2). A lower maximum speed of the model applies.
    lower, upper : float, optional
        Limits; default: those of the model. Limits of the model that are narrower apply.
    unit : "rad" or "m"
        ``m`` for a joint that slides.
    resolution : float
        Smallest difference between its readings: one count of a coarse encoder, or the spread of a noisy one.
    hold_error : float
        By how much the joint may rest beside its target under weight.
    contact_effort : float
        The external torque (N m, or N) in `Sample.external` from which something pushes the joint; 0: it is not watched.
    """

    name: str
    max_speed: float = 1.0
    max_acceleration: float = 4.0
    lower: float | None = None
    upper: float | None = None
    unit: Literal["rad", "m"] = "rad"
    resolution: float = 0.0
    hold_error: float = 0.0
    contact_effort: float = 0.0


@dataclass(frozen=True, eq=False)
class Sample:
    """A reading of all motors.

    Attributes
    ----------
    q : array (dof,)
        Measured positions in the order of `Driver.axes`, rad or m.
    external : array (dof,), optional
        External torques, N m or N, positive in the direction in which they push the joint, without the weight that the arm compensates.
    held : array (dof,), optional
        The positions that the motors hold, rad or m, if the hardware can tell. The first `command` begins there: a motor that rests beside
        its target under weight would sag if its measured position became the target.
    """

    q: ArrayLike
    external: ArrayLike | None = None
    held: ArrayLike | None = None


class Driver:
    """Base of drivers: code that moves and reads the motors of a robot in a run by the wall clock.

    A driver answers, and decides nothing: trajectories, limits, lease, reflex and stop are computed outside of Python. `command` receives
    positions along a trajectory that keeps the limits of `axes`. A cycle (`read` and `command`) that takes longer than 50 ms, or five
    periods, is a lost reading, and the trajectory brakes; after 0.2 s without a reading the board counts as lost, and the robot's filter
    closes. An exception is a fault of the board with the last line of its traceback; the whole traceback is in the journal (``Run.errors``).
    A second later the driver is connected again, and the robot rests until somebody recovers it.

    All methods are called in one thread, which belongs to the driver. While that thread or the whole interpreter is stalled, the motors
    follow their last positions: the hardware must hold these by itself.

    Attributes
    ----------
    axes : sequence of Axis
        The motors: each joint of the robot once, in the order of `read` and `command`.
    period : float
        Time between two readings, s, 0.002 to 0.1.
    latency : float
        Greatest time from `command` to its effect, s. While cycles take longer, no motion begins.
    connect_s : float
        Longest wait for `connect` and the first reading, s.
    """

    axes: Sequence[Axis] = ()
    period: float = 0.01
    latency: float = 0.04
    connect_s: float = 5.0

    def connect(self) -> None:
        """Opens the hardware, and moves nothing. Called before the first `read`, and again after an exception."""

    def read(self) -> Sample | None:
        """Measures all motors. Called once in each period. None: this reading was lost; the arm goes on, for 0.2 s at most."""
        raise NotImplementedError(f"{type(self).__name__} has no method `read`")

    def command(self, targets: NDArray[np.float64]) -> None:
        """Sends the motors to positions near to the last ones, at once.

        Called after `read` in each period while the robot may move; never before the run has found nothing against it.

        Parameters
        ----------
        targets : ndarray (dof,)
            Positions in the order of `axes`, rad or m.
        """
        raise NotImplementedError(f"{type(self).__name__} has no method `command`")

    def stop(self) -> None:
        """Holds the arm where it is, without its targets being renewed. Called at rest when the lease has ended, and after an exception."""

    def close(self) -> None:
        """Closes the hardware. Called once, at the end."""


def start(given: Any, place: str = "driver") -> _Serving:
    """Starts the thread of a driver that was given as an object, or as a class or function that makes one."""
    driver = given() if not isinstance(given, Driver) and callable(given) else given
    if not isinstance(driver, Driver):
        remedy = "give an object of a class that derives from mobee.Driver, or such a class"
        raise MobeeError("type", f"{place} is {type(driver).__name__}", place, remedy)
    kind = type(driver)
    name = f"{kind.__module__}.{kind.__qualname__}"
    line = DriverLine(name, driver.axes, period=driver.period, latency=driver.latency, connect_s=driver.connect_s)
    return _Serving(driver, line)


class _Serving:
    """The thread of a driver."""

    def __init__(self, driver: Driver, line: DriverLine) -> None:
        self.line = line
        self.error: BaseException | None = None
        self._driver = driver
        # the interpreter does not wait for a driver that blocks
        self._thread = threading.Thread(target=self._serve, name="mobee-driver", daemon=True)
        _running.add(self)
        self._thread.start()

    def _serve(self) -> None:
        try:
            while (call := self.line.wait()) is not None:
                try:
                    self._answer(call)
                except BaseException as error:
                    self._fail(error)
        finally:
            self.line.leave()
            try:
                self._driver.close()
            except BaseException as error:
                self.error = self.error or error

    def _answer(self, call: str) -> None:
        if call == "connect":
            self._driver.connect()
        elif call == "cycle":
            targets, stop = self.line.reply(self._driver.read())
            if targets is not None:
                self._driver.command(targets)
            if stop:
                self._driver.stop()

    def _fail(self, error: BaseException) -> None:
        self.error = error
        self.line.fail(error)
        try:
            self._driver.stop()
        except BaseException as second:
            second.__context__ = error

    def end(self) -> None:
        """Brakes the arm, and waits until the driver is closed."""
        self.line.end()

    def join(self) -> None:
        """Waits until the thread has ended; a driver that blocks is left alone."""
        self._thread.join(_JOIN_S)


_running: weakref.WeakSet[_Serving] = weakref.WeakSet()


@atexit.register
def _end_all() -> None:
    # a thread that waits for its line must not do so while the interpreter ends
    for serving in list(_running):
        serving.end()
    for serving in list(_running):
        serving.join()


@contextmanager
def serving(drivers: Mapping[str, Any]) -> Iterator[dict[str, DriverLine]]:
    """Serves drivers by their robots; ends them at the end."""
    started: dict[str, _Serving] = {}
    interval = sys.getswitchinterval()
    try:
        for robot, given in drivers.items():
            if any(given is other for name, other in drivers.items() if name != robot):
                raise MobeeError("twice", f"the driver of {robot} is that of another robot", "driver", "give each robot its own")
            started[robot] = start(given, "driver" if len(drivers) == 1 else f"driver[{robot!r}]")
        if started:
            sys.setswitchinterval(min(interval, _SWITCH_INTERVAL))
        yield {robot: one.line for robot, one in started.items()}
    except MobeeError as error:
        causes = [one.error for one in started.values() if one.error is not None]
        if causes:
            raise error from causes[0]
        raise
    finally:
        for one in started.values():
            one.end()
        for one in started.values():
            one.join()
        if started:
            sys.setswitchinterval(interval)


DriverLike = Driver | type[Driver] | Callable[[], Driver]
