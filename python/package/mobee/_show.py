from __future__ import annotations

import importlib
import socket
import sys
import time
from collections.abc import Callable
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._error import MobeeError
from ._native import Plan, Scene, shape_poses, shapes_of

_Floats = NDArray[np.float64]
# configurations that are drawn at most
_MOST_ROWS = 10_000
# between two pictures of a path, s: the fastest joint moves at 1 rad or m per second
_PERIOD = 0.02
# of the viewer, and its time to start, s
_PORT = 9876
_VIEWER_S = 15.0
_ROBOTS = ((0x87, 0x96, 0xAE), (0xE8, 0xDC, 0xC2), (0x5B, 0x9B, 0xD0), (0x5C, 0xB8, 0xA0))
_OBSTACLE = (0xB8, 0xA0, 0x80)
_NEAR = (0xF0, 0x32, 0x2D)
_TRACE = (0xFF, 0xD3, 0x4E)


def show(scene: Scene, q: ArrayLike | None, path: ArrayLike | Plan | None, to: Any, name: str) -> Any:
    """As `Scene.show`."""
    if q is not None and path is not None:
        raise MobeeError("twice", "both q and path are given", "path", "give one of the two")
    # what is wrong is found before a viewer opens
    if path is not None:
        timeline, rows = "time", _between(scene, path.path if isinstance(path, Plan) else path)
    else:
        home = np.concatenate([robot.home for robot in scene.robots])
        timeline, rows = "row", np.atleast_2d(home if q is None else _checked(scene, "q", q))
    if not len(rows):
        raise MobeeError("shape", "q has no configuration", "q", f"give ({scene.dof},) or (N, {scene.dof})")
    if len(rows) > _MOST_ROWS:
        raise MobeeError("too_many", f"q has {len(rows)} configurations", "q", f"give {_MOST_ROWS} at most, such as q[::10]")
    poses = shape_poses(scene, rows)
    contacts: list[Any] = list(scene.contacts(rows))
    recording, ready = _recording(to, name)
    times = np.arange(len(rows)) * (_PERIOD if path is not None else 1)
    _log(recording, scene, poses, contacts, timeline, times)
    ready()
    return recording


def _checked(scene: Scene, what: str, given: ArrayLike) -> _Floats:
    """Configurations, or the error of those that are none."""
    try:
        scene.free(given)
    except MobeeError as e:
        raise MobeeError(e.code, e.message, f"{what}{(e.place or '').removeprefix('q')}", e.remedy) from None
    return np.asarray(given, dtype=np.float64)


def _between(scene: Scene, path: ArrayLike) -> _Floats:
    """Configurations on the edges of a path, so near to each other as pictures are."""
    corners = _checked(scene, "path", path)
    if corners.ndim != 2 or len(corners) < 1:
        raise MobeeError("shape", f"path has shape {corners.shape}", "path", f"give (N, {scene.dof}): configurations one after the other")
    rows: list[_Floats] = [corners[:1]]
    for before, after in zip(corners[:-1], corners[1:], strict=True):
        steps = max(int(np.ceil(np.abs(after - before).max(initial=0.0) / _PERIOD)), 1)
        if sum(map(len, rows)) + steps > _MOST_ROWS:
            raise MobeeError("too_many", f"the path has more than {_MOST_ROWS} pictures", "path", "show a part of it")
        rows.append(before + np.linspace(0.0, 1.0, steps + 1)[1:, None] * (after - before))
    return np.vstack(rows)


def _rerun() -> Any:
    # not by `import`: type checks need not have it
    try:
        return importlib.import_module("rerun")
    except ImportError:
        raise MobeeError("import", "rerun-sdk is not installed", "to", "pip install 'mobee[show]'") from None


def _recording(to: Any, name: str) -> tuple[Any, Callable[[], object]]:
    """A recording, and what is called when all is logged."""
    rerun = _rerun()
    if isinstance(to, rerun.RecordingStream):
        return to, lambda: None
    recording = rerun.RecordingStream(name)
    if to is None:
        to = "notebook" if _in_notebook() else "viewer"
    if to == "viewer":
        _open_viewer(rerun)
        recording.connect_grpc()
        return recording, recording.flush
    if to == "notebook":
        return recording, lambda: _in_cell(rerun, recording)
    if not isinstance(to, (str, PathLike)):
        raise MobeeError("type", f"to is {type(to).__name__}", "to", 'give "viewer", "notebook", a file or a rerun.RecordingStream')
    file = Path(fspath(to))
    if file.suffix != ".rrd":
        raise MobeeError("file", f"{str(to)!r} is no recording", "to", 'give "viewer", "notebook" or a file that ends on .rrd')
    try:
        file.open("wb").close()
    except OSError as e:
        raise MobeeError("file", f"it can't be written: {e.strerror}", str(file), "give a file in a folder that exists") from None
    recording.save(file)
    return recording, recording.flush


