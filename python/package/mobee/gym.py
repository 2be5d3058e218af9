"""Environments of gymnasium in which each step is a transaction: a contact is rolled back, and the episode goes on.

    import gymnasium
    import mobee.gym

    env = gymnasium.make("mobee/Reach-v0", config="arm.toml", frame="gripper")
    observation, info = env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    info["outcome"]  # "committed", "rolled_back", "faulted", "refused", "over"

`step` commits one motion and returns at its outcome; the observation is the configuration at which the robot then rests. The run goes on
in virtual time on a thread of its own, and its clock stands between steps: equal seeds and equal actions give equal journals.

A research safety layer for simulated robots here, not a certified one.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, SupportsFloat

import numpy as np
from numpy.typing import NDArray

try:
    import gymnasium
except ImportError:
    raise ImportError("mobee.gym needs gymnasium: pip install 'mobee[gym]'") from None

from ._agent import MoveTo, Wait
from ._error import MobeeError
from ._native import Steps, robots_of
from ._run import _texts

if TYPE_CHECKING:
    from ._native import Robot, View

__all__ = ["Env", "Explore", "Reach", "Task", "Track", "make", "make_vec"]

_Array = NDArray[np.float32]
_MOST_FLOAT32 = float(np.finfo(np.float32).max)
# steps of an episode
_MAX_STEPS = 100
# points of the target's path on an edge
_POINTS_OF_EDGE = 32


class Task:
    """Goal and rewards of an environment: derive your own, and pass it to `make`.

    The observation of an environment is the positions of its joints, scaled so that their limits are -1 and 1, followed by what `observe`
    returns.

    Attributes
    ----------
    size : int
        Length of what `observe` returns.
    period : float
        Least duration of a step, s of the run, to a period of the controller: after a shorter motion the robot rests until then.
    """

    size: int = 0
    period: float = 0.0

    def begin(self, env: Env, view: View, rng: np.random.Generator) -> None:
        """Starts an episode. Take all randomness from `rng`."""

    def observe(self, env: Env, view: View) -> NDArray[Any]:
        """What is observed beside the joints: array (size,) of finite numbers."""
        return np.zeros(self.size)

    def reward(self, env: Env, view: View, info: dict[str, Any]) -> tuple[float, bool]:
        """The reward of a step, and whether it reached the episode's end. `info` is what `step` returns, and may be added to."""
        raise NotImplementedError(f"{type(self).__name__} has no method `reward`")


class Reach(Task):
    """Moves a frame to a position that some free configuration has.

    Observed are position and goal of the frame in the robot's base, m (6 numbers). The reward of a step is the negative distance to the
    goal, m; the episode terminates within the tolerance, which is worth 1 more.

    Parameters
    ----------
    frame : str, optional
        One of the robot's frames; default: the one that is farthest from the base.
    tolerance : float
        Distance at which the goal counts as reached, m.
    attempts : int
        Random configurations of which the first free one makes the goal; if none is free, the last one does.
    """

    size = 6

    def __init__(self, frame: str | None = None, tolerance: float = 0.05, attempts: int = 100) -> None:
        self.frame = frame
        self.tolerance = _between("tolerance", tolerance, 0.0, 100.0, "m")
        self.attempts = _attempts(attempts)
        self.goal: NDArray[np.float64] = np.zeros(3)

    def begin(self, env: Env, view: View, rng: np.random.Generator) -> None:
        if self.frame is None:
            self.frame = _farthest(view.model)
        q = _random(env, view.q, rng, self.attempts)
        free = np.flatnonzero(np.asarray(view.scene.free(_in_scene(view, q))))
        self.goal = _positions(view.model, self.frame, q[free[0] if len(free) else -1])

    def _position(self, view: View) -> NDArray[np.float64]:
        assert self.frame is not None
        return _positions(view.model, self.frame, view.q)

    def observe(self, env: Env, view: View) -> NDArray[Any]:
        return np.concatenate([self._position(view), self.goal])

    def reward(self, env: Env, view: View, info: dict[str, Any]) -> tuple[float, bool]:
        distance = float(np.linalg.norm(self._position(view) - self.goal))
        reached = distance < self.tolerance
        info["distance"] = distance
        info["is_success"] = reached
        return (1.0 if reached else 0.0) - distance, reached


