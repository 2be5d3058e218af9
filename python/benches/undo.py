"""What undo is worth to a learner: `python undo.py OUT.csv [STEPS] [SEEDS]`. Needs stable-baselines3.

The same learner (SAC of stable-baselines3) reaches for goals with a Katana between two posts above a table, in episodes that go on after a
rollback, in the same with a cost of each contact, and in episodes that end at the first contact, after which the robot begins at home again, as
after a protective stop. All have the same number of motions. For each 250 motions, OUT.csv has the share of episodes that reached their goal, the cells of the joint space
visited so far (a tenth of each joint's range), and the contacts and resets so far.
"""

from __future__ import annotations

import csv
import functools
import sys
import tempfile
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import mobee
import mobee.gym

ROBOT = Path(__file__).parents[2] / "configs" / "robots" / "katana.xml"
WORLD = """<WorldList version="1.0">
<object name="table" type="obstacle" persistent="1" pz="-0.05"><box width="1.6" height="1.6" depth="0.04"/></object>
<object name="left" type="obstacle" persistent="1" px="0.25" py="0.25" pz="0.2"><box width="0.06" height="0.06" depth="0.4"/></object>
<object name="right" type="obstacle" persistent="1" px="0.25" py="-0.25" pz="0.2"><box width="0.06" height="0.06" depth="0.4"/></object>
</WorldList>"""
FILE = """
world.file = "world.xml"
[[robot]]
name = "katana"
model = {model!r}
controller = {{ period_ms = 20, history = 6000 }}
driver = {{ kind = "sim", profile = "ideal" }}
"""
JOINTS = ("motor1_pan", "motor2_lift", "motor3_lift")
WINDOW = 250
# whether episodes go on after a contact, and the cost of a contact
LEARNERS = {"rollback": (True, 0.0), "rollback, costs": (True, 0.5), "terminate": (False, 0.0)}
NAMES = ("learner", "seed", "motions", "episodes", "reached", "cells", "contacts", "resets")


class Progress(mobee.gym.Reach):
    """Rewards each 0.1 m that a motion came nearer, and the goal: to end an episode is never worth anything."""

    def begin(self, env: mobee.gym.Env, view: mobee.View, rng: np.random.Generator) -> None:
        super().begin(env, view, rng)
        self.before = float(np.linalg.norm(self._position(view) - self.goal))

    def reward(self, env: mobee.gym.Env, view: mobee.View, info: dict[str, Any]) -> tuple[float, bool]:
        _, reached = super().reward(env, view, info)
        nearer, self.before = self.before - info["distance"], info["distance"]
        return 10.0 * nearer + float(reached), reached


class Account(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Counts what happens, and ends episodes at contacts if there is no undo."""

    def __init__(self, env: Any, undo: bool, cost: float) -> None:
        super().__init__(env)
        self.undo, self.cost = undo, cost
        self.windows: list[dict[str, int]] = []
        self.cells: set[tuple[int, ...]] = set()
        self.now = dict.fromkeys(NAMES[2:], 0)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        contact = info["outcome"] in ("rolled_back", "faulted")
        terminated = terminated or (contact and not self.undo)
        self.cells.add(tuple(np.floor(5.0 * (observation[: len(JOINTS)] + 1.0)).astype(int)))
        self.now["motions"] += 1
        self.now["contacts"] += contact
        self.now["resets"] += contact and not self.undo
        if terminated or truncated:
            self.now["episodes"] += 1
            self.now["reached"] += info["is_success"]
        if self.now["motions"] % WINDOW == 0:
            self.windows.append({**self.now, "cells": len(self.cells)})
            self.now.update(episodes=0, reached=0)
        return observation, float(reward) - self.cost * contact, terminated, truncated, info


def train(undo: bool, cost: float, steps: int, seed: int) -> dict[str, Any]:
    import torch  # type: ignore[import-not-found,unused-ignore]
    from stable_baselines3 import SAC  # type: ignore[import-not-found,import-untyped,unused-ignore]

    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "world.xml").write_text(WORLD)
        (Path(folder) / "katana.toml").write_text(FILE.format(model=str(ROBOT)))
        task = Progress(tolerance=0.08)
        env = Account(mobee.gym.make(Path(folder) / "katana.toml", task, joints=JOINTS, step=0.4, max_steps=30), undo, cost)
        options: dict[str, Any] = {"policy_kwargs": {"net_arch": [64, 64]}, "batch_size": 64, "learning_rate": 1e-3, "gamma": 0.9, "ent_coef": 0.02}
        learner = SAC("MlpPolicy", env, seed=seed, device="cpu", learning_starts=300, train_freq=1, gradient_steps=1, **options)
        learner.learn(steps)
        env.close()
    return {"windows": env.windows}


def main(out: str, steps: int = 4000, seeds: int = 5) -> None:
    with open(out, "w", newline="") as file:
        table = csv.DictWriter(file, NAMES)
        table.writeheader()
        for learner, (undo, cost) in LEARNERS.items():
            trial = functools.partial(train, undo, cost, steps)
            rows = mobee.sweep(trial, range(seeds), backend="processes", results=f"{out}.{learner}.jsonl", progress=True)
            for row in rows:
                if not row["ok"]:
                    sys.exit(row["traceback"])
                table.writerows({"learner": learner, "seed": row["seed"], **window} for window in row["windows"])


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:4]))
