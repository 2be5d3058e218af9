"""Detectors and locators in Python."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mobee

LOOK = Path(__file__).parents[2] / "configs/behaviors/look.toml"
# the figure is 50: `EQUAL_RUNS=50 pytest -k equal_journals`
EQUAL_RUNS = int(os.environ.get("EQUAL_RUNS", "3"))
Out = Callable[[], Path]


@pytest.fixture
def out(tmp_path: Path) -> Out:
    """A new folder for each run."""
    count = iter(range(1000))
    return lambda: tmp_path / f"run-{next(count)}"


class Orange(mobee.Detector):
    """The largest orange thing is the cup."""

    takes = 0.03

    def __init__(self) -> None:
        self.frames: list[mobee.Frame] = []

    def detect(self, frame: mobee.Frame) -> Sequence[mobee.Region]:
        self.frames.append(frame)
        red, green, blue = np.moveaxis(frame.pixels.astype(float), 2, 0)
        region = mobee.Region.of_mask("cup", (red > 1.4 * green) & (green > 1.1 * blue) & (red > 60))
        return [] if region is None else [region]

    def export(self) -> Any:
        return {"frames": len(self.frames)}


class OnTable(mobee.Locator):
    """Meets the line of sight with the plane of the table, on which the cup stands."""

    def __init__(self) -> None:
        self.seen: list[tuple[mobee.Sighting, mobee.Body]] = []

    def locate(self, seen: Sequence[mobee.Sighting], body: mobee.Body) -> Sequence[mobee.Located]:
        found = []
        for sighting in seen:
            self.seen.append((sighting, body))
            name = {"eyes/left": "l_eye", "eyes/right": "r_eye"}[sighting.camera]
            eye = body.pose(name)
            ray = np.linalg.solve(sighting.intrinsics.matrix, np.append(np.asarray(sighting.region.center), 1.0))
            assert np.isfinite(ray).all()
            position = eye[:3, 3] + 0.3 * np.array([-1.0, 0.0, 0.0])
            found.append(mobee.Located(sighting.region.object, position, np.eye(3) * 0.01**2))
        return found


class Look(mobee.Agent):
    """Looks about with the head."""

    def next(self, last: Any, view: mobee.View) -> Any:
        rng = np.random.default_rng([view.seed, int(view.at * 1000)])
        q = [rng.uniform(-0.68, -0.6), rng.uniform(-0.15, 0.15)]
        return mobee.MoveTo(q, speed=0.2, joints=["neck_pitch", "neck_yaw"])


def look(out: Out, **arguments: Any) -> mobee.Run:
    given: dict[str, Any] = {"detectors": {"eyes": Orange}, "for_s": 3, "seed": 5, **arguments}
    return mobee.run(LOOK, out=out(), **given)


def test_a_detector_gets_frames_and_its_regions_are_in_the_journal(out: Out) -> None:
    left, right = Orange(), Orange()
    run = look(out, detectors={"eyes/left": left, "eyes/right": right})
    assert run.ok and run.check() and run.errors == []
    assert run.journal[0]["config"]["sensor"][0]["eye"][0]["detector"]["kind"] == "python"
    seen = [event for event in run.journal.of("sighted") if event["camera"] == "eyes/left"]
    assert 20 <= len(seen) <= 31 and len(seen) == len(left.frames), "ten a second, for three seconds"
    assert any(event["regions"] for event in seen), "the cup is in view"
    frame = left.frames[0]
    assert frame.camera == "eyes/left" and {f.camera for f in right.frames} == {"eyes/right"}
    width, height = frame.intrinsics.size
    assert frame.pixels.shape == (height, width, 3) and frame.pixels.dtype == np.uint8
    assert not frame.pixels.flags.writeable and frame.pixels.std() > 1
    assert frame.intrinsics.matrix.shape == (3, 3) and frame.intrinsics.focal[0] > 0
    # each frame is exposed at the camera's period, and its regions come `takes` later
    assert np.allclose(np.diff([f.at for f in left.frames]), 0.1, atol=0.021)
    assert all(event.at - event["exposed"] * 1e-9 >= 0.03 - 1e-9 for event in seen)


def test_a_locator_gets_sightings_and_the_robot_at_the_exposure(out: Out) -> None:
    locator = OnTable()
    run = look(out, locators={"eyes": locator})
    assert run.ok and run.errors == []
    located = run.journal.of("located")
    assert located and located[0]["objects"][0]["object"] == "cup"
    assert len(located) == len({(s.camera, s.at) for s, _ in locator.seen})
    sighting, body = locator.seen[0]
    assert body.at == sighting.at and body.q.shape == (body.model.dof,)
    pose = body.pose("l_eye")
    assert pose.shape == (4, 4) and np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3))
    assert sighting.region.object == "cup" and 0 <= sighting.region.confidence <= 1


def test_equal_seeds_and_code_give_equal_journals_with_detectors(out: Out) -> None:
    parts: dict[str, Any] = {"agent": Look, "locators": {"eyes": OnTable}}
    runs = [look(out, **parts) for _ in range(EQUAL_RUNS)]
    # and a process with another seed of its hashes, and other addresses
    code = f"""
        import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})
        from test_senses import *
        print(look(lambda: Path({str(out())!r}), agent=Look, locators={{"eyes": OnTable}}).hash)
    """
    env = {**os.environ, "PYTHONHASHSEED": "77"}
    other = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], env=env, capture_output=True, text=True)
    assert other.returncode == 0, other.stderr
    assert {run.hash for run in runs} == {other.stdout.split()[-1]}
    assert look(out, **{**parts, "seed": 6}).hash != runs[0].hash
    again = mobee.replay(runs[0].folder, agent=Look, detectors={"eyes": Orange}, locators={"eyes": OnTable}, out=out())
    assert again.difference is None and again.equal == len(runs[0].journal)


def test_what_a_detector_takes_passes_in_virtual_time(out: Out) -> None:
    class Slow(Orange):
        takes = 0.25

    run = look(out, detectors={"eyes/left": Slow})
    at = [event for event in run.journal.of("sighted") if event["camera"] == "eyes/left"]
    assert 10 <= len(at) <= 13, "four frames a second, of ten"
    assert all(event.at - event["exposed"] * 1e-9 >= 0.25 - 1e-9 for event in at)


class Broken(Orange):
    lives = 0

    def __init__(self) -> None:
        super().__init__()
        Broken.lives += 1
        self.before: Any = None

    def import_(self, state: Any) -> None:
        self.before = state

    def detect(self, frame: mobee.Frame) -> Sequence[mobee.Region]:
        if frame.at > 0.8 and self.before is None:
            raise ValueError("the network is out of memory")
        return super().detect(frame)


def test_an_exception_is_the_death_of_a_detector(out: Out) -> None:
    Broken.lives = 0
    with pytest.warns(mobee.MobeeWarning, match="eyes.*ValueError: the network is out of memory"):
        run = look(out, detectors={"eyes/left": Broken})
    assert run.ok and Broken.lives == 2, "its next life takes over its state, and goes on"
    (error,) = run.errors
    assert "Traceback" in error and "out of memory" in error and "test_senses.py" in error
    late = [e for e in run.journal.of("sighted") if e["camera"] == "eyes/left" and e.at > 1.5]
    assert late, "supervision started it again"


def test_a_locator_that_dies_again_and_again_stays_down_and_the_run_goes_on(out: Out) -> None:
    class Never(mobee.Locator):
        def locate(self, seen: Sequence[mobee.Sighting], body: mobee.Body) -> Any:
            raise RuntimeError("no idea")

    with pytest.warns(mobee.MobeeWarning, match="no idea"):
        run = look(out, agent=Look, locators={"eyes": Never}, for_s=20)
    assert run.summary["reason"] == "time" and run.check()
    assert run.journal.of("gave_up") and len(run.errors) < 30
    assert run.journal.of("outcome")[-1].at > run.journal.of("gave_up")[0].at, "the robot moved on"


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (None, "return a list"),
        ([None], "it is NoneType"),
        ([mobee.Region("cup", (5, 5, 1, 9))], "bounds are"),
        ([mobee.Region("cup", (0, 0, np.nan, 9))], "bounds"),
        ([mobee.Region("cup", (0, 0, 1))], "shape (3,)"),
        ([mobee.Region("", (0, 0, 1, 1))], "is empty"),
        ([mobee.Region("cup", (0, 0, 1, 1), confidence=2.0)], "confidence is 2"),
        ([mobee.Region("cup", (0, 0, 1, 1), pose=np.eye(4))], "covariance"),
        ([mobee.Region("cup", (0, 0, 1, 1))] * 5000, "more than 4096"),
    ],
)
def test_what_a_detector_must_not_return(out: Out, answer: Any, words: str) -> None:
    class Wrong(mobee.Detector):
        def detect(self, frame: mobee.Frame) -> Any:
            return answer

    with pytest.warns(mobee.MobeeWarning):
        run = look(out, detectors={"eyes/left": Wrong}, for_s=0.5)
    assert words in run.errors[0], run.errors[0]


def test_names_that_are_not_in_the_file_are_refused(out: Out) -> None:
    with pytest.raises(mobee.MobeeError, match='no camera "eyes/middle"') as error:
        look(out, detectors={"eyes/middle": Orange})
    assert error.value.code == "unknown" and error.value.place == "detectors" and "eyes/left" in (error.value.remedy or "")
    with pytest.raises(mobee.MobeeError, match='no sensor "ears"'):
        look(out, locators={"ears": OnTable})
    with pytest.raises(mobee.MobeeError, match="detector of eyes is int"):
        look(out, detectors={"eyes": 3})
    run = look(out, for_s=0.3)
    with pytest.raises(mobee.MobeeError, match="Python code, and none was passed"):
        mobee.replay(run.folder, out=out())


def test_a_pose_of_a_region_reaches_the_locator(out: Out) -> None:
    pose = np.eye(4)
    pose[:3, 3] = 0.1, 0.0, 0.5

    class Tag(mobee.Detector):
        def detect(self, frame: mobee.Frame) -> Sequence[mobee.Region]:
            covariance = np.eye(6) * 1e-4
            return [mobee.Region("cup", (0, 4, 10, 20), pose=pose, covariance=covariance)]

    locator = OnTable()
    run = look(out, detectors={"eyes": Tag()}, locators={"eyes": locator}, for_s=0.5)
    assert run.errors == [] and locator.seen
    region = locator.seen[0][0].region
    assert np.allclose(np.asarray(region.pose), pose) and np.asarray(region.covariance).shape == (6, 6)
    assert region.is_clipped and tuple(np.asarray(region.center)) == (5, 12) and region.area == 160


def test_the_region_of_a_mask() -> None:
    mask = np.zeros((20, 30))
    mask[4:6, 10:13] = 1
    region = mobee.Region.of_mask("cup", mask)
    assert region is not None and region.area == 6
    assert np.allclose(np.asarray(region.bounds), (10, 4, 13, 6)) and np.allclose(np.asarray(region.center), (11.5, 5))
    assert mobee.Region.of_mask("cup", mask * 0) is None
    with pytest.raises(mobee.MobeeError, match="3 dimensions"):
        mobee.Region.of_mask("cup", np.zeros((2, 2, 2)))