class Track(Task):
    """Follows a moving target with a frame.

    The target moves where the frame can be: along edges between random configurations that are proved free of contact
    (`mobee.Scene.edge`), at a constant speed. It waits 1 s where none of the tried edges is proved. Observed are the positions of
    frame and target in the robot's base, m, and the velocity of the target, m/s (9 numbers). The reward of a step is the negative
    distance at its end, m, and 1 more within the tolerance; ``info["distance"]`` and ``info["on_target"]`` have both. The episode
    never terminates.

    Parameters
    ----------
    frame : str, optional
        One of the robot's frames; default: the one that is farthest from the base.
    tolerance : float
        Distance at which the frame counts as on target, m.
    target_speed : float
        Speed of the target, m/s.
    period : float
        Least duration of a step, s of the run: the target moves on while the robot does not.
    attempts : int
        Random configurations that are tried for the next edge.
    """

    size = 9

    def __init__(
        self, frame: str | None = None, tolerance: float = 0.05, target_speed: float = 0.05, period: float = 0.5, attempts: int = 100
    ) -> None:
        self.frame = frame
        self.tolerance = _between("tolerance", tolerance, 0.0, 100.0, "m")
        self.target_speed = _between("target_speed", target_speed, 0.0, 100.0, "m/s")
        self.period = _between("period", period, 0.0, 100.0, "s")
        self.attempts = _attempts(attempts)
        #: Times of the run at which the target is at `points`, s and m; it moves straight between them.
        self.times: NDArray[np.float64] = np.zeros(1)
        self.points: NDArray[np.float64] = np.zeros((1, 3))

    def begin(self, env: Env, view: View, rng: np.random.Generator) -> None:
        if self.frame is None:
            self.frame = _farthest(view.model)
        self._rng = rng
        self._q = view.q
        self.times = np.array([view.at])
        self.points = _positions(view.model, self.frame, view.q)[None]

    def _extend(self, env: Env, view: View) -> None:
        """Adds an edge to the target's path, or a pause if none is proved."""
        assert self.frame is not None
        candidates = _random(env, self._q, self._rng, self.attempts)
        rows = _in_scene(view, np.vstack([self._q[None], candidates]))
        for i in np.flatnonzero(np.asarray(view.scene.free(rows[1:]))):
            if not view.scene.edge(rows[0], rows[i + 1]):
                continue
            shares = np.linspace(0.0, 1.0, _POINTS_OF_EDGE + 1)[1:, None]
            points = _positions(view.model, self.frame, self._q + shares * (candidates[i] - self._q))
            lengths = np.linalg.norm(np.diff(np.vstack([self.points[-1:], points]), axis=0), axis=1)
            if lengths.sum() > 1e-3:
                self._q = candidates[i]
                times = self.times[-1] + np.cumsum(np.maximum(lengths / self.target_speed, 1e-9))
                self.times, self.points = np.append(self.times, times), np.vstack([self.points, points])
                return
        self.times = np.append(self.times, self.times[-1] + 1.0)
        self.points = np.vstack([self.points, self.points[-1:]])

    def target(self, env: Env, view: View) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Position (m) and velocity (m/s) of the target at the time of a view, in the robot's base."""
        while self.times[-1] <= view.at:
            self._extend(env, view)
        i = max(int(np.searchsorted(self.times, view.at, side="right")) - 1, 0)
        velocity = (self.points[i + 1] - self.points[i]) / (self.times[i + 1] - self.times[i])
        return self.points[i] + velocity * (view.at - self.times[i]), velocity

    def observe(self, env: Env, view: View) -> NDArray[Any]:
        assert self.frame is not None
        return np.concatenate([_positions(view.model, self.frame, view.q), *self.target(env, view)])

    def reward(self, env: Env, view: View, info: dict[str, Any]) -> tuple[float, bool]:
        assert self.frame is not None
        distance = float(np.linalg.norm(_positions(view.model, self.frame, view.q) - self.target(env, view)[0]))
        info["distance"] = distance
        info["on_target"] = distance < self.tolerance
        return (1.0 if info["on_target"] else 0.0) - distance, False


