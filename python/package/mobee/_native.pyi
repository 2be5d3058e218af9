# Signatures of the compiled module. What they mean is in the docstrings (`help(mobee.Scene)`) and in docs/python.md.
# Where one configuration and a batch give results of different types, a list of numbers is one configuration; of an array the
# type does not say which it is, and the result is Any.

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import disjoint_base

__all__ = [
    "Blocked",
    "Box",
    "Capsule",
    "Contact",
    "Cylinder",
    "DriverLine",
    "Following",
    "Free",
    "Hull",
    "Ik",
    "JournalLines",
    "Mesh",
    "NoPlan",
    "Plan",
    "Roadmap",
    "Robot",
    "Scene",
    "Shape",
    "Sphere",
    "Steps",
    "Trajectory",
    "Unproved",
    "View",
    "World",
    "WorldObject",
    "check_run",
    "conduct",
    "keep_promise",
    "load",
    "promises",
    "robots_of",
    "shape_poses",
    "shapes_of",
]

def load(
    path: str | PathLike[str],
    *,
    srdf: str | PathLike[str] | None = None,
    packages: Mapping[str, str | PathLike[str]] | None = None,
    mesh_dirs: Sequence[str | PathLike[str]] | None = None,
    drop_meshes: bool = False,
    visual: bool = False,
    fix_unsupported: bool = False,
    part: str | None = None,
    overshoot: float = 0.01,
    shapes: int = 12,
    poses: int = 10_000,
    cache: bool = True,
    progress: Callable[[str, float], object] | None = None,
) -> Robot: ...
@final
class Robot:
    @property
    def name(self) -> str: ...
    @property
    def dof(self) -> int: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def units(self) -> list[str]: ...
    @property
    def lower(self) -> NDArray[np.float64]: ...
    @property
    def upper(self) -> NDArray[np.float64]: ...
    @property
    def home(self) -> NDArray[np.float64]: ...
    @property
    def parts(self) -> dict[str, list[str]]: ...
    @property
    def frames(self) -> list[str]: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def warnings(self) -> list[str]: ...
    def fk(self, q: ArrayLike, frame: str) -> NDArray[np.float64]: ...
    def jacobian(self, q: ArrayLike, frame: str) -> NDArray[np.float64]: ...
    def ik(
        self,
        pose: ArrayLike | None = None,
        frame: str | None = None,
        seed: ArrayLike | None = None,
        scene: Scene | None = None,
        *,
        position: ArrayLike | None = None,
        quat_xyzw: ArrayLike | None = None,
        quat_wxyz: ArrayLike | None = None,
        attempts: int = 50,
        solutions: int = 8,
        position_tolerance: float = 1e-4,
        angle_tolerance: float = 1e-3,
        random_seed: int = 0,
    ) -> list[Ik]: ...
    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None: ...

@disjoint_base
class Shape: ...

@final
class Box(Shape):
    def __new__(cls, size: ArrayLike) -> Box: ...

@final
class Sphere(Shape):
    def __new__(cls, radius: float) -> Sphere: ...

@final
class Cylinder(Shape):
    def __new__(cls, radius: float, length: float) -> Cylinder: ...

@final
class Capsule(Shape):
    def __new__(cls, radius: float, length: float) -> Capsule: ...

@final
class Hull(Shape):
    def __new__(cls, points: ArrayLike, *, overshoot: float = 0.01, shapes: int = 12) -> Hull: ...
    @property
    def overshoot(self) -> float: ...

@final
class Mesh(Shape):
    def __new__(
        cls,
        source: str | PathLike[str] | ArrayLike,
        triangles: ArrayLike | None = None,
        *,
        overshoot: float = 0.01,
        shapes: int = 12,
    ) -> Mesh: ...
    @property
    def overshoot(self) -> float: ...

@final
class World:
    def __new__(cls) -> World: ...
    @staticmethod
    def load(path: str | PathLike[str]) -> World: ...
    def add(
        self,
        name: str,
        shape: Shape,
        pose: ArrayLike | None = None,
        *,
        position: ArrayLike | None = None,
        quat_xyzw: ArrayLike | None = None,
        quat_wxyz: ArrayLike | None = None,
    ) -> None: ...
    def move(
        self,
        name: str,
        pose: ArrayLike | None = None,
        *,
        position: ArrayLike | None = None,
        quat_xyzw: ArrayLike | None = None,
        quat_wxyz: ArrayLike | None = None,
    ) -> None: ...
    def attach(
        self,
        name: str,
        link: str,
        pose: ArrayLike | None = None,
        *,
        position: ArrayLike | None = None,
        quat_xyzw: ArrayLike | None = None,
        quat_wxyz: ArrayLike | None = None,
        touch: Sequence[str] = ...,
        robot: str | None = None,
    ) -> None: ...
    def detach(
        self,
        name: str,
        pose: ArrayLike | None = None,
        *,
        position: ArrayLike | None = None,
        quat_xyzw: ArrayLike | None = None,
        quat_wxyz: ArrayLike | None = None,
    ) -> None: ...
    def remove(self, name: str) -> None: ...
    @property
    def attached(self) -> dict[str, str]: ...
    @property
    def names(self) -> list[str]: ...
    @property
    def warnings(self) -> list[str]: ...
    def __len__(self) -> int: ...
    def __contains__(self, key: object, /) -> bool: ...

