"""Random calls with hostile arguments: `python fuzz.py CALLS SEED`. Prints what became of them.

`python fuzz.py agents RUNS SEED`: runs whose agents give hostile answers.
`python fuzz.py drivers CALLS SEED`: drivers with hostile descriptions and readings.
`python fuzz.py senses RUNS SEED`: runs whose detectors and locators give hostile answers.
"""

from __future__ import annotations

import collections
import random
import sys
import tempfile
import threading
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import mobee
import mobee.conformance
from mobee._native import DriverLine, keep_promise, shape_poses, shapes_of

ROBOTS = Path(__file__).parents[2] / "configs/robots"
EXPECTED = (mobee.MobeeError, TypeError, OverflowError)


class Liar(np.ndarray):
    shape = property(lambda self: (6,))
    dtype = property(lambda self: np.dtype("float64"))
    size = 6


class Raises:
    def __array__(self, *args: Any, **kwargs: Any) -> Any:
        raise RuntimeError("never an array")

    def __iter__(self) -> Any:
        raise RuntimeError("never a sequence")

    def __len__(self) -> int:
        raise RuntimeError("no length")

    def __float__(self) -> float:
        raise RuntimeError("no number")

    def __fspath__(self) -> str:
        raise RuntimeError("no path")


class Other:
    def __array__(self, *args: Any, **kwargs: Any) -> Any:
        return "not an array"


def endless() -> Any:
    while True:
        yield 1.0


def misaligned() -> Any:
    return np.frombuffer(b"\0" * 49, dtype=np.uint8)[1:].view(np.float64)


def numbers(rng: random.Random, robot: mobee.Robot) -> Any:
    """What comes where an array is expected."""
    nan = robot.home.copy()
    nan[rng.randrange(len(nan))] = rng.choice([np.nan, np.inf, -np.inf, 1e300, -1e308, 5e-324])
    kinds = ["f2", "f4", ">f8", "i1", "i8", "u8", "bool", "c16", "O", "U3", "S3", "M8[s]", "g"]
    shapes: list[tuple[int, ...]] = [(), (0,), (0, 6), (6, 0), (5,), (7, 6), (2, 3, 6), (1,) * 30]
    choices: list[Any] = [
        lambda: robot.home,
        lambda: np.stack([robot.lower, robot.upper]),
        lambda: list(robot.home),
        lambda: nan,
        lambda: np.stack([nan, robot.home]),
        lambda: np.eye(4),
        lambda: np.zeros(3),
        lambda: np.eye(4) * rng.choice([np.nan, 2.0, -1.0, 0.0]),
        lambda: np.zeros(rng.choice(shapes)),
        lambda: np.broadcast_to(np.zeros(6), (rng.choice([10, 2**40]), 6)),
        lambda: np.zeros((6, 6))[:, ::-1],
        lambda: np.zeros((12, 6))[::-3],
        lambda: np.zeros(6, dtype=rng.choice(kinds)),
        lambda: np.zeros(6, dtype=[("a", "f8")]),
        lambda: np.ma.masked_array(np.zeros(6), mask=np.arange(6) == 0),
        lambda: np.zeros(36).view(Liar),
        lambda: np.matrix(np.zeros(6)),
        misaligned,
        lambda: memoryview(np.zeros(6)),
        lambda: memoryview(np.zeros((3, 6)))[::2],
        lambda: [[0.0] * 6, [0.0] * 5],
        lambda: [None] * 6,
        lambda: ["1"] * 6,
        lambda: [10**400] * 6,
    ]
    return rng.choice(choices)()


def anything(rng: random.Random, others: list[Any]) -> Any:
    """What comes where it is least expected."""
    texts = ["", "tool0", "ee_link", "\0", "\udcff", "x" * 10_000, "/dev/zero", "/", "../..", "no.urdf"]
    scalars: list[Any] = [True, 0, -1, 2**63, 2**200, 1e-3, 1.5, float("nan"), float("inf"), 1j]
    choices: list[Any] = [
        Raises,
        Other,
        endless,
        lambda: rng.choice(others),
        lambda: [rng.choice(others), rng.choice(others)],
        lambda: rng.choice([mobee.Free, mobee.Robot, mobee.Scene, np.ndarray, lambda *a: 1 / 0]),
        lambda: {"q": 1},
        object,
        lambda: None,
        lambda: b"bytes",
        lambda: rng.choice(scalars),
        lambda: rng.choice(texts),
    ]
    return rng.choice(choices)()


