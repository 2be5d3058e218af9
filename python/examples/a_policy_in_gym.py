"""A policy with a seat belt: `python a_policy_in_gym.py explore.toml [joint ...]`. Random search reaches for a goal; contacts end nothing."""

import sys

import gymnasium
import numpy as np

import mobee.gym  # registers mobee/Reach-v0 and mobee/Explore-v0

joints = sys.argv[2:] or None
env = gymnasium.make("mobee/Reach-v0", config=sys.argv[1], joints=joints, step=0.3, tolerance=0.08)
rng = np.random.default_rng(1)
outcomes: dict[str, int] = {}
reached = 0
for episode in range(3):
    observation, info = env.reset(seed=episode)
    action = env.action_space.sample() * 0.0
    best, over = -np.inf, False
    while not over:
        # go on in a direction that led nearer, else try another
        observation, reward, terminated, truncated, info = env.step(action)
        outcomes[info["outcome"]] = outcomes.get(info["outcome"], 0) + 1
        if float(reward) <= best:
            action = rng.uniform(-1, 1, len(action)).astype(np.float32)
        best = float(reward)
        over = terminated or truncated
    reached += terminated
    print(f"episode {episode}: {'reached' if terminated else 'not reached'}, {-best if not terminated else 0:.3f} m, {info['at']:.1f} s of the run")
print(f"{reached} of 3 goals reached; outcomes of all motions: {outcomes}")
env.close()