@final
class Scene:
    def __new__(
        cls,
        robots: Robot | Sequence[Robot],
        world: World | None = None,
        *,
        bases: ArrayLike | Sequence[ArrayLike] | None = None,
        clearance: float = 0.0,
    ) -> Scene: ...
    @property
    def robots(self) -> list[Robot]: ...
    @property
    def dof(self) -> int: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def clearance(self) -> float: ...
    @overload
    def free(self, q: Sequence[float]) -> bool: ...
    @overload
    def free(self, q: ArrayLike) -> Any: ...
    @overload
    def distance(self, q: Sequence[float]) -> float: ...
    @overload
    def distance(self, q: ArrayLike) -> Any: ...
    @overload
    def contacts(self, q: Sequence[float], within: float | None = None) -> list[Contact]: ...
    @overload
    def contacts(self, q: ArrayLike, within: float | None = None) -> list[Any]: ...
    @overload
    def edge(self, q0: Sequence[float], q1: Sequence[float]) -> Free | Blocked | Unproved: ...
    @overload
    def edge(self, q0: ArrayLike, q1: ArrayLike) -> Any: ...

    def plan(
        self,
        start: ArrayLike,
        goal: ArrayLike,
        *,
        seed: int = 0,
        budget: int = 20_000,
        time_limit: float | None = None,
        shorten: bool = True,
        may_touch: Sequence[str] = ...,
        pair_clearances: Mapping[str, float] | None = None,
    ) -> Plan | NoPlan: ...
    def show(
        self,
        q: ArrayLike | None = None,
        path: ArrayLike | Plan | None = None,
        *,
        to: str | PathLike[str] | Any | None = None,
        name: str = "mobee",
    ) -> Any: ...

@final
class Plan:
    @property
    def path(self) -> NDArray[np.float64]: ...
    @property
    def goal(self) -> int: ...
    @property
    def length(self) -> float: ...
    @property
    def evaluations(self) -> int: ...
    def time_parameterize(
        self, *, velocity: ArrayLike, acceleration: ArrayLike, jerk: ArrayLike, every: float = 0.01
    ) -> Trajectory: ...
    def __bool__(self) -> Literal[True]: ...

@final
class Trajectory:
    @property
    def times(self) -> NDArray[np.float64]: ...
    @property
    def q(self) -> NDArray[np.float64]: ...
    @property
    def velocity(self) -> NDArray[np.float64]: ...
    @property
    def acceleration(self) -> NDArray[np.float64]: ...
    @property
    def duration(self) -> float: ...
    def __len__(self) -> int: ...

@final
class NoPlan:
    @property
    def code(self) -> str: ...
    @property
    def reason(self) -> str: ...
    def __bool__(self) -> Literal[False]: ...

@final
class Roadmap:
    def __new__(
        cls, robot: Robot, q: ArrayLike, *, joints: Sequence[str] | None = None, neighbors: int = 8
    ) -> Roadmap: ...
    @staticmethod
    def load(path: str | PathLike[str], robot: Robot) -> Roadmap: ...
    @staticmethod
    def build(
        settings: str | PathLike[str],
        *,
        set: Sequence[str] = ...,
        progress: Callable[[str, float], object] | None = None,
    ) -> Roadmap: ...
    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None: ...
    def validate(self, scene: Scene, *, progress: Callable[[str, float], object] | None = None) -> Roadmap: ...
    def improve(
        self,
        scene: Scene,
        *,
        pairs: int = 3,
        budget: int = 5000,
        grow: int = 0,
        neighbors: int = 8,
        prune: bool = False,
        seed: int = 1,
        progress: Callable[[str, float], object] | None = None,
    ) -> Roadmap: ...
    def path(self, start: int | str, goal: int | str) -> Plan | NoPlan: ...
    def nearest(self, q: ArrayLike) -> NDArray[np.int64]: ...
    @property
    def q(self) -> NDArray[np.float64]: ...
    @property
    def edges(self) -> NDArray[np.int64]: ...
    @property
    def free(self) -> NDArray[np.bool_] | None: ...
    @property
    def clearance(self) -> float | None: ...
    def __len__(self) -> int: ...

@final
class Contact:
    @property
    def a(self) -> str: ...
    @property
    def b(self) -> str: ...
    @property
    def distance(self) -> float: ...
    @property
    def points(self) -> NDArray[np.float64]: ...

@final
class Free:
    def __bool__(self) -> bool: ...

@final
class Blocked:
    @property
    def at(self) -> float: ...
    @property
    def by(self) -> tuple[str, str] | None: ...
    def __bool__(self) -> bool: ...