def _open_viewer(rerun: Any) -> None:
    """Starts the viewer, unless one is open. A recording that is connected to none would wait for it without end."""
    remedy = 'give a file, to="scene.rrd", and open it where there is a display'
    try:
        rerun.spawn(port=_PORT, connect=False)
    except (RuntimeError, OSError) as e:
        raise MobeeError("viewer", f"the viewer does not start: {e}", "to", remedy) from None
    until = time.monotonic() + _VIEWER_S
    while True:
        try:
            socket.create_connection(("127.0.0.1", _PORT), timeout=1.0).close()
            return
        except OSError as e:
            if time.monotonic() > until:
                raise MobeeError("viewer", f"the viewer does not start: {e}", "to", remedy) from None
        time.sleep(0.1)


def _in_cell(rerun: Any, recording: Any) -> None:
    try:
        rerun.notebook_show(recording=recording)
    except ImportError as e:
        what = f"the notebook's part of the viewer is not installed: {e}"
        raise MobeeError("import", what, "to", "pip install 'mobee[show]'") from None


def _in_notebook() -> bool:
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return type(shell).__name__ == "ZMQInteractiveShell"


def _log(recording: Any, scene: Scene, poses: _Floats, contacts: list[Any], timeline: str, times: Any) -> None:
    rerun = _rerun()
    recording.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    index = rerun.TimeColumn(timeline, sequence=times) if timeline == "row" else rerun.TimeColumn(timeline, duration=times)
    robots = [robot.name for robot in scene.robots]
    near = [{name for contact in found for name in (contact.a, contact.b)} for found in contacts]
    for i, (name, kind, sizes) in enumerate(shapes_of(scene)):
        entity = _entity(name)
        robot = name.split(":")[0] if ":" in name else None
        color = _ROBOTS[robots.index(robot) % len(_ROBOTS)] if robot in robots else _OBSTACLE
        recording.log(entity, _solid(kind, sizes), static=True)
        own = poses[:, i]
        if np.ptp(own, axis=0).max() == 0.0:
            recording.log(entity, rerun.Transform3D(translation=own[0, :3], quaternion=own[0, 3:]), static=True)
        else:
            moves = rerun.Transform3D.columns(translation=own[:, :3], quaternion=own[:, 3:])
            recording.send_columns(entity, indexes=[index], columns=moves)
        colors = [_NEAR if name in names else color for names in near]
        recording.send_columns(entity, indexes=[index], columns=_of(kind).columns(colors=colors))
    for i, (at, found) in enumerate(zip(times, contacts, strict=True)):
        if i > 0 and not found and not contacts[i - 1]:
            continue
        if timeline == "row":
            recording.set_time(timeline, sequence=int(at))
        else:
            recording.set_time(timeline, duration=float(at))
        labels = [f"{1e3 * contact.distance:.1f} mm {contact.a} - {contact.b}" for contact in found]
        lines = rerun.LineStrips3D([contact.points for contact in found], colors=_NEAR, radii=0.002, labels=labels, show_labels=False)
        recording.log("world/contacts", lines)
    if timeline == "time" and len(poses) > 1:
        centers = poses[:, :, :3]
        farthest = int(np.linalg.norm(np.diff(centers, axis=0), axis=2).sum(axis=0).argmax())
        recording.log("world/trace", rerun.LineStrips3D([centers[:, farthest]], colors=_TRACE, radii=0.003), static=True)


def _entity(name: str) -> str:
    parts = name.replace("#", ":").split(":")
    return "world/" + "/".join(_rerun().escape_entity_path_part(part) for part in parts)


def _of(kind: str) -> Any:
    return getattr(_rerun(), {"box": "Boxes3D", "sphere": "Ellipsoids3D", "cylinder": "Cylinders3D", "capsule": "Capsules3D"}[kind])


def _solid(kind: str, sizes: list[float]) -> Any:
    fill = "solid"
    first, second, _ = sizes
    if kind == "box":
        return _of(kind)(half_sizes=[sizes], fill_mode=fill)
    if kind == "sphere":
        return _of(kind)(half_sizes=[[first] * 3], fill_mode=fill)
    if kind == "cylinder":
        return _of(kind)(radii=[first], lengths=[second], fill_mode=fill)
    # the viewer's capsule begins at its origin
    return _of(kind)(radii=[first], lengths=[second], translations=[[0.0, 0.0, -second / 2.0]], fill_mode=fill)
