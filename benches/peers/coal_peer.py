"""Pinocchio and coal as a peer of `cargo bench -p mobee-fast --bench peers`: see README.md beside this file.

usage: coal_peer.py FOLDER
  FOLDER/scene.json  joints, shapes and pairs as MoBeE has them
  FOLDER/poses.f64   positions of all joints (not motors), pose by pose

Writes FOLDER/verdicts (a byte per pose: 1 is free), says "ready"; then answers every line of its input with the poses
that it judges per second of processor time, over those whose byte in FOLDER/asked is 1. Both ways are tried that coal
has, every listed pair and a broad phase, and the faster one is used.
"""

import json
import sys
import time

import coal
import numpy as np
import pinocchio as pin


def placement(numbers):
    """A pose of seven numbers: translation, then quaternion x, y, z, w."""
    x, y, z, w = numbers[3:]
    return pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), np.array(numbers[:3]))


# Ours stand along y, theirs along z.
UPRIGHT = pin.SE3(pin.utils.rotate("x", -np.pi / 2), np.zeros(3))


def shape(of):
    """A shape, and where it is in its own frame."""
    kind, sizes = of["kind"], of["sizes"]
    if kind == "sphere":
        return coal.Sphere(sizes[0]), pin.SE3.Identity()
    if kind == "box":
        return coal.Box(*sizes), pin.SE3.Identity()
    made = coal.Capsule if kind == "capsule" else coal.Cylinder
    return made(sizes[0], sizes[1]), UPRIGHT


def load(folder):
    with open(f"{folder}/scene.json") as file:
        scene = json.load(file)
    model = pin.Model()
    joints = []  # per frame: its joint
    fixed = []  # per frame: where it is on that joint
    for i, frame in enumerate(scene["frames"]):
        at = placement(frame["at"])
        if frame["parent"] is None:
            joints.append(0)
            fixed.append(at)
            continue
        axis = np.array(frame["axis"])
        turns = frame["motion"] == "turn"
        kind = pin.JointModelRevoluteUnaligned if turns else pin.JointModelPrismaticUnaligned
        parent = frame["parent"]
        joints.append(model.addJoint(joints[parent], kind(axis), fixed[parent] * at, f"joint{i}"))
        fixed.append(pin.SE3.Identity())
    shapes = pin.GeometryModel()
    for i, of in enumerate(scene["shapes"]):
        made, own = shape(of)
        frame = of["frame"]
        where = fixed[frame] * placement(of["pose"]) * own
        shapes.addGeometryObject(pin.GeometryObject(f"shape{i}", joints[frame], where, made))
    for a, b in scene["pairs"]:
        shapes.addCollisionPair(pin.CollisionPair(a, b))
    poses = np.fromfile(f"{folder}/poses.f64").reshape(-1, model.nq)
    return model, shapes, poses


def main(folder):
    model, shapes, poses = load(folder)
    data, places = model.createData(), shapes.createData()
    broad = pin.BroadPhaseManager_SSaPCollisionManager(model, shapes, places)

    def listed(q):
        return pin.computeCollisions(model, data, shapes, places, q, True)

    def swept(q):
        return pin.computeCollisions(model, data, broad, q, True)

    def rate(judge, chosen, least):
        begin, count = time.thread_time(), 0
        while True:
            for q in chosen:
                judge(q)
                count += 1
                if count % 64 == 0 and time.thread_time() - begin > least:
                    return count / (time.thread_time() - begin)

    with open(f"{folder}/verdicts", "wb") as file:
        file.write(bytes(not swept(q) for q in poses))
    trial = poses[: min(len(poses), 200)]
    judge = max((listed, swept), key=lambda judge: rate(judge, trial, 0.2))
    print("ready", judge.__name__, flush=True)
    for _ in sys.stdin:
        asked = np.fromfile(f"{folder}/asked", dtype=np.uint8).astype(bool)
        print(rate(judge, poses[asked], 0.5), flush=True)


main(sys.argv[1])