class Explore(Task):
    """Rests at as many different configurations as possible.

    The space of the environment's joints is divided into cells. The reward is 1 for each step that ends at rest in a cell that is new in
    this episode, else 0; ``info["cells"]`` counts them. Nothing is observed beside the joints, and the episode never terminates.

    Parameters
    ----------
    cell : float
        Edge of a cell, as a share of each joint's range.
    """

    size = 0

    def __init__(self, cell: float = 0.1) -> None:
        if not 1e-4 <= float(cell) <= 1.0:
            raise MobeeError("bounds", f"cell is {cell}", "cell", "give a share of the range, 0.0001 to 1")
        self.cell = float(cell)
        self.cells: set[tuple[int, ...]] = set()

    def _cell(self, env: Env, view: View) -> tuple[int, ...]:
        share = (view.q[env.columns] - env.lower) / np.maximum(env.upper - env.lower, 1e-12)
        return tuple(int(i) for i in np.floor(share / self.cell))

    def begin(self, env: Env, view: View, rng: np.random.Generator) -> None:
        self.cells = {self._cell(env, view)}

    def reward(self, env: Env, view: View, info: dict[str, Any]) -> tuple[float, bool]:
        cell = self._cell(env, view)
        new = info["outcome"] == "committed" and cell not in self.cells
        if new:
            self.cells.add(cell)
        info["cells"] = len(self.cells)
        return float(new), False


