"""Poses per second of processor time of Scene.free, and what two threads are worth.

    python python/benches/queries.py     # beside: cargo bench -p mobee-python --bench engine
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import mobee

ROBOT = Path(__file__).parents[2] / "configs" / "robots" / "ur5.xml"
SECONDS = 0.5


def rate(count: int, call: Callable[[], object]) -> float:
    call()
    begin, calls = time.thread_time(), 0
    while time.thread_time() - begin < SECONDS:
        call()
        calls += 1
    return calls * count / (time.thread_time() - begin)


def main() -> None:
    robot = mobee.load(ROBOT)
    scene = mobee.Scene(robot)
    rng = np.random.default_rng(7)
    for count in (1, 100, 10_000, 1_000_000):
        q = rng.uniform(robot.lower, robot.upper, (count, robot.dof))
        one = q[0] if count == 1 else q
        print(f"{count:>8}  free {rate(count, lambda: scene.free(one)):>10.0f}/s")
    q = rng.uniform(robot.lower, robot.upper, (300_000, robot.dof))
    scene.free(q)
    begin = time.perf_counter()
    for _ in range(2):
        scene.free(q)
    one_thread = time.perf_counter() - begin
    threads = [threading.Thread(target=scene.free, args=(q,)) for _ in range(2)]
    begin = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    two_threads = time.perf_counter() - begin
    print(f"two batches: one thread {one_thread:.2f} s, two threads {two_threads:.2f} s ({one_thread / two_threads:.2f}x)")


if __name__ == "__main__":
    main()
