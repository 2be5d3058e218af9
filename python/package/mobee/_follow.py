from __future__ import annotations

import json
import logging
import math
import os
import time
import warnings
import weakref
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._driver import DriverLike, serving
from ._error import MobeeError
from ._native import Following
from ._run import MobeeWarning, Run, _assignments, _only_robot

if TYPE_CHECKING:
    from ._native import Robot, View

_LOG = logging.getLogger("mobee.follow")
_CLOSE_S = 300.0


@dataclass(frozen=True, eq=False)
class Chunk:
    """Set-points that were sent together: a transaction, or a part of one.

    Attributes
    ----------
    sent : ndarray (M, dof)
        The set-points that are followed, one period apart, rad or m: fewer than were given if the way is not free, more if they were too
        fast.
    given : int
        Number of set-points that were given.
    status : "sent", "limited" or "held"
        All are followed as given; some of them, or slower or within the limits; none.
    code : str
        Why it is not "sent", in a word, as of `Follow.info`.
    reason : str
        The same as a sentence.
    id : int or None
        Number of the transaction in the journal. Chunks that are sent while one is under way continue its transaction.
    """

    sent: NDArray[np.float64]
    given: int
    status: Literal["sent", "limited", "held"]
    code: str
    reason: str
    id: int | None
    _follow: Follow

    @property
    def outcome(self) -> str | None:
        """``committed``, ``rolled_back``, ``faulted``, ``refused`` (nothing was sent), or None while its transaction is under way."""
        account = self.account
        return None if account is None else str(account["outcome"])

    @property
    def account(self) -> dict[str, Any] | None:
        """Account of its transaction, as of ``Follow.info["last"]``; None while that is under way."""
        if self.id is None:
            return {"id": None, "outcome": "refused", "cause": None, "contacts": [], "depth": 0.0, "retreat_s": 0.0}
        return self._follow._account(self.id)

    def wait(self, timeout: float = 60.0) -> str | None:
        """Waits for the outcome, by the run's clock.

        Parameters
        ----------
        timeout : float
            Seconds of the run.

        Returns
        -------
        str or None
            The outcome; None if it is still under way.
        """
        for _ in range(math.ceil(timeout * self._follow.rate)):
            if (outcome := self.outcome) is not None:
                return outcome
            self._follow.sleep(1.0 / self._follow.rate)
        return self.outcome