@final
class Unproved:
    @property
    def at(self) -> float: ...
    def __bool__(self) -> bool: ...

@final
class Ik:
    @property
    def q(self) -> NDArray[np.float64]: ...
    @property
    def position_error(self) -> float: ...
    @property
    def angle_error(self) -> float: ...

@final
class View:
    @property
    def at(self) -> float: ...
    @property
    def robot(self) -> str: ...
    @property
    def seed(self) -> int: ...
    @property
    def q(self) -> NDArray[np.float64]: ...
    @property
    def configurations(self) -> dict[str, NDArray[np.float64]]: ...
    @property
    def joint_names(self) -> list[str]: ...
    @property
    def model(self) -> Robot: ...
    @property
    def contacts(self) -> list[Contact]: ...
    @property
    def clearance(self) -> float: ...
    @property
    def objects(self) -> dict[str, WorldObject]: ...
    @property
    def scene(self) -> Scene: ...

@final
class WorldObject:
    @property
    def name(self) -> str: ...
    @property
    def kind(self) -> Literal["obstacle", "target", "ghost"]: ...
    @property
    def pose(self) -> NDArray[np.float64]: ...
    @property
    def seen_at(self) -> float | None: ...
    @property
    def is_stale(self) -> bool: ...

# For the package itself: `mobee.run`, `mobee.replay`, `mobee.Run`, `mobee.gym`, `mobee.Follow`, `Scene.show`.

def shapes_of(scene: Scene) -> list[tuple[str, Literal["box", "sphere", "cylinder", "capsule"], list[float]]]: ...
def shape_poses(scene: Scene, q: ArrayLike) -> NDArray[np.float64]: ...

def conduct(
    path: PathLike[str],
    agents: dict[str, Any],
    drivers: dict[str, DriverLine],
    detectors: dict[str, Any],
    locators: dict[str, Any],
    *,
    set: list[str],
    out: PathLike[str] | None,
    replay: bool,
) -> tuple[Path, str, bool, list[str], int | None, str | None]: ...
def robots_of(path: PathLike[str], *, set: list[str], replay: bool) -> list[str]: ...
def check_run(
    path: PathLike[str],
) -> tuple[int, str, str | None, list[tuple[str, int, float, str]], list[str], str]: ...
@final
class JournalLines:
    def __new__(cls, path: PathLike[str]) -> JournalLines: ...
    def __iter__(self) -> JournalLines: ...
    def __next__(self) -> tuple[int, float, str]: ...

@final
class DriverLine:
    def __new__(
        cls, class_: str, axes: Sequence[object], *, period: float, latency: float, connect_s: float
    ) -> DriverLine: ...
    def wait(self) -> Literal["connect", "cycle", "again"] | None: ...
    def reply(self, sample: object) -> tuple[NDArray[np.float64] | None, bool]: ...
    def fail(self, error: BaseException) -> None: ...
    def end(self) -> None: ...
    def leave(self) -> None: ...
    def cycles(self) -> tuple[int, int, float, float, float]: ...

def promises() -> list[str]: ...
def keep_promise(line: DriverLine, promise: str) -> tuple[str | None, float]: ...
@final
class Steps:
    def __new__(
        cls, path: PathLike[str], *, set: list[str], out: PathLike[str], robot: str, class_: str
    ) -> Steps: ...
    def view(self) -> View | None: ...
    def warnings(self) -> list[str]: ...
    def folder(self) -> Path | None: ...
    def step(self, answer: object) -> tuple[View | None, dict[str, Any]]: ...
    def close(self) -> Path | None: ...

_Sent = tuple[NDArray[np.float64], Literal["sent", "limited", "held"], str, str, int | None]

@final
class Following:
    def __new__(
        cls,
        path: PathLike[str],
        drivers: dict[str, DriverLine],
        *,
        set: list[str],
        out: PathLike[str] | None,
        robot: str,
        class_: str,
        period: float,
        speed: float,
        hold_after: float,
        clearance: float,
        recover: bool,
    ) -> Following: ...
    @staticmethod
    def joints(
        path: PathLike[str], *, set: list[str], robot: str, class_: str
    ) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64], list[str]]: ...
    def send(self, q: ArrayLike) -> _Sent: ...
    def chunk(self, q: ArrayLike, period: float) -> _Sent: ...
    def pause(self, seconds: float) -> None: ...
    def view(self) -> View | None: ...
    def status(self) -> tuple[str, str | None]: ...
    def account_of(self, id: int) -> dict[str, Any] | None: ...
    def last(self) -> dict[str, Any] | None: ...
    def outcomes(self) -> list[int]: ...
    def cut(self) -> str | None: ...
    def joint_names(self) -> list[str]: ...
    def is_real(self) -> bool: ...
    def warnings(self) -> list[str]: ...
    def finish(self) -> None: ...
    def close(self, patience: float) -> tuple[Path | None, str | None]: ...
