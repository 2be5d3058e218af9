"""Conversion of a MoBeE scene to Pinocchio and coal."""

import json

import coal
import numpy as np
import pinocchio as pin

# The axis of round shapes is y in MoBeE, z in coal.
UPRIGHT = pin.SE3(pin.utils.rotate("x", -np.pi / 2), np.zeros(3))


def placement(numbers):
    """A pose of seven numbers: translation, then quaternion x, y, z, w."""
    x, y, z, w = numbers[3:]
    return pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), np.array(numbers[:3]))


def shape(of):
    """A shape, and its pose in its own frame."""
    kind, sizes = of["kind"], of["sizes"]
    if kind == "sphere":
        return coal.Sphere(sizes[0]), pin.SE3.Identity()
    if kind == "box":
        return coal.Box(*sizes), pin.SE3.Identity()
    made = coal.Capsule if kind == "capsule" else coal.Cylinder
    return made(sizes[0], sizes[1]), UPRIGHT


class CoalScene:
    """Collision checker for poses of all motors."""

    def __init__(self, folder):
        with open(f"{folder}/scene.json") as file:
            scene = json.load(file)
        self.model = pin.Model()
        moving = [frame for frame in scene["frames"] if frame["parent"] is not None]
        joints, fixed = [], []  # per frame: its joint, and its pose relative to the joint
        for i, frame in enumerate(scene["frames"]):
            at = placement(frame["at"])
            if frame["parent"] is None:
                joints.append(0)
                fixed.append(at)
                continue
            turns = frame["motion"] == "turn"
            kind = pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned
            parent = frame["parent"]
            placed = fixed[parent] * at
            joints.append(self.model.addJoint(joints[parent], kind(np.array(frame["axis"])), placed, f"joint{i}"))
            fixed.append(pin.SE3.Identity())
        self.shapes = pin.GeometryModel()
        for i, of in enumerate(scene["shapes"]):
            made, own = shape(of)
            frame = of["frame"]
            where = fixed[frame] * placement(of["pose"]) * own
            self.shapes.addGeometryObject(pin.GeometryObject(f"shape{i}", joints[frame], where, made))
        for a, b in scene["pairs"]:
            self.shapes.addCollisionPair(pin.CollisionPair(a, b))
        self.motor = np.array([frame["motor"] for frame in moving])
        self.gain = np.array([frame["gain"] for frame in moving])
        self.start = np.array([frame["start"] for frame in moving])
        self.data, self.places = self.model.createData(), self.shapes.createData()
        self.broad = pin.BroadPhaseManager_SSaPCollisionManager(self.model, self.shapes, self.places)

    def joints(self, poses):
        """Positions of all joints at poses of all motors."""
        return self.start + poses[..., self.motor] * self.gain

    def listed(self, q):
        """True if any pair touches, tested pair by pair."""
        return pin.computeCollisions(self.model, self.data, self.shapes, self.places, q, True)

    def swept(self, q):
        """True if any pair touches, tested by the broad phase."""
        return pin.computeCollisions(self.model, self.data, self.broad, q, True)