class Env(gymnasium.Env[_Array, _Array]):
    """One robot of a configuration file, as an environment; made by `make` or ``gymnasium.make``.

    An action is an array (k,) float32 in -1 to 1 for the environment's k joints: a motion by ``action * step`` from where the robot rests,
    cut off at the joint limits. A contact does not end an episode: the motion is rolled back, and the robot rests where it began.

    ``info`` of a step:

    ==============  ===================================================================================================
    ``outcome``     ``committed``: rests at its target; ``rolled_back``: rests where it began; ``faulted``: rests in
                    between and holds; ``refused``: did not move; ``over``: the run has ended
    ``cause``       why not committed, in a word or two (``contact``, ``contact foreseen``, ``stall``, ...); or None
    ``contacts``    pairs of names of the shapes that came too near
    ``depth``       greatest penetration, m; 0 where the controller stopped in time
    ``retreat_s``   duration of the retreat, s of the run
    ``refusal``     code of a refusal, such as ``limits`` or ``holding``; or None
    ``reason``      words for it
    ``at``          time of the run, s
    ==============  ===================================================================================================

    The episode is truncated if the run ends by itself (``outcome`` is ``over``).
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012

    def __init__(
        self,
        config: str | PathLike[str],
        task: Task,
        *,
        robot: str | None = None,
        joints: Sequence[str] | None = None,
        step: float = 0.2,
        speed: float = 0.5,
        set: Sequence[str] = (),
        out: str | PathLike[str] | None = None,
    ) -> None:
        if not isinstance(task, Task):
            raise MobeeError("type", f"task is {type(task).__name__}", "task", "give an object of a class that derives from Task")
        if not 0.0 < float(speed) <= 1.0:
            raise MobeeError("speed", f"speed is {speed}", "speed", "give a share of the greatest speed, above 0 and up to 1")
        if not 0.0 < float(step) <= 100.0:
            raise MobeeError("bounds", f"step is {step}", "step", "give rad or m, above 0")
        self._config = Path(fspath(config))
        self._set = [*_texts("set", set), 'clock="virtual"', "record.enabled=false"]
        self._robot = robot if robot is not None else self._only_robot()
        self._task = task
        self._step = float(step)
        self._speed = float(speed)
        self._out = None if out is None else Path(fspath(out))
        self._scratch = Path(tempfile.mkdtemp(prefix="mobee-gym-")) if out is None else None
        self._episodes = 0
        self._steps: Steps | None = None
        self._closed = False
        self._fresh = False
        # also at garbage collection and at the end of the interpreter
        self._held: list[Steps] = []
        self._finalizer = weakref.finalize(self, _release, self._held, self._scratch, os.getpid())
        try:
            view = self._begin(0)
            self._fresh = True
            model = view.model
            names = list(view.joint_names)
            if joints is None:
                columns = list(range(len(names)))
            else:
                unknown = [name for name in _texts("joints", joints) if name not in names]
                if unknown or not len(joints):
                    what = f"the robot has no joint {unknown[0]!r}" if unknown else "joints is empty"
                    raise MobeeError("joints", what, "joints", f"give some of {', '.join(names[:50])}")
                columns = [names.index(name) for name in joints]
            #: Indices of the environment's joints in the robot's configuration.
            self.columns: list[int] = columns
            #: Names of the environment's joints.
            self.joints: list[str] = [names[i] for i in columns]
            #: Limits of the environment's joints, rad or m.
            self.lower: NDArray[np.float64] = model.lower[columns]
            self.upper: NDArray[np.float64] = model.upper[columns]
        except BaseException:
            self._finalizer()
            raise
        k = len(columns)
        low, high = np.full(k + task.size, -1.0, np.float32), np.full(k + task.size, 1.0, np.float32)
        # measured positions exceed limits by noise
        low[:k], high[:k] = -1.1, 1.1
        low[k:], high[k:] = -_MOST_FLOAT32, _MOST_FLOAT32
        self.observation_space = gymnasium.spaces.Box(low, high, dtype=np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (k,), dtype=np.float32)

    def _only_robot(self) -> str:
        robots = robots_of(self._config, set=self._set, replay=False)
        if len(robots) != 1:
            what = f"the robots of this file are {', '.join(robots) or 'none'}"
            raise MobeeError("robots", what, "robot", "name one: robot=...")
        return robots[0]

    def _begin(self, seed: int) -> View:
        self._end()
        self._episodes += 1
        folder = self._out if self._out is not None else self._scratch
        assert folder is not None
        out = folder / f"episode-{self._episodes}"
        name = f"mobee.gym.{type(self._task).__name__}"
        steps = Steps(self._config, set=[*self._set, f"seed={seed}"], out=out, robot=self._robot, class_=name)
        self._steps = steps
        self._held.append(steps)
        view = steps.view()
        if view is None:
            raise MobeeError("over", "the run ended before its first motion", str(out), "see its journal: mobee.Run(folder).errors")
        return view

    def _end(self) -> None:
        steps, self._steps = self._steps, None
        self._held.clear()
        if steps is not None:
            folder = steps.close()
            if folder is not None and self._scratch is not None:
                shutil.rmtree(folder, ignore_errors=True)

    @property
    def view(self) -> View:
        """The view of the robot at rest: its configuration, contacts, objects, and a scene for collision queries."""
        view = self._running().view()
        if view is None:
            raise MobeeError("over", "the run is over", None, "call reset")
        return view

    def _running(self) -> Steps:
        if self._closed:
            raise MobeeError("closed", "the environment is closed", None, "make another one")
        if self._steps is None:
            raise MobeeError("over", "no episode is under way", None, "call reset")
        return self._steps

    def _observation(self, view: View) -> _Array:
        span = np.maximum(self.upper - self.lower, 1e-12)
        q = np.clip(2.0 * (view.q[self.columns] - self.lower) / span - 1.0, -1.1, 1.1)
        beside = np.asarray(self._task.observe(self, view), dtype=np.float64)
        if beside.shape != (self._task.size,) or not np.isfinite(beside).all():
            what = f"{type(self._task).__name__}.observe returned shape {beside.shape}, or numbers that are not finite"
            raise MobeeError("shape", what, "observe", f"return finite numbers of shape ({self._task.size},)")
        return np.concatenate([q, beside]).astype(np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[_Array, dict[str, Any]]:
        """Starts a new run, at the start configuration of the file. Equal seeds and actions give equal runs.

        Returns
        -------
        observation : ndarray (k + task.size,) float32
        info : dict
            ``at``: time of the run, s; ``folder``: of the run.
        """
        if self._closed:
            raise MobeeError("closed", "the environment is closed", None, "make another one")
        super().reset(seed=seed)
        view = self._begin(int(self.np_random.integers(2**31)))
        self._fresh = False
        self._task.begin(self, view, self.np_random)
        return self._observation(view), {"at": view.at, "episode": self._episodes}

    def step(self, action: _Array) -> tuple[_Array, SupportsFloat, bool, bool, dict[str, Any]]:
        """Commits one motion, and returns at its outcome.

        Parameters
        ----------
        action : array (k,)
            Shares of the largest step of each joint, -1 to 1.

        Raises
        ------
        MobeeError
            code ``shape``, ``dtype``, ``not_finite`` (the action), ``over`` (call reset), ``closed``, ``fork``, ``busy``.
        """
        steps = self._running()
        if self._fresh:
            raise MobeeError("over", "no episode is under way", None, "call reset")
        shares = self._shares(action)
        view = self.view
        self._last = view
        q = view.q[self.columns]
        # a joint that rests beyond its limit by noise may stay there
        target = np.clip(q + self._step * shares, self.lower, self.upper)
        after, info = steps.step(MoveTo(target, speed=self._speed, joints=self.joints))
        left = 0.0 if after is None else self._task.period - (after.at - view.at)
        if left > 0.0:
            after, rested = steps.step(Wait(left))
            if after is None:
                info.update(outcome=rested["outcome"], reason=rested["reason"])
        seen = after if after is not None else view
        info["at"] = seen.at
        if after is None:
            return self._observation(seen), 0.0, False, True, info
        reward, terminated = self._task.reward(self, seen, info)
        return self._observation(seen), float(reward), bool(terminated), False, info

    def _shares(self, action: Any) -> NDArray[np.float64]:
        try:
            given = np.asarray(action)
            if given.dtype.kind not in "fiu":
                raise TypeError(f"dtype {given.dtype}")
            shares = given.astype(np.float64)
        except (TypeError, ValueError) as e:
            raise MobeeError("dtype", f"the action is no array of numbers: {e}", "action", "give float32") from None
        if shares.shape != (len(self.columns),):
            raise MobeeError("shape", f"the action has shape {shares.shape}", "action", f"give ({len(self.columns)},)")
        if not np.isfinite(shares).all():
            raise MobeeError("not_finite", "the action is not finite", "action", "give numbers from -1 to 1")
        return np.clip(shares, -1.0, 1.0)

    def close(self) -> None:
        """Ends the run. Once more is no error; a step after it is."""
        if self._closed:
            return
        self._closed = True
        self._end()
        self._finalizer()

    def __repr__(self) -> str:
        return f"<mobee.gym.Env {type(self._task).__name__} of {self._robot}>"


def _release(held: list[Steps], scratch: Path | None, pid: int) -> None:
    for steps in held:
        try:
            steps.close()
        except MobeeError:
            # another thread is in it, and ends it
            pass
    held.clear()
    # a forked child leaves its parent's files alone
    if scratch is not None and pid == os.getpid():
        shutil.rmtree(scratch, ignore_errors=True)


def _between(what: str, given: Any, above: float, below: float, unit: str) -> float:
    if not above < float(given) < below:
        raise MobeeError("bounds", f"{what} is {given}", what, f"give {unit}, above {above:g} and below {below:g}")
    return float(given)


def _attempts(given: Any) -> int:
    if not 1 <= int(given) <= 1_000_000:
        raise MobeeError("bounds", f"attempts is {given}", "attempts", "give 1 to 1000000")
    return int(given)


def _random(env: Env, q: NDArray[np.float64], rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Configurations (count, dof) of the robot, in which the environment's joints are random."""
    rows = np.tile(q, (count, 1))
    rows[:, env.columns] = rng.uniform(env.lower, env.upper, (count, len(env.columns)))
    return rows


