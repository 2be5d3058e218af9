"""Environments: each step is a transaction, and the episode goes on after a contact."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mobee

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed: pip install 'mobee[gym]'")

import mobee.gym  # noqa: E402

EXPLORE = Path(__file__).parents[2] / "configs/behaviors/explore.toml"
ARM = ["r_shoulder_pitch", "r_shoulder_roll", "r_elbow"]


def reach(**options: Any) -> Any:
    return gymnasium.make("mobee/Reach-v0", config=EXPLORE, joints=ARM, **options)


def actions(seed: int, count: int) -> Any:
    return np.random.default_rng(seed).uniform(-1, 1, (count, len(ARM))).astype(np.float32)


@pytest.mark.parametrize("name", ["mobee/Reach-v0", "mobee/Track-v0", "mobee/Explore-v0"])
def test_the_checker_of_gymnasium_has_no_complaint(name: str) -> None:
    from gymnasium.utils.env_checker import check_env

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(name, config=EXPLORE, joints=ARM)
        check_env(env.unwrapped)
        env.close()


@pytest.mark.parametrize("task", ["reach", "track", "explore"])
def test_the_checker_of_stable_baselines_has_no_complaint(task: Any) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable-baselines3 is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = mobee.gym.make(EXPLORE, task, joints=ARM)
        checker.check_env(env)
        env.close()


def test_a_contact_is_rolled_back_and_the_episode_goes_on() -> None:
    env = reach(step=1.0)
    env.reset(seed=1)
    outcomes = []
    before, info = env.unwrapped.view.q, {}
    for action in actions(2, 40):
        observation, reward, terminated, truncated, info = env.step(action)
        after = env.unwrapped.view.q
        outcomes.append(info["outcome"])
        assert not terminated or info["is_success"]
        assert not truncated or info["outcome"] == "over" or len(outcomes) == 100
        if info["outcome"] == "rolled_back":
            assert np.allclose(after, before, atol=0.02), "it rests where it began"
            assert info["cause"] and info["retreat_s"] > 0.0 and info["depth"] >= 0.0
            assert info["contacts"] or "contact" not in info["cause"]
            k = len(ARM)
            span = env.unwrapped.upper - env.unwrapped.lower
            rests = 2.0 * (after[env.unwrapped.columns] - env.unwrapped.lower) / span - 1.0
            assert np.allclose(observation[:k], rests, atol=1e-5)
        if info["outcome"] == "committed":
            assert info["cause"] is None and info["retreat_s"] == 0.0
        before = after
        if terminated:
            env.reset()
            before = env.unwrapped.view.q
    assert {"committed", "rolled_back"} <= set(outcomes), outcomes
    env.close()


def test_equal_seeds_and_actions_give_equal_runs(tmp_path: Path) -> None:
    hashes = []
    for i in range(2):
        env = mobee.gym.make(EXPLORE, "reach", joints=ARM, out=tmp_path / str(i))
        first = [env.reset(seed=5)[0], *(env.step(action)[0] for action in actions(3, 6))]
        again = [env.reset(seed=5)[0], *(env.step(action)[0] for action in actions(3, 6))]
        assert np.array_equal(first, again)
        other = env.reset(seed=6)[0]
        assert not np.array_equal(other, first[0])
        env.close()
        runs = [mobee.Run(folder) for folder in sorted((tmp_path / str(i)).iterdir())]
        assert all(run.check() for run in runs)
        hashes.append([run.hash for run in runs])
    assert hashes[0] == hashes[1] and hashes[0][1] == hashes[0][2]


def test_the_target_moves_at_its_speed_where_the_frame_can_be() -> None:
    env = gymnasium.make("mobee/Track-v0", config=EXPLORE, joints=ARM, target_speed=0.1, period=0.5)
    k = len(ARM)
    seen, ats = [env.reset(seed=3)[0]], [env.unwrapped.view.at]
    assert np.allclose(seen[0][k : k + 3], seen[0][k + 3 : k + 6], atol=1e-5), "it starts at the frame"
    for action in actions(4, 30) * 0.1:
        observation, reward, terminated, _, info = env.step(action)
        seen.append(observation)
        ats.append(info["at"])
        assert not terminated and info["on_target"] == (info["distance"] < 0.05)
        assert reward == pytest.approx(info["on_target"] - info["distance"])
        distance = np.linalg.norm(observation[k : k + 3] - observation[k + 3 : k + 6])
        assert distance == pytest.approx(info["distance"], abs=1e-5)
    assert (np.diff(ats) > 0.47).all(), "the target moves on while the robot rests (a period of the controller less)"
    task = env.unwrapped._task
    lengths = np.linalg.norm(np.diff(task.points, axis=0), axis=1)
    moving = lengths > 0
    assert np.allclose(lengths[moving] / np.diff(task.times)[moving], 0.1) and moving.any()
    velocities = np.linalg.norm([observation[k + 6 :] for observation in seen], axis=1)
    assert (np.isclose(velocities, 0.1, atol=1e-4) | (velocities == 0.0)).all()
    again = [env.reset(seed=3)[0], *(env.step(action)[0] for action in actions(4, 30) * 0.1)]
    assert np.array_equal(seen, again)
    env.close()


def test_a_task_of_ones_own() -> None:
    class Lift(mobee.gym.Task):
        size = 1

        def observe(self, env: mobee.gym.Env, view: mobee.View) -> Any:
            return view.q[env.columns[:1]]

        def reward(self, env: mobee.gym.Env, view: mobee.View, info: dict[str, Any]) -> tuple[float, bool]:
            return float(view.q[env.columns[0]]), False

    env = mobee.gym.make(EXPLORE, Lift(), joints=ARM, max_steps=2)
    observation, _ = env.reset(seed=0)
    assert observation.shape == (4,) and observation in env.observation_space
    assert [env.step(action)[3] for action in actions(0, 2)] == [False, True]
    env.close()


def test_what_is_wrong_is_named() -> None:
    env = reach()
    with pytest.raises(mobee.MobeeError, match="call reset"):
        env.unwrapped.step(np.zeros(3, np.float32))
    env.reset(seed=0)
    for action, code in [
        (np.zeros(4), "shape"),
        ([0.0, np.nan, 0.0], "not_finite"),
        (None, "dtype"),
        ("up", "dtype"),
        (np.zeros((3, 1)), "shape"),
        (np.array([1j, 0, 0]), "dtype"),
        ([object()] * 3, "dtype"),
    ]:
        with pytest.raises(mobee.MobeeError) as caught:
            env.unwrapped.step(action)
        assert caught.value.code == code
    # nothing of that moved it
    assert env.unwrapped.step(np.zeros(3, np.float32))[4]["outcome"] in ("committed", "refused")
    env.close()
    env.close()
    for call in (lambda: env.unwrapped.step(np.zeros(3)), lambda: env.unwrapped.reset(), lambda: env.unwrapped.view):
        with pytest.raises(mobee.MobeeError, match="closed"):
            call()
    for options in (
        dict(joints=["nose"]),
        dict(joints=[]),
        dict(speed=2),
        dict(step=0),
        dict(tolerance=0),
        dict(attempts=0),
        dict(robot="nobody"),
        dict(set=["robot.icub.margin=3"]),
    ):
        with pytest.raises(mobee.MobeeError):
            mobee.gym.make(EXPLORE, "reach", **options)
    with pytest.raises(mobee.MobeeError, match="task"):
        mobee.gym.make(EXPLORE, "fly")  # type: ignore[arg-type]
    for options in (dict(target_speed=0), dict(period=-1), dict(tolerance=np.inf), dict(cell=0.1)):
        with pytest.raises((mobee.MobeeError, TypeError)):
            mobee.gym.make(EXPLORE, "track", **options)
    for task, count in (("reach", 0), ("reach", 2.0), ("fly", 1), (mobee.gym.Reach(), 1)):
        with pytest.raises(mobee.MobeeError, match="num_envs|task"):
            mobee.gym.make_vec(EXPLORE, task, count)  # type: ignore[arg-type]
    env = reach(frame="nose")
    with pytest.raises(mobee.MobeeError, match="nose"):
        env.reset()
    env.close()


def test_the_end_of_a_run_truncates_the_episode() -> None:
    env = reach(set=["for_s=2"])
    env.reset(seed=0)
    for action in actions(1, 50):
        *_, truncated, info = env.step(action)
        if truncated:
            break
    assert truncated and info["outcome"] == "over" and info["reason"] == "time"
    with pytest.raises(mobee.MobeeError, match="call reset"):
        env.step(action)
    env.reset()
    env.step(action)
    env.close()


def test_garbage_and_threads() -> None:
    began = time.monotonic()
    before = threading.active_count(), len(os.listdir("/proc/self/task")) if os.path.exists("/proc/self/task") else 0
    for _ in range(5):
        env = reach()
        env.reset(seed=0)
        scratch = env.unwrapped._scratch
        del env
        gc.collect()
        assert not scratch.exists()
    assert time.monotonic() - began < 30
    if before[1]:
        until = time.monotonic() + 5
        while len(os.listdir("/proc/self/task")) > before[1] and time.monotonic() < until:
            gc.collect()
        assert len(os.listdir("/proc/self/task")) <= before[1], "the threads of these runs have ended"
    env = reach()
    env.reset(seed=0)
    done: list[str] = []

    def work() -> None:
        for action in actions(0, 20):
            try:
                env.unwrapped.step(action)
                done.append("step")
            except mobee.MobeeError as e:
                done.append(e.code)

    threads = [threading.Thread(target=work) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(done) == 40 and set(done) <= {"step", "busy"}
    env.close()


def test_a_child_process_is_told_and_never_hangs(tmp_path: Path) -> None:
    program = f"""
