"""Hostile chunks of a policy at 30 Hz on a simulated SO-101 above a table, in virtual time: contacts, outcomes, share of time held.

    python python/benches/follow.py [CHUNKS] [SEED] [--steps]

Each chunk is half a second of set-points toward a target: at random, into the table, into the arm itself, from an old observation, with a
number that is not finite, or across the range of the joints in a tenth of a second. `--steps` sends each set-point by itself.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import mobee

ROBOT = Path(__file__).parents[2] / "configs" / "robots" / "so101.xml"
WORLD = """<WorldList version="1.0"><object name="table" type="obstacle" persistent="1" px="0.2" pz="-0.03">
<box width="1.0" height="1.2" depth="0.04"/></object></WorldList>"""
FILE = """
world.file = "table.xml"
[[robot]]
name = "so101"
model = {model!r}
controller = {{ period_ms = 10, history = 6000, reserve_mm = 10 }}
# speeds and stops as those of the driver `feetech`
driver = {{ kind = "sim", profile = "so101", servo = {{ stop = "commanded" }}, max_speed_deg_per_s = 60, max_acceleration_deg_per_s2 = 400 }}
"""
KINDS = ("random", "table", "itself", "stale", "nan", "fast")
RATE, POINTS = 30, 15


def targets(robot: mobee.Robot, rng: np.random.Generator) -> dict[str, NDArray[np.float64]]:
    """Configurations at random, in contact with the table, and with the arm itself."""
    world = mobee.World()
    world.add("table", mobee.Box((1.0, 1.2, 0.04)), position=(0.2, 0, -0.03))
    q = rng.uniform(robot.lower, robot.upper, (4000, robot.dof))
    itself = ~np.asarray(mobee.Scene(robot).free(q))
    table = ~np.asarray(mobee.Scene(robot, world).free(q)) & ~itself
    return {"random": q, "table": q[table], "itself": q[itself]}


def chunk(kind: str, q: NDArray[np.float64], some: dict[str, NDArray[np.float64]], rng: np.random.Generator) -> NDArray[np.float64]:
    goals = some.get(kind, some["random"])
    goal: NDArray[np.float64] = goals[rng.integers(len(goals))]
    share = np.linspace(0, 1, POINTS + 1)[1:, None]
    if kind == "fast":
        share = np.minimum(5 * share, 1.0)
    points: NDArray[np.float64] = q + share * (goal - q)
    if kind == "nan":
        points[rng.integers(POINTS), rng.integers(len(q))] = rng.choice([np.nan, np.inf, -np.inf])
    return points


def main() -> None:
    numbers = [int(a) for a in sys.argv[1:] if not a.startswith("-")]
    count, seed = (numbers + [1200, 1][len(numbers) :])[:2]
    steps = "--steps" in sys.argv
    rng = np.random.default_rng(seed)
    folder = Path(tempfile.mkdtemp(prefix="mobee-follow-"))
    (folder / "table.xml").write_text(WORLD)
    (folder / "so101.toml").write_text(FILE.format(model=str(ROBOT)))
    replies: Counter[tuple[str, str]] = Counter()
    outcomes: Counter[tuple[str, str]] = Counter()
    pending: list[tuple[str, mobee.Chunk]] = []
    held, periods, nearest, asked, wall = 0, 0, np.inf, 0, []
    begin = time.perf_counter()
    with mobee.Follow(folder / "so101.toml", clock="virtual", seed=seed, rate=RATE, out=folder / "run") as robot:
        scene, some = robot.view.scene, targets(robot.robot, rng)
        for k in range(count):
            kind = KINDS[k % len(KINDS)]
            points = chunk(kind, robot.view.q, some, rng)
            asked += int(not np.isfinite(points).all() or not np.all(scene.free(np.clip(points, robot.robot.lower, robot.robot.upper))))
            seen_at = robot.view.at - (1.0 if kind == "stale" else 0.0)
            sent = None
            if not steps:
                began = time.perf_counter()
                sent = robot.send_chunk(points, seen_at=seen_at)
                wall.append(time.perf_counter() - began)
                replies[kind, sent.code or sent.status] += 1
                pending.append((kind, sent))
            for point in points:
                if steps:
                    robot.send(point, seen_at=seen_at)
                    replies[kind, robot.info["code"] or "sent"] += 1
                    held += robot.info["status"] == "held"
                else:
                    robot.sleep(1 / RATE)
                    held += robot.info["robot"] != "moving"
                periods += 1
                q = np.clip(robot.view.q, robot.robot.lower, robot.robot.upper)
                nearest = min(nearest, float(scene.distance(q)))
            for each in [each for each in pending if each[1].outcome is not None]:
                pending.remove(each)
                outcomes[each[0], str(each[1].outcome)] += 1
        for kind, late in pending:
            outcomes[kind, str(late.wait())] += 1
        info = robot.info
    run = robot.close()
    assert run is not None
    verdict = run.check()
    print(f"{count} chunks in {periods / RATE:.0f} s of the run, {time.perf_counter() - begin:.0f} s of wall time")
    print(f"asked for contact or nonsense: {asked} chunks")
    for kind in KINDS:
        answers = {code: n for (of, code), n in sorted(replies.items()) if of == kind}
        ends = {end: n for (of, end), n in sorted(outcomes.items()) if of == kind}
        print(f"{kind:>7}: {answers} -> {ends}")
    if not steps:
        print(f"outcomes: {sum(outcomes.values())} of {count}; simulation of a chunk: median {1e3 * np.median(wall):.1f} ms, p99 {1e3 * np.quantile(wall, 0.99):.1f} ms, most {1e3 * max(wall):.1f} ms")
    print(f"transactions: {info['counts']['committed']} committed, {info['counts']['rolled_back']} rolled back, {info['counts']['faulted']} faulted")
    print(f"held: {held / periods:.1%} of the time; nearest {1e3 * nearest:.1f} mm")
    counters = run.summary["counters"]
    pushed = [event["newtons"] for event in run.journal.of("pushed")]
    print(f"contacts within the margin: {counters['contacts']}, hard: {counters['hard_contacts']}, forces: {pushed or 'none'}; failed by {counters.get('failed_by', {})}")
    print(f"invariants: {'hold' if verdict else verdict.violations}; {run.folder}")


if __name__ == "__main__":
    main()