class Follow:
    """A robot that follows set-points from outside, such as those of a learned policy: one line in front of it.

        with mobee.Follow("so101.toml", rate=30) as robot:
            while True:
                q = policy(robot.view.q, camera())
                sent = robot.send(q)

    Each set-point is moved into the limits, shortened to what the motors can do in a period, and simulated ahead: the motion, with the way
    on which the robot would then brake, must be proved free with the controller's margin or braking clearance. In front of an obstacle it
    is shortened. What is not free is not sent, and the robot holds. Behind this acts the controller of the run: what the model does not
    have is noticed by stall or torque, and the last half second of the motion is rolled back. Every motion is a transaction with one
    outcome in the journal.

    If the program stalls, the robot holds; after `hold_after` seconds its transaction ends. No call waits for a rollback: meanwhile
    nothing is sent, and `info` has the reason. After a contact the robot takes set-points again half a second after the rollback.

    By a real clock the run goes on beside the program. In virtual time it goes on by a period with each `send`, and stands otherwise:
    equal set-points give equal runs.

    Parameters
    ----------
    file : path
        A configuration as for `mobee.run`; the agent of the robot is replaced.
    robot : str, optional
        The robot, if there are several; the others have the agents of the file.
    driver : Driver, class or function without arguments that makes one, optional
        In place of the file's driver, such as `mobee.lerobot.Guarded`. Needs ``clock="real"``.
    rate : float
        Set-points per second.
    speed : float
        Share of the joints' greatest speed, above 0 and up to 1.
    hold_after : float
        Age of the last set-point, s, at which the stream ends.
    max_age : float
        Greatest age of an observation, s: see `send`.
    clearance : float
        Distance that is kept beyond that of the controller, m.
    recover : bool
        Frees a robot that holds: failed retreats are repeated, and from a contact it goes where it rested before.
    clock, seed, for_s, set, out, record
        As for `mobee.run`.

    Raises
    ------
    MobeeError
        code ``config``, ``file``, ``robots``, ``bounds``: nothing has moved then; ``not_ready``: the robot takes no motions.
    """

    def __init__(
        self,
        file: str | PathLike[str],
        *,
        robot: str | None = None,
        driver: DriverLike | None = None,
        rate: float = 30.0,
        speed: float = 1.0,
        hold_after: float = 0.5,
        max_age: float = 0.5,
        clearance: float = 0.0,
        recover: bool = True,
        clock: Literal["virtual", "real"] | None = None,
        seed: int | None = None,
        for_s: float | None = None,
        set: Sequence[str] = (),
        out: str | PathLike[str] | None = None,
        record: bool = False,
    ) -> None:
        self.rate = _within("rate", rate, 1.0, 200.0)
        self.max_age = _within("max_age", max_age, 0.0, 1e6)
        path = Path(fspath(file))
        assignments = _assignments(seed, clock, for_s, set, record)
        name = robot if robot is not None else _only_robot(path, assignments, False, "robot", "robot=...")
        speed = _within("speed", speed, 1e-3, 1.0)
        hold_after = _within("hold_after", hold_after, 0.0, 60.0)
        clearance = _within("clearance", clearance, 0.0, 1.0)
        with ExitStack() as served:
            self._native = Following(
                path,
                served.enter_context(serving({} if driver is None else {name: driver})),
                set=assignments,
                out=None if out is None else Path(fspath(out)),
                robot=name,
                class_="mobee.Follow",
                period=1.0 / self.rate,
                speed=speed,
                hold_after=hold_after,
                clearance=clearance,
                recover=bool(recover),
            )
            #: Ends the driver in Python, after the run.
            self._served = served.pop_all()
        # also at garbage collection and at the end of the interpreter
        self._finalizer = weakref.finalize(self, _release, self._native, self._served, os.getpid())
        for note in self._native.warnings():
            warnings.warn(note, MobeeWarning, stacklevel=2)
        #: Names of the joints, in the order of configurations.
        self.joint_names: list[str] = self._native.joint_names()
        #: True if the run has a real clock.
        self.is_real: bool = self._native.is_real()
        self._last: dict[str, Any] = {"status": "held", "code": "waited", "reason": "nothing was sent yet", "id": None}
        self._counts: dict[str, int] = {"sent": 0, "limited": 0, "held": 0}
        self._codes: dict[str, int] = {}
        self._run: Run | None = None
        self._warned = ""

    @staticmethod
    def joints(
        file: str | PathLike[str], *, robot: str | None = None, set: Sequence[str] = ()
    ) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64], list[str]]:
        """Names, lower and upper limits (rad or m) and units (``rad``, ``m``) of the joints, without a run."""
        path, assignments = Path(fspath(file)), _assignments(None, None, None, set, False)
        name = robot if robot is not None else _only_robot(path, assignments, False, "robot", "robot=...")
        return Following.joints(path, set=assignments, robot=name, class_="mobee.Follow")

    def send(self, q: ArrayLike, *, seen_at: float | None = None) -> NDArray[np.float64]:
        """Sends a set-point, to be reached within a period. By a real clock it waits for at most 4 ms, whatever the robot does.

        Parameters
        ----------
        q : array (dof,)
            Configuration, rad or m. Numbers that are not finite are not sent.
        seen_at : float, optional
            Time of the run (``view.at``) of the observation from which `q` was computed: if it is older than `max_age`, nothing is sent.

        Returns
        -------
        ndarray (dof,)
            What was really sent: `q`, or less of it; the configuration that is held if nothing was. `info` has the reason.

        Raises
        ------
        MobeeError
            code ``shape``, ``dtype``; ``over``: the run has ended; ``closed``, ``fork``, ``busy``.
        """
        if seen_at is not None and (held := self._stale(seen_at)) is not None:
            self.sleep(1.0 / self.rate if not self.is_real else 0.0)
            return held
        sent, status, code, reason, number = self._native.send(q)
        self._note(status, code, reason, number)
        return sent

    def send_chunk(self, q: ArrayLike, *, period: float | None = None, seen_at: float | None = None) -> Chunk:
        """Sends set-points, each a period after the one before: one transaction, simulated ahead as a whole.

        It replaces what is left of the chunk before, and continues its transaction if that is under way. What is too fast is followed as
        fast as the motors can, to the last set-point. If the way is not free, the chunk ends in front of the obstacle. Each set-point is
        tested again when it is due: if an object has moved into the way, the robot brakes (``info["cut"]``). In virtual time the clock
        stands: see `sleep`, `Chunk.wait`.

        Parameters
        ----------
        q : array (N, dof)
            Configurations, rad or m.
        period : float, optional
            Seconds; default: ``1 / rate``.
        seen_at : float, optional
            As of `send`.

        Raises
        ------
        MobeeError
            As `send`.
        """
        given = np.shape(q)[0] if np.ndim(q) == 2 else 0
        if seen_at is not None and (held := self._stale(seen_at)) is not None:
            return Chunk(held[:0].reshape(0, len(held)), given, "held", "stale", str(self._last["reason"]), None, self)
        each = 1.0 / self.rate if period is None else _within("period", period, 1e-3, 10.0)
        sent, status, code, reason, number = self._native.chunk(q, each)
        self._note(status, code, reason, number)
        return Chunk(sent, given, status, code, reason, number, self)

    def sleep(self, seconds: float) -> None:
        """Waits by the run's clock: in virtual time the run goes on meanwhile."""
        seconds = _within("seconds", seconds, 0.0, 1e6)
        if self.is_real:
            time.sleep(seconds)
        elif seconds > 0.0:
            self._native.pause(seconds)

    @property
    def view(self) -> View:
        """The newest reading of the robot, its contacts and the objects, at any time and from any thread: see `View`.

        ``view.objects`` is where the model has them; ``view.scene`` answers collision queries.
        """
        view = self._native.view()
        if view is None:
            raise MobeeError("over", "the run is over, or its service is being restarted", None, "see the run's journal")
        return view

    @property
    def robot(self) -> Robot:
        """The model of the robot: limits, frames, kinematics."""
        return self.view.model

    @property
    def info(self) -> dict[str, Any]:
        """The last set-point and all of them, for logs and dashboards.

        ``status``
            ``sent``: as given; ``limited``: less of it; ``held``: nothing.
        ``code``
            Why: ``limits``, ``speed`` (shortened to what the motors can do), ``blocked`` (shortened in front of an obstacle, or not free), ``not_finite``, ``stale``, ``late`` (no reply in time, withdrawn), ``rolling_back``, ``pause`` (half a second of
            silence after a stop), ``holding``, ``not_ready``, or the code of a refusal; empty for ``sent``.
        ``reason``
            The same as a sentence, or empty.
        ``id``
            Number of the transaction in the journal, or None.
        ``robot``, ``hold``
            State of the filter: ``rest``, ``moving``, ``stopping``, ``retreating``, ``settling``, ``holding``, ``escaping``, ``over``; and
            why it holds, or None.
        ``last``
            Account of the last transaction that has ended: ``id``, ``outcome`` (``committed``, ``rolled_back``, ``faulted``),
            ``cause``, ``contacts``, ``depth`` (m), ``retreat_s``; or None.
        ``cut``
            Why the last chunk was ended early, as the way was not free any more; or None.
        ``counts``
            Numbers of calls by status, of their codes, and of outcomes; ``held_share``: the share of calls that sent nothing.
        """
        status, hold = self._native.status()
        committed, rolled_back, faulted = self._native.outcomes()
        calls = max(1, sum(self._counts.values()))
        counts = {
            **self._counts,
            "codes": dict(self._codes),
            "committed": committed,
            "rolled_back": rolled_back,
            "faulted": faulted,
            "held_share": self._counts["held"] / calls,
        }
        return {**self._last, "robot": status, "hold": hold, "last": self._native.last(), "cut": self._native.cut(), "counts": counts}

    def close(self) -> Run | None:
        """Ends the run in order: the robot comes to rest, and goes to its rest pose if the file has one. Once more is no error.

        Returns
        -------
        Run or None
            The run with its journal; None if it did not end in time.
        """
        if self._finalizer.detach() is not None:
            try:
                self._native.finish()
            except MobeeError:
                # the run is over
                pass
            try:
                folder, summary = self._native.close(_CLOSE_S)
            finally:
                self._served.close()
            if folder is not None:
                self._run = Run(folder)
                self._run.summary = json.loads(summary or "{}")
        return self._run

    def __enter__(self) -> Follow:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"Follow({len(self.joint_names)} joints, {self._native.status()[0]})"

    def _account(self, number: int) -> dict[str, Any] | None:
        return self._native.account_of(number)

    def _stale(self, seen_at: float) -> NDArray[np.float64] | None:
        view = self.view
        age = view.at - float(seen_at)
        if age <= self.max_age:
            return None
        self._note("held", "stale", f"the observation is {age:.3f} s old, more than {self.max_age} s", None)
        return view.q

    def _note(self, status: Any, code: str, reason: str, number: int | None) -> None:
        if status == "sent":
            self._warned = ""
        elif (status == "held" or code == "blocked") and reason != self._warned:
            self._warned = reason
            _LOG.warning("%s: %s: %s", status, code, reason)
        self._last = {"status": status, "code": code, "reason": reason, "id": number}
        self._counts[status] += 1
        if code:
            self._codes[code] = self._codes.get(code, 0) + 1


def _release(native: Following, served: ExitStack, pid: int) -> None:
    # a forked child leaves its parent's run alone
    if pid == os.getpid():
        try:
            native.close(_CLOSE_S)
        except MobeeError:
            # another thread is in it, and ends it
            pass
        served.close()


def _within(what: str, given: Any, least: float, most: float) -> float:
    try:
        number = float(given)
    except (TypeError, ValueError):
        raise MobeeError("type", f"{what} is {type(given).__name__}", what, "give a number") from None
    if not least <= number <= most:
        raise MobeeError("bounds", f"{what} is {given!r}", what, f"give a number from {least:g} to {most:g}")
    return number
