"""From a URDF to a verdict: `python check_a_robot.py robot.urdf`."""

import sys

import numpy as np

import mobee

robot = mobee.load(sys.argv[1], progress=lambda step, share: print(f"\r{step} {share:4.0%} ", end="", file=sys.stderr))
world = mobee.World()
world.add("table", mobee.Box((2.0, 2.0, 0.05)), position=(0.0, 0.0, -0.13))
scene = mobee.Scene(robot, world)

q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (100_000, robot.dof))
free = scene.free(q)
print(f"{robot.name}: {robot.dof} joints; {free.mean():.1%} of {len(q)} random configurations are free")
for contact in sorted(scene.contacts(q[~free][:1])[0], key=lambda contact: contact.distance)[:3]:
    print(f"  {contact.a} is {-1e3 * contact.distance:.1f} mm deep in {contact.b}")
goal = q[free][np.abs(q[free] - robot.home).sum(axis=1).argmin()]
print("straight from home to the nearest free one:", scene.edge(robot.home, goal))
print("a plan:", scene.plan(robot.home, goal))
