#!/usr/bin/env python3
"""Asks independent readers what the robots of tests/robots/install.sh are, for model/import/tests/it/robots_corpus.rs:

    python3 -m venv V && V/bin/pip install pin==4.1.0 && V/bin/python tests/robots/oracle.py model/import/tests/data

robot_meshes.csv.gz: the bounding box and number of triangles of each mesh file, as coal reads it (with assimp).
robot_frames.csv.gz: per robot its joints, each with the range that poses are taken from, then per pose two sums over all links
of the positions and of the z axes, as Pinocchio computes them. A sum is weighted per link and coordinate, so that nothing can
move or turn without changing it; poses and weights follow from their numbers, so that neither need be stored.
"""
import gzip
import math
import os
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

POSES = 1000
ROBOTS = """panda_description/urdf/panda.urdf tiago_description/robots/tiago.urdf tiago_description/robots/tiago_no_hand.urdf
pr2_description/urdf/pr2.urdf baxter_description/urdf/baxter.urdf ur_description/urdf/ur5_robot.urdf
so_arm_description/urdf/so101.urdf xarm_description/urdf/xarm7.urdf g1_description/urdf/g1_29dof_rev_1_0.urdf
talos_data/robots/talos_reduced.urdf kinova_description/robots/kinova.urdf z1_description/urdf/z1.urdf
double_pendulum_description/urdf/double_pendulum_continuous.urdf alex_description/urdf/alex_sake_hands.urdf""".split()

share = Path(os.environ.get("MOBEE_ROBOTS", Path.home() / ".cache/mobee/robots-1")) / "share"
out = Path(sys.argv[1])


def write(name, lines):
    # no time of writing in it: the same content makes the same file
    (out / name).write_bytes(gzip.compress("".join(line + "\n" for line in lines).encode(), mtime=0))


def meshes():
    loader = coal.MeshLoader()
    for path in sorted(share.rglob("*")):
        if path.suffix.lower() in (".stl", ".dae", ".obj"):
            mesh = loader.load(str(path), np.ones(3))
            vertices = mesh.vertices()
            box = [*vertices.min(0), *vertices.max(0)]
            yield ",".join([str(path.relative_to(share)), *(f"{x:.6g}" for x in box), str(mesh.num_tris)])


def noise(pose, joint):
    """A number from 0 to 1 that looks random."""
    return (math.sin(12.9898 * (pose + 1) + 78.233 * (joint + 1)) * 1e4) % 1.0


def weights(link):
    return np.array([math.sin(1 + 7 * link + 3 * i) for i in range(6)])


def frames(file):
    path = share / "example-robot-data/robots" / file
    joints, mimics = {}, {}
    for joint in ET.parse(path).getroot().findall("joint"):
        kind, limit, mimic = joint.get("type"), joint.find("limit"), joint.find("mimic")
        if kind == "fixed":
            continue
        lo, hi = -math.pi, math.pi
        if kind != "continuous":
            lo, hi = (float(limit.get(end, 0)) for end in ("lower", "upper"))
        if mimic is not None:
            mimics[joint.get("name")] = (mimic.get("joint"), float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0)))
        else:
            joints[joint.get("name")] = (lo, hi)
    names = sorted(joints)
    yield f"robot,{file}"
    for name in names:
        yield f"joint,{name},{joints[name][0]!r},{joints[name][1]!r}"
    model = pin.buildModelFromUrdf(str(path))
    data = model.createData()
    links = sorted((f.name, model.getFrameId(f.name, pin.BODY)) for f in model.frames if f.type == pin.BODY)
    for pose in range(POSES):
        at = {n: lo + noise(pose, i) * (hi - lo) for i, n in enumerate(names) for lo, hi in [joints[n]]}

        def angle(name):
            if name in at:
                return at[name]
            leader, factor, offset = mimics[name]
            return factor * angle(leader) + offset

        q = pin.neutral(model)
        for index, name in list(enumerate(model.names))[1:]:
            joint, value = model.joints[index], angle(name)
            q[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [math.cos(value), math.sin(value)]
        pin.framesForwardKinematics(model, data, q)
        positions = turns = 0.0
        for number, (_, frame) in enumerate(links):
            place, weight = data.oMf[frame], weights(number)
            positions += weight[:3] @ place.translation
            turns += weight[3:] @ place.rotation[:, 2]
        yield f"{positions:.11f},{turns:.11f}"


write("robot_frames.csv.gz", [line for file in ROBOTS for line in frames(file)])
write("robot_meshes.csv.gz", meshes())
