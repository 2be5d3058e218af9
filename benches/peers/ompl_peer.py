"""OMPL's RRT-Connect as a peer of `cargo bench -p mobee-planning --bench planning -- rrt`: see README.md beside this file.

usage: ompl_peer.py FOLDER
  FOLDER/scene.json    joints, shapes and pairs, as written by the benchmark
  FOLDER/queries.json  the planned motors, their limits, a pose of all motors, starts and goals, seconds per query

States are tested by coal with its broad phase, edges at OMPL's own resolution (a hundredth of the space's extent), with
no clearance. Prints "ready"; then replies to each line of its input with the milliseconds of processor time per query,
-1 if no path was found.
"""

import json
import sys
import time

import numpy as np
from coal_scene import CoalScene
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou


def main(folder):
    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(1)
    scene = CoalScene(folder)
    with open(f"{folder}/queries.json") as file:
        asked = json.load(file)
    motors, pose = np.array(asked["motors"]), np.array(asked["pose"])
    count = len(motors)
    space = ob.RealVectorStateSpace(count)
    bounds = ob.RealVectorBounds(count)
    for i, (low, high) in enumerate(asked["limits"]):
        bounds.setLow(i, low)
        bounds.setHigh(i, high)
    space.setBounds(bounds)

    def is_valid(state):
        pose[motors] = [state[i] for i in range(count)]
        return not scene.swept(scene.joints(pose))

    def placed(values):
        state = space.allocState()
        for i, value in enumerate(values):
            state[i] = value
        return state

    def solve(start, goal):
        setup = og.SimpleSetup(space)
        setup.setStateValidityChecker(is_valid)
        setup.setStartAndGoalStates(placed(start), placed(goal))
        setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
        setup.setup()
        begin = time.thread_time()
        solved = setup.solve(asked["seconds"])
        spent = 1e3 * (time.thread_time() - begin)
        return spent if solved and setup.haveExactSolutionPath() else -1

    print("ready", flush=True)
    for _ in sys.stdin:
        print(*(round(solve(start, goal), 4) for start, goal in asked["queries"]), flush=True)


main(sys.argv[1])
