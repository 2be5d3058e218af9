"""Robot models, kinematics, collision queries, certified edges, and runs with agents, detectors and drivers in Python.

    import mobee

    robot = mobee.load("ur5.urdf")
    scene = mobee.Scene(robot)
    scene.free(robot.home)               # True: nothing touches
    scene.edge(robot.home, robot.upper)  # Free, Blocked(by, at) or Unproved

    class Wave(mobee.Agent):
        def next(self, last, view):
            return mobee.MoveTo(view.q + 0.1, speed=0.2)

    run = mobee.run("explore.toml", agent=Wave(), seed=1, for_s=60)

    with mobee.Follow("so101.toml", rate=30) as robot:
        sent = robot.send(policy(robot.view.q))

Units are radians, meters and seconds, as ``float64``; a prismatic joint's position is meters. Poses are 4x4 arrays. Every query takes one
configuration ``(dof,)`` or a batch ``(N, dof)``. Batches release the interpreter's lock, and Ctrl-C ends a call within 0.1 s.

Errors are `MobeeError`; arguments of another type than stated are `TypeError` or
`ValueError`, as everywhere in Python.
"""

from ._agent import Agent, Done, MoveTo, Stop, Stream, Wait
from ._driver import Axis, Driver, Sample
from ._error import MobeeError
from ._follow import Chunk, Follow
from ._native import (
    Blocked,
    Box,
    Capsule,
    Contact,
    Cylinder,
    Free,
    Hull,
    Ik,
    Mesh,
    NoPlan,
    Plan,
    Roadmap,
    Robot,
    Scene,
    Shape,
    Sphere,
    Trajectory,
    Unproved,
    View,
    World,
    WorldObject,
    load,
)
from ._run import Event, Journal, MobeeWarning, Run, Verdict, Violation, replay, run
from ._sense import Body, Detector, Frame, Intrinsics, Located, Locator, Region, Sighting
from ._sweep import sweep

__all__ = [
    "Agent",
    "Axis",
    "Blocked",
    "Body",
    "Box",
    "Capsule",
    "Chunk",
    "Contact",
    "Cylinder",
    "Detector",
    "Done",
    "Driver",
    "Event",
    "Follow",
    "Frame",
    "Free",
    "Hull",
    "Ik",
    "Intrinsics",
    "Journal",
    "Located",
    "Locator",
    "Mesh",
    "MobeeError",
    "MobeeWarning",
    "MoveTo",
    "NoPlan",
    "Plan",
    "Region",
    "Roadmap",
    "Robot",
    "Run",
    "Sample",
    "Scene",
    "Shape",
    "Sighting",
    "Sphere",
    "Stop",
    "Stream",
    "Trajectory",
    "Unproved",
    "Verdict",
    "View",
    "Violation",
    "Wait",
    "World",
    "WorldObject",
    "load",
    "replay",
    "run",
    "sweep",
]
