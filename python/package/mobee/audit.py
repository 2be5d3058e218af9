"""Judges a LeRobotDataset v3 against a robot's model: frames in contact, or nearer than a margin.

    python -m mobee.audit DATASET --robot so101.xml --unit degrees --percent gripper

Needs pyarrow. Prints JSON. Exit code 1 if a frame is in contact, 2 if the dataset can't be judged.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ._error import MobeeError
from ._native import Robot, Scene, World, load
from .lerobot import JointUnits

# a measured position exceeds a limit by noise: of the range of the joint
_LIMIT_TOLERANCE = 0.01


def audit(
    dataset: Path,
    robot: Robot,
    world: World | None = None,
    *,
    unit: str,
    margin: float = 0.01,
    column: str = "observation.state",
    percent: Sequence[str] = (),
) -> dict[str, Any]:
    """Judges each frame of a dataset.

    Parameters
    ----------
    dataset : Path
        The folder with ``meta/info.json`` and ``data``.
    margin : float
        Frames nearer than this are listed as near, m.
    column : str
        The feature with the positions.
    unit : str
        ``degrees`` (mm of a joint that slides), or ``range``: -100 to 100 of the range between the model's limits.
    percent : sequence of str
        Joints in 0 to 100 of the range between the model's limits, as LeRobot's grippers.

    Raises
    ------
    MobeeError
        code ``dataset`` or ``joints``: a file or column that can't be read, or that does not fit the robot; ``unit``:
        most frames are beyond the limits.
    """
    units = JointUnits(robot, unit, percent)
    if not 0.0 <= margin < 10.0:
        raise MobeeError("bounds", f"margin is {margin}", "margin", "give m, from 0 to below 10")
    names, frames = _names(dataset, column)
    order = _order(names, robot)
    scene = Scene(robot, world)
    report: dict[str, Any] = {"frames": 0, "contact": 0, "near": 0, "beyond_limits": 0, "margin_m": margin, "pairs": {}, "episodes": {}}
    files = sorted(dataset.glob("data/*/*.parquet"))
    if not files:
        raise MobeeError("dataset", "there is no data/*/*.parquet", str(dataset), "give the folder of a LeRobotDataset v3")
    for file in files:
        given, episodes = _read(file, column, len(names))
        q = units.positions(given[:, order])
        tolerance = _LIMIT_TOLERANCE * (robot.upper - robot.lower)
        beyond = ((q < robot.lower - tolerance) | (q > robot.upper + tolerance)).any(axis=1)
        report["beyond_limits"] += int(beyond.sum())
        report["frames"] += len(q)
        found = scene.contacts(np.clip(q, robot.lower, robot.upper), margin)
        for episode, pairs in zip(episodes, found, strict=True):
            _count(report, str(episode), pairs)
    if report["frames"] != frames:
        what = f"data has {report['frames']} frames, and meta/info.json states {frames}"
        raise MobeeError("dataset", what, str(dataset), "download the missing files")
    if report["beyond_limits"] > report["frames"] / 2:
        what = f"{report['beyond_limits']} of {report['frames']} frames are beyond the robot's limits"
        raise MobeeError("unit", what, column, "give the dataset's robot, the unit of its positions, and the joints in percent")
    return report


def _count(report: dict[str, Any], episode: str, pairs: Any) -> None:
    if not pairs:
        return
    kind = "contact" if any(pair.distance <= 0.0 for pair in pairs) else "near"
    report[kind] += 1
    counts = report["episodes"].setdefault(episode, {"contact": 0, "near": 0})
    counts[kind] += 1
    for pair in pairs:
        name = " - ".join(sorted((pair.a, pair.b)))
        of = report["pairs"].setdefault(name, {"frames": 0, "nearest_m": pair.distance})
        of["frames"] += 1
        of["nearest_m"] = min(of["nearest_m"], pair.distance)


def _names(dataset: Path, column: str) -> tuple[list[str], int]:
    """The names of a column's positions, and the number of frames of the dataset."""
    path = dataset / "meta/info.json"
    try:
        info = json.loads(path.read_text())
        version, names = info["codebase_version"], info["features"][column]["names"]
        frames = int(info["total_frames"])
    except (OSError, ValueError, KeyError, TypeError) as e:
        raise MobeeError("dataset", f"no feature {column} can be read: {type(e).__name__} {e}", str(path), "give a LeRobotDataset v3, and its column") from None
    if not str(version).startswith("v3"):
        raise MobeeError("dataset", f"its version is {version}", str(path), "convert it to v3 with LeRobot")
    if isinstance(names, dict):
        names = [name for group in names.values() for name in group]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise MobeeError("dataset", f"{column} has no list of names", str(path), "name its motors in features.names")
    return [name.removesuffix(".pos") for name in names], frames


def _order(names: list[str], robot: Robot) -> list[int]:
    if sorted(names) != sorted(robot.joint_names):
        what = f"the dataset has {', '.join(names)}; the robot has {', '.join(robot.joint_names)}"
        raise MobeeError("joints", what, "features.names", "give the dataset's robot; names must be equal")
    return [names.index(name) for name in robot.joint_names]


def _read(file: Path, column: str, width: int) -> tuple[Any, list[int]]:
    try:
        import pyarrow.parquet as parquet  # type: ignore[import-untyped,import-not-found,unused-ignore]
    except ImportError:
        raise MobeeError("import", "pyarrow is not installed", None, "pip install pyarrow") from None
    try:
        table = parquet.read_table(file, columns=[column, "episode_index"])
        given = np.array(table[column].to_pylist(), dtype=np.float64)
        episodes = [int(n) for n in table["episode_index"].to_pylist()]
    except (OSError, ValueError, TypeError, KeyError) as e:
        raise MobeeError("dataset", f"{column} and episode_index can't be read: {e}", str(file), "repair the file, or name another column") from None
    if given.shape != (len(episodes), width):
        raise MobeeError("dataset", f"{column} has shape {given.shape}", str(file), f"give ({len(episodes)}, {width})")
    if not np.isfinite(given).all():
        row = int(np.flatnonzero(~np.isfinite(given).all(axis=1))[0])
        raise MobeeError("dataset", f"row {row} of {column} is not finite", str(file), "remove its episode")
    return given, episodes


def main(arguments: Sequence[str] | None = None) -> int:
    """The program."""
    parser = argparse.ArgumentParser(prog="python -m mobee.audit", description="Frames of a LeRobotDataset v3 that are in contact.")
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--robot", required=True, help="a robot file or URDF")
    parser.add_argument("--world", help="a world file")
    parser.add_argument("--unit", required=True, choices=("degrees", "range"), help="degrees (mm of a slide), or -100 to 100 of the range")
    parser.add_argument("--margin", type=float, default=0.01, help="m")
    parser.add_argument("--column", default="observation.state")
    parser.add_argument("--percent", action="append", default=[], help="a joint in 0 to 100 of its range; repeatable")
    given = parser.parse_args(arguments)
    try:
        world = World.load(given.world) if given.world else None
        robot = load(given.robot)
        report = audit(given.dataset, robot, world, unit=given.unit, margin=given.margin, column=given.column, percent=given.percent)
    except MobeeError as e:
        print(f"error: {e}", file=sys.stderr)
        return 2
    print(json.dumps(report, indent=2))
    return 1 if report["contact"] else 0


if __name__ == "__main__":
    sys.exit(main())
