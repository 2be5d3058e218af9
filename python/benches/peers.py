"""Poses per second from Python, beside its peers in the same run, and what else the package costs.

    pip install coal pin vamp-planner dist/mobee-*.whl
    python python/benches/peers.py

The arm is a UR5e of boxes and cylinders among boxes: the same URDF and the same pairs for MoBeE and for Pinocchio with coal, whose verdicts are
compared. VAMP brings its own UR5 of spheres, and answers one configuration per call: its figure is for another model. Beside it, as the
bound for all calls from Python: `cargo bench -p mobee-python --bench engine`, which has MoBeE's own `ur5.xml`.
"""

from __future__ import annotations

import importlib
import resource
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import mobee

SECONDS = 0.5
ROUNDS = 3
# name, parent joint: xyz, rpy; shapes of its link: kind, size (box edges; cylinder radius and length), xyz, rpy
HALF = 1.5707963267948966
JOINTS: list[tuple[str, tuple[float, ...], tuple[float, ...], list[tuple[str, tuple[float, ...], tuple[float, ...], tuple[float, ...]]]]] = [
    ("shoulder", (0, 0, 0.1625), (0, 0, 0), [("cylinder", (0.06, 0.16), (0, 0, 0), (0, 0, 0))]),
    ("upper_arm", (0, 0, 0), (HALF, 0, 0), [("cylinder", (0.055, 0.46), (-0.2125, 0, 0.138), (0, HALF, 0))]),
    ("forearm", (-0.425, 0, 0), (0, 0, 0), [("cylinder", (0.045, 0.42), (-0.196, 0, 0.007), (0, HALF, 0))]),
    ("wrist_1", (-0.3922, 0, 0.1333), (0, 0, 0), [("cylinder", (0.04, 0.12), (0, 0, -0.04), (0, 0, 0))]),
    ("wrist_2", (0, -0.0997, 0), (HALF, 0, 0), [("cylinder", (0.04, 0.11), (0, 0, -0.03), (0, 0, 0))]),
    ("wrist_3", (0, 0.0996, 0), (HALF, 2 * HALF, 2 * HALF), [("box", (0.075, 0.075, 0.05), (0, 0, -0.02), (0, 0, 0))]),
]
OBSTACLES = [("floor", (3.0, 3.0, 0.1), (0, 0, -0.1)), ("post", (0.1, 0.1, 1.6), (0.5, 0.3, 0.7)), ("shelf", (0.3, 0.9, 0.04), (-0.6, 0, 0.6))]


def urdf() -> str:
    def pose(xyz: tuple[float, ...], rpy: tuple[float, ...]) -> str:
        return f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'

    def collision(kind: str, size: tuple[float, ...], xyz: tuple[float, ...], rpy: tuple[float, ...]) -> str:
        shape = f'<box size="{size[0]} {size[1]} {size[2]}"/>' if kind == "box" else f'<cylinder radius="{size[0]}" length="{size[1]}"/>'
        return f"<collision>{pose(xyz, rpy)}<geometry>{shape}</geometry></collision>"

    text = ['<robot name="ur5e"><link name="base">', collision("cylinder", (0.075, 0.1), (0, 0, 0.05), (0, 0, 0)), "</link>"]
    parent = "base"
    for name, xyz, rpy, shapes in JOINTS:
        text.append(f'<link name="{name}">' + "".join(collision(*shape) for shape in shapes) + "</link>")
        text.append(f'<joint name="{name}_joint" type="revolute"><parent link="{parent}"/><child link="{name}"/>{pose(xyz, rpy)}')
        text.append('<axis xyz="0 0 1"/><limit lower="-3.1" upper="3.1" velocity="3" effort="100"/></joint>')
        parent = name
    return "".join([*text, "</robot>"])


def srdf() -> str:
    """The same pairs for all: those of neighbors are left out."""
    names = ["base", *(name for name, *_ in JOINTS)]
    pairs = [*zip(names, names[1:]), ("wrist_1", "wrist_3")]
    lines = [f'<disable_collisions link1="{a}" link2="{b}" reason="Adjacent"/>' for a, b in pairs]
    return f'<robot name="ur5e">{"".join(lines)}</robot>'


def rate(count: int, call: Callable[[], object]) -> float:
    """Poses per second of this thread's processor time."""
    call()
    begin, calls = time.thread_time(), 0
    while time.thread_time() - begin < SECONDS:
        call()
        calls += 1
    return calls * count / (time.thread_time() - begin)


def coal_free(folder: Path) -> tuple[Callable[[np.ndarray], bool], Callable[[np.ndarray], bool]]:
    """Pinocchio with coal: pair by pair, and by the broad phase."""
    coal: Any = importlib.import_module("coal")
    pin: Any = importlib.import_module("pinocchio")
    model = pin.buildModelFromUrdf(str(folder / "ur5e.urdf"))
    shapes = pin.buildGeomFromUrdf(model, str(folder / "ur5e.urdf"), pin.GeometryType.COLLISION)
    for name, size, at in OBSTACLES:
        shapes.addGeometryObject(pin.GeometryObject(name, 0, pin.SE3(np.eye(3), np.array(at, float)), coal.Box(*size)))
    shapes.addAllCollisionPairs()
    pin.removeCollisionPairs(model, shapes, str(folder / "ur5e.srdf"))
    base = shapes.getGeometryId("base_0")
    for pair in list(shapes.collisionPairs):
        # what no joint moves is not tested
        if {pair.first, pair.second} <= {base, *(shapes.getGeometryId(name) for name, *_ in OBSTACLES)}:
            shapes.removeCollisionPair(pair)
    data, places = model.createData(), shapes.createData()
    broad = pin.BroadPhaseManager_SSaPCollisionManager(model, shapes, places)
    return (
        lambda q: not pin.computeCollisions(model, data, shapes, places, q, True),
        lambda q: not pin.computeCollisions(model, data, broad, q, True),
    )


