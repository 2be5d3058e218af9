"""Pinocchio and coal as a peer of `cargo bench -p mobee-fast --bench peers`: see README.md beside this file.

usage: coal_peer.py FOLDER
  FOLDER/scene.json  joints, shapes and pairs, as written by the benchmark
  FOLDER/poses.f64   positions of all motors, pose by pose

Writes FOLDER/verdicts (a byte per pose: 1 is free) and prints "ready". Then replies to every line of its input with the
number of poses tested per second of processor time, over those whose byte in FOLDER/asked is 1. Uses the faster of
coal's two methods, the list of pairs and the broad phase.
"""

import sys
import time

import numpy as np
from coal_scene import CoalScene


def rate(judge, chosen, least):
    begin, count = time.thread_time(), 0
    while True:
        for q in chosen:
            judge(q)
            count += 1
            if count % 64 == 0 and time.thread_time() - begin > least:
                return count / (time.thread_time() - begin)


def main(folder):
    scene = CoalScene(folder)
    poses = np.fromfile(f"{folder}/poses.f64")
    # Coupled joints are separate joints here; their positions are computed outside the measured time.
    poses = scene.joints(poses.reshape(-1, scene.motor.max() + 1))
    with open(f"{folder}/verdicts", "wb") as file:
        file.write(bytes(not scene.swept(q) for q in poses))
    trial = poses[: min(len(poses), 200)]
    judge = max((scene.listed, scene.swept), key=lambda judge: rate(judge, trial, 0.2))
    print("ready", judge.__name__, flush=True)
    for _ in sys.stdin:
        asked = np.fromfile(f"{folder}/asked", dtype=np.uint8).astype(bool)
        print(rate(judge, poses[asked], 0.5), flush=True)


main(sys.argv[1])