def main(calls: int, seed: int) -> None:
    warnings.simplefilter("ignore")
    rng = random.Random(seed)
    robots = [mobee.load(ROBOTS / name) for name in ("ur5.xml", "katana.xml")]
    world = mobee.World()
    world.add("ball", mobee.Sphere(0.1), position=(1, 1, 1))
    scenes = [mobee.Scene(robot, world) for robot in robots]
    maps = [mobee.Roadmap(robot, np.stack([robot.home] * 3), neighbors=2) for robot in robots]
    plans = [mobee.Scene(robot).plan(robot.home, robot.home + 1e-3) for robot in robots]
    outcomes: collections.Counter[str] = collections.Counter()
    for _ in range(calls):
        i = rng.randrange(2)
        robot, scene, roadmap, plan = robots[i], scenes[i], maps[i], plans[i]
        assert isinstance(plan, mobee.Plan)
        others = [robot, scene, world, mobee.Sphere(0.1), robot.home]

        def one(kind: str) -> Any:
            if rng.random() < 0.2:
                return anything(rng, others)
            of_kind: dict[str, Any] = {
                "q": lambda: numbers(rng, robot),
                "frame": lambda: rng.choice([*robot.frames, "nothing"]),
                "robots": lambda: rng.choice([robot, robots, [robot, robot], []]),
                "scene": lambda: rng.choice(scenes),
                "world": lambda: world,
                "shape": lambda: rng.choice([mobee.Box((1, 1, 1)), mobee.Capsule(0.1, 0.0)]),
                "names": lambda: rng.choice([[], robot.joint_names[:2], ["ball"], robot.frames[:2], "ball"]),
                "limit": lambda: rng.choice([1.0, 1e-9, 1e9, one("number"), numbers(rng, robot)]),
                "name": lambda: rng.choice(["ball", "x", "", "\0", "\U0001f916"]),
                "number": lambda: rng.choice([0.1, 1, 0, -1, float("nan"), float("inf"), 1e308, 5e-324]),
                "path": lambda: rng.choice(["no.urdf", "/dev/null", "/dev/zero", "/", "\0", ROBOTS / "ur5.xml"]),
                "triangles": lambda: rng.choice([[[0, 1, 2]], [[0, 1, 2**40]], [[-1, 0, 1]], [], [[0, 1]], [[9, 9, 9]]]),
            }
            return of_kind[kind]()

        pose = dict(pose="q", position="q", quat_xyzw="q", quat_wxyz="q")
        fit = dict(overshoot="number", shapes="number")
        targets: list[tuple[Any, str, dict[str, str]]] = [
            (scene.free, "q", {}),
            (scene.distance, "q", {}),
            (scene.contacts, "q", dict(within="number")),
            (scene.edge, "q q", {}),
            (scene.plan, "q q", dict(seed="number")),
            (shape_poses, "scene q", {}),
            (shapes_of, "scene", {}),
            (robot.fk, "q frame", {}),
            (robot.jacobian, "q frame", {}),
            (robot.ik, "q frame", dict(seed="q", scene="scene", position_tolerance="number", random_seed="number")),
            (robot.ik, "", dict(frame="frame", position="q", quat_xyzw="q", quat_wxyz="q")),
            (mobee.World().add, "name shape", pose),
            (world.move, "name", pose),
            (world.attach, "name frame", dict(touch="names", robot="name", **pose)),
            (world.detach, "name", pose),
            (world.remove, "name", {}),
            (plan.time_parameterize, "", dict(velocity="limit", acceleration="limit", jerk="limit", every="number")),
            (mobee.Roadmap, "robots q", dict(joints="names", neighbors="number")),
            (mobee.Roadmap.load, "path robots", {}),
            (mobee.Roadmap.build, "path", dict(set="names")),
            (roadmap.validate, "scene", dict(progress="name")),
            (roadmap.path, "number number", {}),
            (roadmap.nearest, "q", {}),
            (mobee.World.load, "path", {}),
            (mobee.Scene, "robots", dict(world="world", bases="q", clearance="number")),
            (mobee.load, "path", dict(srdf="path", mesh_dirs="q", part="name", progress="name", **fit)),
            (mobee.Box, "q", {}),
            (mobee.Sphere, "number", {}),
            (mobee.Cylinder, "number number", {}),
            (mobee.Capsule, "number number", {}),
            (mobee.Hull, "q", fit),
            (mobee.Mesh, "q", dict(triangles="triangles", **fit)),
            (mobee.MobeeError, "name name", {}),
            (mobee.Robot, "", {}),
            (mobee.Contact, "", {}),
        ]
        target, positional, keywords = rng.choice(targets)
        arguments = [one(kind) for kind in positional.split()]
        if rng.random() < 0.05:
            arguments = arguments[1:] if rng.random() < 0.5 else [*arguments, None]
        options = {k: one(kind) for k, kind in keywords.items() if rng.random() < 0.3}
        if target == robot.ik:
            options["attempts"] = 3
        if target == scene.plan:
            options["budget"] = 50
        if target == plan.time_parameterize:
            options = {**{name: 1.0 for name in ("velocity", "acceleration", "jerk")}, **options}
        if target == world.remove:
            world.add(f"other {outcomes.total()}", mobee.Sphere(0.1), position=(2, 2, 2))
        try:
            repr(target(*arguments, **options))
            outcomes["answered"] += 1
        except EXPECTED as e:
            str(e)
            outcomes[getattr(e, "code", None) or type(e).__name__] += 1
        except (RuntimeError, ZeroDivisionError, ValueError, UnicodeEncodeError, MemoryError) as e:
            # of the argument's own methods, of Python's conversions of it
            outcomes[f"passed on: {type(e).__name__}"] += 1
    print(f"{calls} calls:", dict(outcomes.most_common()))


