"""Steps per second: `python gym_steps.py explore.toml joint ...`. One environment, environments in threads, and two loops in Python; processor time
of a step, and the share of the calling thread, which alone holds the interpreter's lock.

The first loop is an agent in `mobee.run` that commits the same motions. The second simulates the motion itself: a straight line, tested with
`Scene.free` once per period of 20 ms, and back on the same line at a contact; it has neither controller nor history nor journal.
"""

import sys
import tempfile
import time

import numpy as np

import mobee
import mobee.gym

STEPS = 300


def random_actions(count: int, joints: int) -> "np.ndarray[tuple[int, ...], np.dtype[np.float32]]":
    return np.random.default_rng(1).uniform(-1, 1, (count, joints)).astype(np.float32)


def environments(config: str, joints: list[str], count: int) -> float:
    vector = mobee.gym.make_vec(config, "explore", count, joints=joints, max_steps=10 * STEPS)
    vector.reset(seed=1)
    rows = random_actions(STEPS * count, len(joints)).reshape(STEPS, count, -1)
    began = time.perf_counter()
    for row in rows:
        vector.step(row)
    rate = STEPS * count / (time.perf_counter() - began)
    vector.close()
    return rate


def environment(config: str, joints: list[str]) -> float:
    env = mobee.gym.make(config, "explore", joints=joints, max_steps=10 * STEPS)
    env.reset(seed=1)
    actions = random_actions(STEPS, len(joints))
    began, used, own = time.perf_counter(), time.process_time(), time.thread_time()
    for action in actions:
        env.step(action)
    rate = STEPS / (time.perf_counter() - began)
    used, own = time.process_time() - used, time.thread_time() - own
    print(f"processor time of a step {1e3 * used / STEPS:7.2f} ms, of which the calling thread {1e3 * own / STEPS:.2f} ms")
    env.close()
    return rate


class Same(mobee.Agent):
    """Commits the same motions."""

    def __init__(self, joints: list[str]) -> None:
        self.joints = joints
        self.actions = iter(random_actions(STEPS, len(joints)))

    def next(self, last: object, view: mobee.View) -> mobee.MoveTo | mobee.Done:
        action = next(self.actions, None)
        if action is None:
            return mobee.Done("steps")
        columns = [view.joint_names.index(name) for name in self.joints]
        target = np.clip(view.q[columns] + 0.2 * action, view.model.lower[columns], view.model.upper[columns])
        return mobee.MoveTo(target, speed=0.5, joints=self.joints)


def agent(config: str, joints: list[str]) -> float:
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        mobee.run(config, agent=Same(joints), seed=1, clock="virtual", out=f"{folder}/run")
    return STEPS / (time.perf_counter() - began)


def loop(config: str, joints: list[str]) -> float:
    env = mobee.gym.make(config, "explore", joints=joints)
    env.reset(seed=1)
    view = env.unwrapped.view  # type: ignore[attr-defined]
    robot, scene, q = view.model, view.scene, np.clip(view.q, view.model.lower, view.model.upper)
    columns = [view.joint_names.index(name) for name in joints]
    ticks = 30  # periods of a motion of 0.2 rad in the environment
    began = time.perf_counter()
    for action in random_actions(STEPS, len(joints)):
        start, target = q, q.copy()
        target[columns] = np.clip(q[columns] + 0.2 * action, robot.lower[columns], robot.upper[columns])
        for share in np.linspace(0, 1, ticks + 1)[1:]:
            q = start + share * (target - start)
            if not scene.free(q):
                for back in np.linspace(share, 0, int(share * ticks)):
                    q = start + back * (target - start)
                    scene.free(q)
                q = start
                break
    rate = STEPS / (time.perf_counter() - began)
    env.close()
    return rate


def main(config: str, joints: list[str]) -> None:
    print(f"one environment          {environment(config, joints):7.0f} steps/s")
    for count in (1, 2, 4):
        print(f"{count} in threads             {environments(config, joints, count):7.0f} steps/s")
    print(f"agent in mobee.run       {agent(config, joints):7.0f} steps/s")
    print(f"loop in Python           {loop(config, joints):7.0f} steps/s")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