def _in_scene(view: View, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Configurations of the robot as those of the whole scene, with the other robots where they are. Measured positions exceed
    limits by noise: beyond a limit nothing is free."""
    names = list(view.configurations)
    first = sum(len(view.configurations[name]) for name in names[: names.index(view.robot)])
    rows: NDArray[np.float64] = np.tile(np.concatenate([view.configurations[name] for name in names]), (len(q), 1))
    rows[:, first : first + q.shape[1]] = q
    robots = view.scene.robots
    return np.clip(rows, np.concatenate([robot.lower for robot in robots]), np.concatenate([robot.upper for robot in robots]))


def _positions(robot: Robot, frame: str, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Positions of a frame in the robot's base, m. A measured position exceeds a limit by noise."""
    positions: NDArray[np.float64] = robot.fk(np.clip(q, robot.lower, robot.upper), frame)[..., :3, 3]
    return positions


def _farthest(robot: Robot) -> str:
    frames = robot.frames
    if not frames:
        raise MobeeError("unknown", f"the robot {robot.name} has no frame with a name", "frame", "name a node or a marker in its file")
    return max(frames, key=lambda frame: (round(float(np.linalg.norm(robot.fk(robot.home, frame)[:3, 3])), 9), frame))


def make(
    config: str | PathLike[str], task: Literal["reach", "track", "explore"] | Task, *, max_steps: int = 100, **options: Any
) -> gymnasium.Env[_Array, _Array]:
    """Makes an environment of a configuration file and a task.

    Parameters
    ----------
    config : path
        A configuration as for `mobee.run`; its clock becomes virtual.
    task : "reach", "track", "explore" or Task
        `Reach`, `Track`, `Explore`, or one of your own.
    max_steps : int
        Steps after which an episode is truncated.
    robot : str, optional
        The robot, if there are several; the others have the agents of the file.
    joints : sequence of str, optional
        The joints that are moved; default: all.
    step : float
        Largest motion of a joint in a step, rad or m.
    speed : float
        Share of the joints' greatest speed.
    set : sequence of str
        Assignments as of ``mobee run --set``.
    out : path, optional
        Folder in which the run of each episode is kept; default: none is.
    frame, tolerance, target_speed, period, attempts, cell
        Of `Reach`, `Track` and `Explore`.
    """
    made = _env(config, task, options)
    return gymnasium.wrappers.TimeLimit(made, int(max_steps))


def make_vec(
    config: str | PathLike[str],
    task: Literal["reach", "track", "explore"] | Callable[[], Task],
    num_envs: int,
    *,
    max_steps: int = 100,
    autoreset_mode: gymnasium.vector.AutoresetMode | str = gymnasium.vector.AutoresetMode.NEXT_STEP,
    out: str | PathLike[str] | None = None,
    **options: Any,
) -> gymnasium.vector.VectorEnv[_Array, _Array, _Array]:
    """Makes several environments that step at the same time, each in a thread of its own and without the interpreter's lock.

    ``gymnasium.make_vec("mobee/Reach-v0", num_envs=4, config=...)`` makes the same.

    Parameters
    ----------
    task : "reach", "track", "explore", or a class or function without arguments that makes a Task
        Each environment has a task of its own.
    num_envs : int
        Number of environments, 1 to 1024.
    autoreset_mode : gymnasium.vector.AutoresetMode
        When an environment whose episode is over is reset: as of ``gymnasium.vector.SyncVectorEnv``.
    out : path, optional
        Folder in which the runs are kept, in a folder for each environment.
    max_steps, options
        As of `make`.
    """
    if not isinstance(num_envs, int) or not 1 <= num_envs <= 1024:
        raise MobeeError("bounds", f"num_envs is {num_envs!r}", "num_envs", "give 1 to 1024")
    if not isinstance(task, str) and not callable(task):
        raise MobeeError("type", f"task is {type(task).__name__}", "task", "give a name, or a class or function that makes a Task")

    def one(i: int) -> Callable[[], gymnasium.Env[_Array, _Array]]:
        folder = None if out is None else Path(fspath(out)) / f"env-{i}"
        return lambda: make(config, task if isinstance(task, str) else task(), max_steps=max_steps, out=folder, **options)

    from ._threads import ThreadVectorEnv

    return ThreadVectorEnv([one(i) for i in range(num_envs)], autoreset_mode)


_TASKS: dict[str, type[Reach] | type[Track] | type[Explore]] = {"reach": Reach, "track": Track, "explore": Explore}
_OPTIONS = {
    "reach": ("frame", "tolerance", "attempts"),
    "track": ("frame", "tolerance", "target_speed", "period", "attempts"),
    "explore": ("cell",),
}


def _env(config: str | PathLike[str], task: str | Task, options: dict[str, Any]) -> Env:
    if isinstance(task, str):
        if task not in _TASKS:
            raise MobeeError("unknown", f"there is no task {task!r}", "task", 'give "reach", "track", "explore" or a Task')
        own = {name: options.pop(name) for name in _OPTIONS[task] if name in options}
        task = _TASKS[task](**own)
    return Env(config, task, **options)


def _reach(config: str | PathLike[str], render_mode: None = None, **options: Any) -> Env:
    return _env(config, "reach", options)


def _track(config: str | PathLike[str], render_mode: None = None, **options: Any) -> Env:
    return _env(config, "track", options)


def _explore(config: str | PathLike[str], render_mode: None = None, **options: Any) -> Env:
    return _env(config, "explore", options)


def _vec(task: Any) -> Callable[..., gymnasium.vector.VectorEnv[_Array, _Array, _Array]]:
    def entry(num_envs: int, config: str | PathLike[str], max_episode_steps: int | None = None, **options: Any) -> Any:
        options.pop("render_mode", None)
        return make_vec(config, task, num_envs, max_steps=max_episode_steps or _MAX_STEPS, **options)

    return entry


for _id, _entry, _name in (
    ("mobee/Reach-v0", _reach, "reach"),
    ("mobee/Track-v0", _track, "track"),
    ("mobee/Explore-v0", _explore, "explore"),
):
    if _id not in gymnasium.registry:
        entry = f"mobee.gym:{_entry.__name__}"
        gymnasium.register(_id, entry_point=entry, vector_entry_point=_vec(_name), max_episode_steps=_MAX_STEPS)
