from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Literal

from ._agent import Agent
from ._driver import Driver, DriverLike, serving
from ._error import MobeeError
from ._native import JournalLines, check_run, conduct, robots_of
from ._sense import Detector, Locator

# 1 mm of a joint that slides counts as 1 degree of its encoder
_ENCODER_PER_M = 1000.0 * 0.017453292519943295
_TRACEBACK = "Traceback (most recent call last)"
_POSES = ("q", "target", "safe")


class MobeeWarning(UserWarning):
    """A warning about a configuration, or the death of an agent."""


@dataclass(frozen=True)
class Event:
    """An event of a run's journal.

    Attributes
    ----------
    n : int
        Its number, from 0.
    at : float
        Time of the run, s.
    kind : str
        ``started``, ``commit``, ``outcome``, ``contact_began``, ``died`` and so on: docs/journal.md of the repository.
    robot : str or None
        The robot that it concerns.
    fields : dict
        All else. Whole configurations (``q``, ``target``, ``safe``) are rad or m; other values as in the journal.
    """

    n: int
    at: float
    kind: str
    robot: str | None
    fields: dict[str, Any]

    def __getitem__(self, name: str) -> Any:
        return self.fields[name]

    def get(self, name: str, default: Any = None) -> Any:
        """A field, or a default."""
        return self.fields.get(name, default)


class Journal(Sequence[Event]):
    """The events of a run, read from its folder when they are first asked for. The chain of hashes is checked as they are read.

    Iterate over it, index it, or take `table`.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._events: list[Event] | None = None

    def _all(self) -> list[Event]:
        if self._events is None:
            sliding: dict[str, list[int]] = {}
            self._events = [_event(n, at, text, sliding) for n, at, text in JournalLines(self._folder)]
        return self._events

    def __len__(self) -> int:
        return len(self._all())

    def __getitem__(self, index: Any) -> Any:
        return self._all()[index]

    def __iter__(self) -> Iterator[Event]:
        return iter(self._all())

    def of(self, *kinds: str) -> list[Event]:
        """The events of some kinds, in order."""
        return [event for event in self._all() if event.kind in kinds]

    def table(self, kind: str | None = None) -> dict[str, list[Any]]:
        """Columns of equal length, as ``pandas.DataFrame`` takes them.

        Parameters
        ----------
        kind : str, optional
            Only events of this kind, with a column for each of their fields; default: all events, with the columns ``n``, ``at`` (s),
            ``kind`` and ``robot``.
        """
        events = self._all() if kind is None else self.of(kind)
        columns: dict[str, list[Any]] = {
            "n": [event.n for event in events],
            "at": [event.at for event in events],
            "kind": [event.kind for event in events],
            "robot": [event.robot for event in events],
        }
        if kind is not None:
            for name in dict.fromkeys(name for event in events for name in event.fields):
                columns.setdefault(name, [event.fields.get(name) for event in events])
        return columns

    def __repr__(self) -> str:
        return f"Journal({str(self._folder)!r})"


def _event(n: int, at: float, text: str, sliding: dict[str, list[int]]) -> Event:
    fields: dict[str, Any] = json.loads(text)
    kind = fields.pop("event")
    robot = fields.pop("robot", None)
    if kind == "robot" and fields.get("sliding"):
        sliding[robot] = fields["sliding"]
    for name in _POSES:
        pose = fields.get(name)
        if robot in sliding and isinstance(pose, list) and pose and isinstance(pose[0], (int, float)):
            for joint in sliding[robot]:
                pose[joint] /= _ENCODER_PER_M
    return Event(n, at, kind, robot, fields)


@dataclass(frozen=True)
class Violation:
    """A broken invariant: its name, the line of the journal, the time of the run (s), and what happened."""

    invariant: str
    line: int
    at: float
    text: str


@dataclass(frozen=True)
class Verdict:
    """What `Run.check` found. True in a condition if all invariants hold and nothing is damaged.

    Attributes
    ----------
    events : int
        Events of the journal, whose chain of hashes is intact.
    hash : str
        Hash of the last one: equal runs have equal hashes.
    ended : str or None
        Why the run ended; None if it did not end in order.
    violations : list of Violation
    damage : list of str
        Files that are not as they were when the run ended.
    judged : str
        The invariants that were judged.
    """

    events: int
    hash: str
    ended: str | None
    violations: list[Violation]
    damage: list[str]
    judged: str

    def __bool__(self) -> bool:
        return not self.violations and not self.damage


class Run:
    """A run that has ended: its folder and what is in it.

    `Run(folder)` opens any run's folder, such as one of ``mobee run``.

    Attributes
    ----------
    folder : Path
        The run's folder.
    summary : dict
        Reason of the end, durations, counters, hash of the journal; as ``mobee run --json``.
    journal : Journal
        The events.
    warnings : list of str
        Warnings about the configuration.
    equal : int or None
        Of a replay: the number of events that equal those of the journal; None if one differs.
    difference : str or None
        Of a replay: the first difference.
    """

    folder: Path
    summary: dict[str, Any]
    journal: Journal
    warnings: list[str]
    equal: int | None
    difference: str | None

    def __init__(self, folder: str | PathLike[str]) -> None:
        self.folder = Path(folder)
        path = self.folder / "summary.json"
        try:
            self.summary = json.loads(path.read_text()) if path.is_file() else {}
        except (OSError, ValueError) as e:
            raise MobeeError("file", f"the summary can't be read: {e}", str(path), "give a run's folder") from None
        self.journal = Journal(self.folder)
        self.warnings = []
        self.equal = None
        self.difference = None

    @property
    def ok(self) -> bool:
        """Whether the run ended in order: all agents done, its time over, or stopped."""
        return self.summary.get("reason") in ("done", "time", "interrupted")

    @property
    def hash(self) -> str | None:
        """Hash of the whole journal; None if it is not whole on the disk."""
        value = self.summary.get("journal_hash")
        return value if isinstance(value, str) else None

    @property
    def recording(self) -> Path | None:
        """The recording for the Rerun viewer; None unless the run was recorded."""
        return next(iter(sorted(self.folder.glob("*.rrd"))), None)

    @property
    def errors(self) -> list[str]:
        """Tracebacks of agents that died and of drivers that failed, and the reasons of other actors' deaths, in order."""
        died = [(event.n, str(event["reason"])) for event in self.journal.of("died")]
        failed = [(event.n, str(event["text"])) for event in self.journal.of("warning") if _TRACEBACK in str(event["text"])]
        return [text for _, text in sorted(died + failed)]

    def check(self) -> Verdict:
        """Checks the journal's hashes and the invariants, as ``mobee check``."""
        events, last, ended, violations, damage, judged = check_run(self.folder)
        return Verdict(events, last, ended, [Violation(*v) for v in violations], damage, judged)

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r}, {self.summary.get('reason')})"