import os, sys, warnings
warnings.simplefilter("ignore")
import numpy as np, gymnasium, mobee, mobee.gym
env = mobee.gym.make({str(EXPLORE)!r}, "explore", joints={ARM!r})
env.reset(seed=0)
child = os.fork()
if child == 0:
    try:
        env.step(np.zeros(3, np.float32))
    except mobee.MobeeError as e:
        code = 0 if e.code == "fork" else 1
    env.close()
    del env
    os._exit(code)
assert os.waitpid(child, 0)[1] == 0
assert env.unwrapped._scratch.exists(), "a child leaves its parent's files alone"
env.step(np.zeros(3, np.float32))
# neither closed nor collected: the interpreter ends all the same
print("ended")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, cwd=tmp_path)
    assert done.returncode == 0 and done.stdout == "ended\n", done.stderr


@pytest.mark.parametrize("mode", list(gymnasium.vector.AutoresetMode))
def test_environments_in_threads_equal_those_one_after_the_other(mode: Any) -> None:
    def one() -> Any:
        return mobee.gym.make(EXPLORE, "reach", joints=ARM, max_steps=3)

    alone = gymnasium.vector.SyncVectorEnv([one] * 2, autoreset_mode=mode)
    together = mobee.gym.make_vec(EXPLORE, "reach", 2, joints=ARM, max_steps=3, autoreset_mode=mode)
    assert together.metadata["autoreset_mode"] == mode
    assert np.array_equal(alone.reset(seed=1)[0], together.reset(seed=1)[0])
    for row in actions(5, 12).reshape(6, 2, -1):
        (a, rewards, ended, cut, infos), (b, *rest, info) = alone.step(row), together.step(row)
        assert np.array_equal(a, b) and all(map(np.array_equal, (rewards, ended, cut), rest))
        assert np.array_equal(infos["at"], info["at"]) and infos.keys() == info.keys()
        if mode == gymnasium.vector.AutoresetMode.DISABLED and (over := ended | cut).any():
            again = [vector.reset(options={"reset_mask": over.copy()})[0] for vector in (alone, together)]
            assert np.array_equal(*again)
    alone.close()
    together.close()
    together.close()