class Sly(mobee.MoveTo):
    """Changes while it is read, or refuses to be."""

    def __getattribute__(self, name: str) -> Any:
        if name == "speed":
            raise RuntimeError("not yours")
        return super().__getattribute__(name)


def agents(runs: int, seed: int) -> None:
    warnings.simplefilter("ignore")
    rng = random.Random(seed)
    outcomes: collections.Counter[str] = collections.Counter()

    class Hostile(mobee.Agent):
        def answer(self, view: mobee.View) -> Any:
            robot = view.model
            odd = lambda: anything(rng, [view, robot, self, mobee.Done()])  # noqa: E731
            q = lambda: numbers(rng, robot) if rng.random() < 0.7 else odd()  # noqa: E731
            name = lambda: rng.choice([None, robot.joint_names[:6], [robot.joint_names[0]] * 2, odd()])  # noqa: E731
            return rng.choice(
                [
                    lambda: mobee.MoveTo(q(), speed=rng.choice([0.5, odd()]), joints=name()),
                    lambda: mobee.Stream(q(), q(), name()),
                    lambda: mobee.Stream(position=q(), joints=name()),
                    lambda: mobee.Stream(velocity=q(), joints=name()),
                    lambda: mobee.Stream(velocity=np.full(robot.dof, 0.01)),
                    lambda: mobee.Wait(rng.choice([0.0, 0.1, odd()])),
                    lambda: mobee.Done(odd(), odd()),
                    lambda: Sly(view.q),
                    odd,
                ]
            )()

        def next(self, last: Any, view: mobee.View) -> Any:
            return self.answer(view)

        def revise(self, view: mobee.View) -> Any:
            return mobee.Stream(velocity=np.full(view.model.dof, 0.01)) if rng.random() < 0.8 else self.answer(view)

        def export(self) -> Any:
            return rng.choice([None, 1, [1.5, "x"], {"a": None}, anything(rng, [self])])

        def import_(self, state: Any) -> None:
            if rng.random() < 0.1:
                raise OSError(state)

    file = ROBOTS.parent / "behaviors/explore.toml"
    for i in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            run = mobee.run(file, agent=Hostile(), seed=i, for_s=20, out=folder)
            assert run.check(), run.check().violations
            outcomes[run.summary["reason"]] += 1
            outcomes["deaths"] += len(run.errors)
    print(f"{runs} runs:", dict(outcomes.most_common()))