def in_a_loop(one: Callable[[np.ndarray], bool], q: np.ndarray) -> Callable[[], object]:
    return lambda: [one(row) for row in q]


def poses(robot: mobee.Robot, scene: mobee.Scene, folder: Path) -> None:
    rng = np.random.default_rng(7)
    q = rng.uniform(robot.lower, robot.upper, (1_000_000, robot.dof))
    peers: dict[str, Callable[[np.ndarray], bool]] = {}
    try:
        peers["pin + coal, listed"], peers["pin + coal, broad"] = coal_free(folder)
        ours = scene.free(q[:20_000])
        theirs = np.array([peers["pin + coal, listed"](row) for row in q[:20_000]])
        print(f"verdicts equal to coal's: {(ours == theirs).sum()} of {len(ours)}; free {ours.mean():.3f}")
    except ImportError as e:
        print(f"without pin and coal: {e}")
    try:
        vamp: Any = importlib.import_module("vamp")
        vamp_ur5 = vamp.ur5
        environment = vamp.Environment()
        for _, size, at in OBSTACLES:
            environment.add_cuboid(vamp.Cuboid(list(at), [0, 0, 0], [edge / 2 for edge in size]))
        peers["vamp.ur5, its own spheres"] = lambda row: bool(vamp_ur5.validate(row, environment))
        peers["vamp.ur5, its own spheres"](q[0])
    except (ImportError, AttributeError, TypeError) as e:
        peers.pop("vamp.ur5, its own spheres", None)
        print(f"without vamp: {type(e).__name__}: {e}")
    print(f"{'N':>9} {'mobee':>12}" + "".join(f"{name:>28}" for name in peers))
    for count in (1, 100, 10_000, 1_000_000):
        batch = q[:count]
        own = q[0] if count == 1 else batch
        figures = [median(lambda: rate(count, lambda: scene.free(own)))]
        # a loop over a million takes as long per pose as one over ten thousand
        some = batch[:10_000]
        figures += [of_peer(one, some) for one in peers.values()]
        print(f"{count:>9} {figures[0]:>10.0f}/s" + "".join(f"{figure:>26.0f}/s" for figure in figures[1:]))


def of_peer(one: Callable[[np.ndarray], bool], q: np.ndarray) -> float:
    return median(lambda: rate(len(q), in_a_loop(one, q)))


def median(measure: Callable[[], float]) -> float:
    return sorted(measure() for _ in range(ROUNDS))[ROUNDS // 2]


def against_engine() -> None:
    """The figures to hold against `cargo bench -p mobee-python --bench engine`."""
    robot = mobee.load(Path(__file__).parents[2] / "configs/robots/ur5.xml")
    scene = mobee.Scene(robot)
    q = np.random.default_rng(7).uniform(robot.lower, robot.upper, (1_000_000, robot.dof))
    for count in (1, 100, 10_000, 1_000_000):
        batch = q[0] if count == 1 else q[:count]
        print(f"{count:>9} {median(lambda: rate(count, lambda: scene.free(batch))):>10.0f}/s  ur5.xml, as bench engine")


def threads(robot: mobee.Robot, scene: mobee.Scene) -> None:
    q = np.random.default_rng(7).uniform(robot.lower, robot.upper, (500_000, robot.dof))
    scene.free(q)

    def wall(count: int) -> float:
        workers = [threading.Thread(target=scene.free, args=(q,)) for _ in range(count)]
        begin = time.perf_counter()
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        return time.perf_counter() - begin

    one, two = median(lambda: wall(1)), median(lambda: wall(2))
    print(f"GIL: a batch in one thread {one:.3f} s, two batches in two threads {two:.3f} s: {2 * one / two:.2f} x the work per second")


def memory(robot: mobee.Robot, scene: mobee.Scene, calls: int = 100_000) -> None:
    q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (64, robot.dof))
    world = mobee.World()

    def some(i: int) -> None:
        row = q[i % 64]
        scene.free(row)
        scene.free(q)
        robot.fk(q, "wrist_3")
        scene.edge(row, q[(i + 1) % 64])
        if i % 10 == 0:
            scene.contacts(row)
            scene.distance(row)
            name = f"ball {i}"
            world.add(name, mobee.Sphere(0.1))
            world.remove(name)
            try:
                scene.free(q[:, :3])
            except mobee.MobeeError:
                pass

    def used_kb() -> int:
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("VmRSS"):
                return int(line.split()[1])
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    for i in range(2000):
        some(i)
    before = used_kb()
    for i in range(calls // 4):
        some(i)
    after = used_kb()
    print(f"memory after {calls} calls: {before} kB before, {after} kB after, {after - before:+} kB")


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "ur5e.urdf").write_text(urdf())
        (folder / "ur5e.srdf").write_text(srdf())
        robot = mobee.load(folder / "ur5e.urdf", srdf=folder / "ur5e.srdf", poses=0, cache=False)
        world = mobee.World()
        for obstacle, size, at in OBSTACLES:
            world.add(obstacle, mobee.Box(size), position=at)
        scene = mobee.Scene(robot, world)
        poses(robot, scene, folder)
        against_engine()
        threads(robot, scene)
        memory(robot, scene)


if __name__ == "__main__":
    main()