_AgentLike = Agent | type[Agent] | Callable[[], Agent]


def run(
    file: str | PathLike[str],
    *,
    agent: Agent | type[Agent] | Callable[[], Agent] | None = None,
    agents: Mapping[str, Agent | type[Agent] | Callable[[], Agent]] | None = None,
    driver: Driver
    | type[Driver]
    | Callable[[], Driver]
    | Mapping[str, Driver | type[Driver] | Callable[[], Driver]]
    | None = None,
    detectors: Mapping[str, Detector | type[Detector] | Callable[[], Detector]] | None = None,
    locators: Mapping[str, Locator | type[Locator] | Callable[[], Locator]] | None = None,
    seed: int | None = None,
    clock: Literal["virtual", "real"] | None = None,
    for_s: float | None = None,
    set: Sequence[str] = (),
    out: str | PathLike[str] | None = None,
    record: bool = False,
) -> Run:
    """Runs a configuration file to its end, as ``mobee run``.

    Parameters
    ----------
    file : path
        A configuration, such as ``configs/behaviors/explore.toml`` of the repository.
    agent : Agent, or class or function without arguments that makes one
        In place of the file's agent, if the file has one robot. Of a class or a function each life after a death is a new object; an
        object is called again.
    agents : dict from robot to agent
        The same for several robots. Robots that are not named have the agents of the file.
    driver : Driver, class or function without arguments that makes one, or dict from robot to these
        In place of the file's driver. Needs ``clock="real"``.
    detectors : dict from camera to Detector, class or function without arguments that makes one
        In place of the file's detectors. A camera is named ``sensor/camera``; the name of a sensor stands for all its cameras. A class or
        a function makes one for each camera and life; an object serves all cameras that it is given for.
    locators : dict from sensor to Locator, class or function without arguments that makes one
        In place of the file's locators.
    seed : int, optional
        Seed of all randomness; ``view.seed`` follows from it.
    clock : "virtual" or "real", optional
        Virtual time is as fast as the machine allows, and equal for equal seeds and equal code. Default: the file's.
    for_s : float, optional
        Ends the run after this time, s.
    set : sequence of str
        Assignments as of ``mobee run --set``: ``"robot.icub.controller.margin_mm=20"``.
    out : path, optional
        The run's folder, new or empty; default: ``runs/NAME-TIME``.
    record : bool
        Make a recording for the Rerun viewer.

    Returns
    -------
    Run
        Also if the robot's agent died for good: see ``Run.ok``, ``Run.errors``.

    Raises
    ------
    MobeeError
        code ``config``, ``file``, ``run``, ``type``, ``unknown`` (a camera or sensor); nothing has moved then.
    KeyboardInterrupt
        After Ctrl-C, once the robots rest and the journal is closed; a second Ctrl-C stops them at once. Its ``run_folder`` is the
        folder, for ``Run``.
    """
    assignments = _assignments(seed, clock, for_s, set, record)
    senses = (dict(detectors or {}), dict(locators or {}))
    return _conduct(Path(fspath(file)), agent, agents, driver, senses, assignments, out, replay=False)