def test_an_error_in_a_thread_leaves_the_others_in_order() -> None:
    class Fragile(mobee.gym.Task):
        def reward(self, env: mobee.gym.Env, view: mobee.View, info: dict[str, Any]) -> tuple[float, bool]:
            if info["at"] > 1.0 and not hasattr(self, "failed"):
                self.failed = True
                raise ArithmeticError("no reward")
            return 0.0, False

    before = threading.active_count()
    vector = mobee.gym.make_vec(EXPLORE, Fragile, 2, joints=ARM)
    vector.reset(seed=1)
    failures = 0
    for row in actions(5, 16).reshape(8, 2, -1):
        try:
            observations = vector.step(row)[0]
        except ArithmeticError:
            failures += 1
        else:
            rests = np.array([env.unwrapped._observation(env.unwrapped.view) for env in vector.envs])
            assert np.array_equal(observations, rests), "the results are of this step"
    assert 1 <= failures <= 2
    vector.close()
    assert threading.active_count() <= before
    with pytest.raises(mobee.MobeeError, match="nose"):
        mobee.gym.make_vec(EXPLORE, "reach", 2, joints=["nose"])
    assert threading.active_count() <= before


def test_registered_vector_environments_are_those_in_threads() -> None:
    vector = gymnasium.make_vec("mobee/Track-v0", num_envs=2, config=EXPLORE, joints=ARM, max_episode_steps=2)
    observations, _ = vector.reset(seed=1)
    assert observations.shape == (2, 12) and vector.num_envs == 2
    vector.step(np.zeros((2, 3), np.float32))
    assert vector.step(np.zeros((2, 3), np.float32))[3].all()
    vector.close()