def senses(runs: int, seed: int) -> None:
    warnings.simplefilter("ignore")
    rng = random.Random(seed)
    outcomes: collections.Counter[str] = collections.Counter()
    bounds: list[Any] = [(0, 0, 5, 5), (5, 5, 0, 0), (np.nan,) * 4, (1e300,) * 4, (-1, -1, 1e9, 1e9), ()]

    def answer(others: list[Any], good: list[Any]) -> Any:
        return rng.choice([[], good, good, good * 3, anything(rng, others), [anything(rng, others)], (x for x in good)])

    class Eye(mobee.Detector):
        def detect(self, frame: mobee.Frame) -> Any:
            odd = lambda value: value if rng.random() < 0.9 else anything(rng, [frame, self])  # noqa: E731
            bound = rng.choice(bounds) if rng.random() < 0.3 else bounds[0]
            pose = rng.choice([None, None, np.eye(4), np.zeros((4, 4)), np.full((4, 4), np.inf)])
            region = mobee.Region(odd("cup"), odd(bound), odd(None), odd(None), odd(1.0), odd(None), pose, odd(np.eye(6)))
            self.takes = odd(0.02)
            return answer([frame, region], [region])

        def export(self) -> Any:
            return rng.choice([None, 1, {"a": None}, anything(rng, [self])])

    class Place(mobee.Locator):
        def locate(self, seen: Any, body: mobee.Body) -> Any:
            odd = lambda value: value if rng.random() < 0.9 else anything(rng, [seen, body])  # noqa: E731
            position = rng.choice([(0, 0, 0), (1e300, 0, 0), (np.nan, 0, 0)])
            return answer([seen, body], [mobee.Located(odd("cup"), odd(position), odd(np.eye(3)))])

    file = ROBOTS.parent / "behaviors/look.toml"
    for i in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            run = mobee.run(file, detectors={"eyes": Eye}, locators={"eyes": Place}, seed=i, for_s=2, out=folder)
            assert run.check(), run.check().violations
            outcomes[run.summary["reason"]] += 1
            outcomes["deaths"] += len(run.errors)
            outcomes["sighted"] += len(run.journal.of("sighted"))
    print(f"{runs} runs:", dict(outcomes.most_common()))


def drivers(calls: int, seed: int) -> None:
    rng = random.Random(seed)
    robot = mobee.load(ROBOTS / "ur5.xml")
    outcomes: collections.Counter[str] = collections.Counter()
    good = [mobee.Axis(name, lower=-1.0, upper=1.0) for name in robot.joint_names]
    # a board under test, whose driver is this thread
    driven = DriverLine("Driven", good, period=0.002, latency=0.04, connect_s=0.1)
    for promise in mobee.conformance.PROMISES[:1]:
        threading.Thread(target=keep_promise, args=(driven, promise), daemon=True).start()

    def axis() -> mobee.Axis:
        odd = lambda value: value if rng.random() < 0.8 else anything(rng, good)  # noqa: E731
        return mobee.Axis(odd("a"), *(odd(1.0) for _ in range(4)), odd("rad"), *(odd(0.1) for _ in range(3)))

    def sample() -> Any:
        q = lambda: numbers(rng, robot) if rng.random() < 0.7 else anything(rng, good)  # noqa: E731
        return mobee.Sample(q(), rng.choice([None, q()]), rng.choice([None, q()])) if rng.random() < 0.9 else anything(rng, good)

    def seconds() -> Any:
        return rng.choice([0.01, 0.01, 0.01, anything(rng, good)])

    calls_of = {
        "describe": lambda: DriverLine(
            "Arm",
            rng.choice([[axis() for _ in range(rng.randrange(4))], anything(rng, good), Sly(good)]),
            period=seconds(),
            latency=seconds(),
            connect_s=seconds(),
        ),
        "reply": lambda: driven.reply(sample()),
        "extreme": lambda: driven.reply(mobee.Sample([rng.choice([0.0, 1e300, -1e308, 5e-324]) for _ in good])),
        "fail": lambda: driven.fail(rng.choice([Raises(), OSError(Raises()), KeyboardInterrupt(), None])),
        "wait": lambda: driven.wait() if rng.random() < 0.1 else None,
    }
    for _ in range(calls):
        kind = rng.choice(list(calls_of))
        try:
            calls_of[kind]()
            outcomes[f"{kind}: fine"] += 1
        except Exception as e:
            outcomes[f"{kind}: {type(e).__name__}"] += 1
    driven.end()
    print(f"{calls} calls:", dict(outcomes.most_common()))


if __name__ == "__main__":
    if sys.argv[1] == "agents":
        agents(int(sys.argv[2]), int(sys.argv[3]))
    elif sys.argv[1] == "senses":
        senses(int(sys.argv[2]), int(sys.argv[3]))
    elif sys.argv[1] == "drivers":
        drivers(int(sys.argv[2]), int(sys.argv[3]))
    else:
        main(int(sys.argv[1]), int(sys.argv[2]))
