"""`python -m mobee.audit`: datasets against a model."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mobee
from mobee.audit import main

arrow = pytest.importorskip("pyarrow", reason="pyarrow is not installed")


def dataset(folder: Path, robot: mobee.Robot, q: Any, episodes: list[int]) -> list[str]:
    """Writes configurations, rad, as LeRobot does: degrees, and the gripper in percent. The arguments of the audit."""
    import pyarrow.parquet as parquet

    rows = np.degrees(q)
    rows[:, -1] = 100.0 * (q[:, -1] - robot.lower[-1]) / (robot.upper[-1] - robot.lower[-1])
    (folder / "meta").mkdir()
    (folder / "data/chunk-000").mkdir(parents=True)
    names = [f"{name}.pos" for name in robot.joint_names]
    info = {"codebase_version": "v3.0", "total_frames": len(q), "features": {"observation.state": {"dtype": "float32", "shape": [6], "names": names}}}
    (folder / "meta/info.json").write_text(json.dumps(info))
    table = arrow.table({"observation.state": rows.tolist(), "episode_index": episodes})
    parquet.write_table(table, folder / "data/chunk-000/file-000.parquet")
    return [str(folder), "--robot", str(Path(__file__).parents[2] / "configs/robots/so101.xml"), "--unit", "degrees", "--percent", "gripper"]


def test_frames_in_contact_are_those_of_the_scene(tmp_path: Path, repository: Path, capsys: Any) -> None:
    robot = mobee.load(repository / "configs/robots/so101.xml")
    q = np.random.default_rng(1).uniform(robot.lower, robot.upper, (200, robot.dof))
    free = mobee.Scene(robot).free(q)
    assert 0 < (~free).sum() < 200
    arguments = dataset(tmp_path, robot, q, [i // 100 for i in range(200)])
    assert main(arguments) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["frames"] == 200 and report["contact"] == (~free).sum() and report["beyond_limits"] == 0
    assert sum(counts["contact"] for counts in report["episodes"].values()) == report["contact"] and report["pairs"]


def test_a_free_dataset_passes_and_damage_is_named(tmp_path: Path, repository: Path, capsys: Any) -> None:
    robot = mobee.load(repository / "configs/robots/so101.xml")
    arguments = dataset(tmp_path, robot, np.tile(robot.home, (3, 1)), [0, 0, 0])
    assert main(arguments) == 0
    capsys.readouterr()
    assert main([*arguments, "--column", "action"]) == 2
    assert "info.json" in (said := capsys.readouterr().err) and "action" in said
    info = tmp_path / "meta/info.json"
    info.write_text(info.read_text().replace('"total_frames": 3', '"total_frames": 4'))
    assert main(arguments) == 2
    assert "data has 3 frames, and meta/info.json states 4" in capsys.readouterr().err
    (tmp_path / "data/chunk-000/file-000.parquet").write_bytes(b"PAR1 no")
    assert main(arguments) == 2
    assert "file-000.parquet" in capsys.readouterr().err


def test_another_unit_is_refused_and_can_be_given(tmp_path: Path, repository: Path, capsys: Any) -> None:
    robot = mobee.load(repository / "configs/robots/so101.xml")
    ends = np.array([robot.lower, robot.upper] * 2)
    arguments = dataset(tmp_path, robot, ends, [0, 0, 1, 1])
    arguments[arguments.index("degrees")] = "range"
    assert main(arguments) == 2
    assert "4 of 4 frames are beyond the robot's limits" in capsys.readouterr().err
    assert main([*arguments, "--percent", robot.joint_names[0]]) == 2
    with pytest.raises(mobee.MobeeError):
        mobee.audit.audit(tmp_path, robot, unit="rad")
