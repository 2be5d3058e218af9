"""Robot models, kinematics, collision queries and certified edges.

    import mobee

    robot = mobee.load("ur5.urdf")
    scene = mobee.Scene(robot)
    scene.free(robot.home)               # True: nothing touches
    scene.edge(robot.home, robot.upper)  # Free, Blocked(by, at) or Unproved

Units are radians, meters and seconds, as ``float64``; a prismatic joint's position is meters. Poses are 4x4 arrays. Every query takes one
configuration ``(dof,)`` or a batch ``(N, dof)``. Batches release the interpreter's lock, and Ctrl-C ends a call within 0.1 s.

Errors are `MobeeError`; arguments of another type than stated are `TypeError` or
`ValueError`, as everywhere in Python.
"""

from ._error import MobeeError
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
    Robot,
    Scene,
    Shape,
    Sphere,
    Unproved,
    World,
    load,
)

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
    "MobeeError",
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
