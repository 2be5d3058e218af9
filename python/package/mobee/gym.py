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
from collections.abc import Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, SupportsFloat

import numpy as np
from numpy.typing import NDArray

try:
    import gymnasium
except ImportError:
    raise ImportError("mobee.gym needs gymnasium: pip install 'mobee[gym]'") from None

from ._agent import MoveTo
from ._error import MobeeError
from ._native import Steps, robots_of
from ._run import _texts

if TYPE_CHECKING:
    from ._native import Robot, View

__all__ = ["Env", "Explore", "Reach", "Task", "make"]

_Array = NDArray[np.float32]
_MOST_FLOAT32 = float(np.finfo(np.float32).max)


class Task:
    """Goal and rewards of an environment: derive your own, and pass it to `make`.

    The observation of an environment is the positions of its joints, scaled so that their limits are -1 and 1, followed by what `observe`
    returns.

    Attributes
    ----------
    size : int
        Length of what `observe` returns.
    """

    size: int = 0

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
        if not 0.0 < float(tolerance) < 100.0:
            raise MobeeError("bounds", f"tolerance is {tolerance}", "tolerance", "give meters, above 0")
        if not 1 <= int(attempts) <= 1_000_000:
            raise MobeeError("bounds", f"attempts is {attempts}", "attempts", "give 1 to 1000000")
        self.frame = frame
        self.tolerance = float(tolerance)
        self.attempts = int(attempts)
        self.goal: NDArray[np.float64] = np.zeros(3)

    def begin(self, env: Env, view: View, rng: np.random.Generator) -> None:
        robot = view.model
        if self.frame is None:
            self.frame = _farthest(robot)
        names = list(view.configurations)
        whole = np.concatenate([view.configurations[name] for name in names])
        first = sum(len(view.configurations[name]) for name in names[: names.index(view.robot)])
        q = np.tile(view.q, (self.attempts, 1))
        q[:, env.columns] = rng.uniform(env.lower, env.upper, (self.attempts, len(env.columns)))
        all_robots = np.tile(whole, (self.attempts, 1))
        all_robots[:, first : first + q.shape[1]] = q
        free = np.flatnonzero(np.asarray(view.scene.free(all_robots)))
        chosen = q[free[0] if len(free) else -1]
        self.goal = robot.fk(np.clip(chosen, robot.lower, robot.upper), self.frame)[:3, 3]

    def _position(self, view: View) -> NDArray[np.float64]:
        robot = view.model
        assert self.frame is not None
        return robot.fk(np.clip(view.q, robot.lower, robot.upper), self.frame)[:3, 3]

    def observe(self, env: Env, view: View) -> NDArray[Any]:
        return np.concatenate([self._position(view), self.goal])

    def reward(self, env: Env, view: View, info: dict[str, Any]) -> tuple[float, bool]:
        distance = float(np.linalg.norm(self._position(view) - self.goal))
        reached = distance < self.tolerance
        info["distance"] = distance
        info["is_success"] = reached
        return (1.0 if reached else 0.0) - distance, reached


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


def _farthest(robot: Robot) -> str:
    frames = robot.frames
    if not frames:
        raise MobeeError("unknown", f"the robot {robot.name} has no frame with a name", "frame", "name a node or a marker in its file")
    return max(frames, key=lambda frame: (round(float(np.linalg.norm(robot.fk(robot.home, frame)[:3, 3])), 9), frame))


def make(config: str | PathLike[str], task: Literal["reach", "explore"] | Task, *, max_steps: int = 100, **options: Any) -> gymnasium.Env[_Array, _Array]:
    """Makes an environment of a configuration file and a task.

    Parameters
    ----------
    config : path
        A configuration as for `mobee.run`; its clock becomes virtual.
    task : "reach", "explore" or Task
        `Reach`, `Explore`, or one of your own.
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
    frame, tolerance, attempts, cell
        Of `Reach` and `Explore`.
    """
    made = _env(config, task, options)
    return gymnasium.wrappers.TimeLimit(made, int(max_steps))


_TASKS: dict[str, type[Reach] | type[Explore]] = {"reach": Reach, "explore": Explore}
_OPTIONS = {"reach": ("frame", "tolerance", "attempts"), "explore": ("cell",)}


def _env(config: str | PathLike[str], task: str | Task, options: dict[str, Any]) -> Env:
    if isinstance(task, str):
        if task not in _TASKS:
            raise MobeeError("unknown", f"there is no task {task!r}", "task", 'give "reach", "explore" or a Task')
        own = {name: options.pop(name) for name in _OPTIONS[task] if name in options}
        task = _TASKS[task](**own)
    return Env(config, task, **options)


def _reach(config: str | PathLike[str], render_mode: None = None, **options: Any) -> Env:
    return _env(config, "reach", options)


def _explore(config: str | PathLike[str], render_mode: None = None, **options: Any) -> Env:
    return _env(config, "explore", options)


for _id, _entry in (("mobee/Reach-v0", _reach), ("mobee/Explore-v0", _explore)):
    if _id not in gymnasium.registry:
        gymnasium.register(_id, entry_point=f"mobee.gym:{_entry.__name__}", max_episode_steps=100)