def _assignments(seed: Any, clock: Any, for_s: Any, set: Sequence[str], record: bool) -> list[str]:
    assignments = list(_texts("set", set))
    if seed is not None:
        assignments.append(f"seed={_number('seed', seed, int)}")
    if clock is not None:
        if clock not in ("virtual", "real"):
            raise MobeeError("clock", f"clock is {clock!r}", "clock", 'give "virtual" or "real"')
        assignments.append(f'clock="{clock}"')
    if for_s is not None:
        assignments.append(f"for_s={float(_number('for_s', for_s, float))!r}")
    assignments.append(f"record.enabled={'true' if record else 'false'}")
    return assignments


def replay(
    folder: str | PathLike[str],
    *,
    agent: Agent | type[Agent] | Callable[[], Agent] | None = None,
    agents: Mapping[str, Agent | type[Agent] | Callable[[], Agent]] | None = None,
    detectors: Mapping[str, Detector | type[Detector] | Callable[[], Detector]] | None = None,
    locators: Mapping[str, Locator | type[Locator] | Callable[[], Locator]] | None = None,
    out: str | PathLike[str] | None = None,
) -> Run:
    """Runs a recorded run in virtual time again, and compares every event, as ``mobee replay``.

    Parameters
    ----------
    folder : path
        The run's folder.
    agent, agents, detectors, locators
        The parts in Python that the run had: the same code.
    out : path, optional
        Folder of the new run; default: ``runs/NAME-replay-TIME``.

    Returns
    -------
    Run
        ``equal`` is the number of equal events; ``difference`` the first difference, if there is one.
    """
    senses = (dict(detectors or {}), dict(locators or {}))
    return _conduct(Path(fspath(folder)), agent, agents, None, senses, [], out, replay=True)


def _conduct(
    path: Path,
    agent: _AgentLike | None,
    agents: Mapping[str, _AgentLike] | None,
    driver: DriverLike | Mapping[str, DriverLike] | None,
    senses: tuple[dict[str, Any], dict[str, Any]],
    assignments: list[str],
    out: str | PathLike[str] | None,
    replay: bool,
) -> Run:
    given: dict[str, Any] = dict(agents) if agents is not None else {}
    if agent is not None:
        if agents is not None:
            raise MobeeError("twice", "both agent and agents are given", "agent", "give one of the two")
        given = {_only_robot(path, assignments, replay, "agent", "agents={...}"): agent}
    drivers: dict[str, Any] = {}
    if isinstance(driver, Mapping):
        drivers = dict(zip(_texts("driver", driver), driver.values(), strict=True))
    elif driver is not None:
        drivers = {_only_robot(path, assignments, replay, "driver", "driver={...}"): driver}
    folder_of_run = None if out is None else Path(fspath(out))
    with serving(drivers) as lines:
        parts = conduct(path, given, lines, *senses, set=assignments, out=folder_of_run, replay=replay)
    folder, summary, _, notes, equal, difference = parts
    done = Run(folder)
    done.summary, done.warnings, done.equal, done.difference = json.loads(summary), notes, equal, difference
    for note in notes:
        warnings.warn(note, MobeeWarning, stacklevel=3)
    for event in done.journal.of("warning") if drivers else []:
        if _TRACEBACK in (text := str(event["text"])):
            warnings.warn(f"a driver failed at {event.at:.3f} s: {_last(text)} (its traceback: Run.errors)", MobeeWarning, stacklevel=3)
    agents_here = {f"{robot}/agent" for robot in given}
    senses_here = tuple(f"{key}/" for key in (*senses[0], *senses[1]))
    if agents_here or senses_here:
        for event in done.journal.of("died"):
            actor = str(event["actor"])
            if actor in agents_here or (actor.startswith(senses_here) and actor.endswith(("/detector", "/locator"))):
                last = _last(str(event["reason"]))
                text = f"{event['actor']} died at {event.at:.3f} s: {last} (its traceback: Run.errors)"
                warnings.warn(text, MobeeWarning, stacklevel=3)
    return done


def _last(reason: str) -> str:
    """The line of a traceback that has the exception."""
    lines = [line for line in reason.splitlines() if line and not line.startswith(" ")]
    return lines[-1] if lines else reason


def _only_robot(path: Path, assignments: list[str], replay: bool, what: str, remedy: str) -> str:
    robots = robots_of(path, set=assignments, replay=replay)
    if len(robots) != 1:
        names = ", ".join(robots) or "none"
        raise MobeeError("robots", f"the robots of this file are {names}", what, f"name the robot: {remedy}")
    return robots[0]


def _texts(what: str, given: Any) -> Sequence[str]:
    if isinstance(given, (str, bytes)) or not all(isinstance(text, str) for text in given):
        raise MobeeError("type", f"{what} is no list of strings", what, 'give ["key=value", ...]')
    return [str(text) for text in given]


def _number(what: str, given: Any, kind: type) -> Any:
    try:
        number = kind(given)
    except (TypeError, ValueError, OverflowError):
        raise MobeeError("type", f"{what} is {type(given).__name__}", what, f"give {kind.__name__}") from None
    if number != given or number < 0 or number >= 2**63:
        raise MobeeError("bounds", f"{what} is {given!r}", what, "give a number that is not negative") from None
    return number
