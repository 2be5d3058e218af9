# Signatures of the compiled module. What they mean is in the docstrings (`help(mobee.Scene)`) and in docs/python.md.
# Where one configuration and a batch give results of different types, a list of numbers is one configuration; of an array the
# type does not say which it is, and the result is Any.

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
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
    "Free",
    "Hull",
    "Ik",
    "Mesh",
    "NoPlan",
    "Plan",
    "Robot",
    "Scene",
    "Shape",
    "Sphere",
    "Unproved",
    "World",
    "load",
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
    def remove(self, name: str) -> None: ...
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
        shorten: bool = True,
    ) -> Plan | NoPlan: ...

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
    def __bool__(self) -> Literal[True]: ...

@final
class NoPlan:
    @property
    def code(self) -> str: ...
    @property
    def reason(self) -> str: ...
    def __bool__(self) -> Literal[False]: ...

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
