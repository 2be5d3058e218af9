"""Models: kinematics against those of a few lines of NumPy, files, and inverse kinematics."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import mobee

Matrix = NDArray[np.float64]


def turned(axis: Any, angle: float) -> Matrix:
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    out = np.eye(4)
    out[:3, :3] = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    return out


def moved(by: Any) -> Matrix:
    out = np.eye(4)
    out[:3, 3] = by
    return out


def urdf_frames(path: Path, positions: dict[str, float]) -> dict[str, Matrix]:
    """Forward kinematics straight from the file."""
    numbers = lambda text: [float(x) for x in text.split()]  # noqa: E731
    root = ElementTree.parse(path).getroot()
    joints = {j.find("child").get("link"): j for j in root.findall("joint")}  # type: ignore[union-attr]
    frames: dict[str, Matrix] = {}

    def frame(link: str) -> Matrix:
        if link not in frames:
            joint = joints.get(link)
            if joint is None:
                frames[link] = np.eye(4)
                return frames[link]
            origin = joint.find("origin")
            xyz = numbers(origin.get("xyz", "0 0 0")) if origin is not None else [0, 0, 0]
            r, p, y = numbers(origin.get("rpy", "0 0 0")) if origin is not None else (0, 0, 0)
            at = moved(xyz) @ turned([0, 0, 1], y) @ turned([0, 1, 0], p) @ turned([1, 0, 0], r)
            q = positions.get(joint.get("name", ""), 0.0)
            axis_element = joint.find("axis")
            axis = numbers(axis_element.get("xyz", "1 0 0")) if axis_element is not None else [1, 0, 0]
            if joint.get("type") == "prismatic":
                at = at @ moved(q * np.asarray(axis) / np.linalg.norm(axis))
            elif joint.get("type") in ("revolute", "continuous"):
                at = at @ turned(axis, q)
            frames[link] = frame(joint.find("parent").get("link")) @ at  # type: ignore[union-attr,arg-type]
        return frames[link]

    return {link.get("name", ""): frame(link.get("name", "")) for link in root.findall("link")}


@pytest.mark.parametrize("name", ["rail_arm", "bent_arm"])
def test_every_link_is_where_the_urdf_puts_it_and_turned_as_there(repository: Path, name: str) -> None:
    path = repository / f"tests/data/{name}.urdf"
    robot = mobee.load(path, poses=200)
    rng = np.random.default_rng(3)
    mimics = {j.get("name") for j in ElementTree.parse(path).getroot().findall("joint") if j.find("mimic") is not None}
    for q in rng.uniform(robot.lower, robot.upper, (50, robot.dof)):
        expected = urdf_frames(path, dict(zip(robot.joint_names, q)))
        links = [link for link in expected if not mimics]
        for link in links:
            assert np.allclose(robot.fk(q, link), expected[link], atol=1e-9), link


def test_a_batch_is_its_rows(rail: mobee.Robot) -> None:
    q = np.random.default_rng(1).uniform(rail.lower, rail.upper, (3000, rail.dof))
    frames = rail.fk(q, "jaw")
    jacobians = rail.jacobian(q, "jaw")
    assert frames.shape == (3000, 4, 4) and jacobians.shape == (3000, 6, rail.dof)
    for i in (0, 1, 777, 2999):
        assert np.array_equal(frames[i], rail.fk(q[i], "jaw"))
        assert np.array_equal(jacobians[i], rail.jacobian(q[i], "jaw"))
    assert rail.fk(np.empty((0, rail.dof)), "jaw").shape == (0, 4, 4)
    # any real numbers, any memory layout
    assert np.array_equal(rail.fk(np.asfortranarray(q), "jaw"), frames)
    assert np.array_equal(rail.fk(q[::-2], "jaw"), frames[::-2])
    assert np.array_equal(rail.fk([0, 0, 0, 0], "jaw"), rail.fk(np.zeros(4), "jaw"))


@pytest.mark.parametrize("frame", ["jaw", "lower"])
def test_the_jacobian_is_the_derivative_of_the_pose(rail: mobee.Robot, frame: str) -> None:
    step = 1e-6
    q = np.random.default_rng(2).uniform(rail.lower + step, rail.upper - step)
    jacobian = rail.jacobian(q, frame)
    for j in range(rail.dof):
        off = np.eye(rail.dof)[j] * step
        before, after = rail.fk(q - off, frame), rail.fk(q + off, frame)
        velocity = (after - before) / (2 * step)
        spin = velocity[:3, :3] @ rail.fk(q, frame)[:3, :3].T
        expected = [*velocity[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
        assert np.allclose(jacobian[:, j], expected, atol=1e-8), rail.joint_names[j]


def test_what_slides_counts_meters(rail: mobee.Robot) -> None:
    assert rail.joint_names == ["slide", "shoulder", "elbow", "grip"]
    assert rail.units == ["m", "rad", "rad", "m"]
    assert np.allclose(rail.lower, [-0.1, -1, -1.2, 0]) and np.allclose(rail.upper, [0.7, 1, 1.2, 0.05])
    assert rail.parts == {"rail_arm": rail.joint_names}


def test_inverse_kinematics_reaches_its_pose(ur5: mobee.Robot) -> None:
    frame = "ee_link"
    q = np.random.default_rng(5).uniform(-2, 2, ur5.dof)
    pose = ur5.fk(q, frame)
    scene = mobee.Scene(ur5)
    found = ur5.ik(pose, frame, scene=scene)
    assert found
    for solution in found:
        assert np.allclose(ur5.fk(solution.q, frame), pose, atol=2e-3)
        assert solution.position_error < 1e-4 and solution.angle_error < 1e-3
        assert scene.free(solution.q)
    assert np.array_equal(ur5.ik(pose, frame, scene=scene)[0].q, found[0].q), "equal seeds, equal answers"
    nearest = ur5.ik(pose, frame, seed=q)[0]
    assert np.allclose(nearest.q, q, atol=1e-3)
    # the orientation by its two spellings, and none
    w, x, y, z = 0.5, 0.5, 0.5, 0.5
    a = ur5.ik(frame=frame, position=(0.3, 0.2, 0.4), quat_xyzw=(x, y, z, w))
    b = ur5.ik(frame=frame, position=(0.3, 0.2, 0.4), quat_wxyz=(w, x, y, z))
    assert np.array_equal(a[0].q, b[0].q)
    assert ur5.ik(frame=frame, position=(0.3, 0.2, 0.4))
    assert ur5.ik(frame=frame, position=(9.0, 0, 0)) == []


def test_an_import_is_cached_and_the_same(repository: Path, tmp_path: Path) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text((repository / "tests/data/bent_arm.urdf").read_text())
    steps: list[str] = []
    first = mobee.load(urdf, poses=300, progress=lambda step, share: steps.append(step))
    again = mobee.load(urdf, poses=300, progress=lambda step, share: pytest.fail("imported again"))
    anew = mobee.load(urdf, poses=300, cache=False)
    for other in (again, anew):
        assert other.notes == first.notes and other.warnings == first.warnings
        assert np.array_equal(other.home, first.home)
        q = np.random.default_rng(1).uniform(first.lower, first.upper, (500, first.dof))
        assert np.array_equal(mobee.Scene(other).free(q), mobee.Scene(first).free(q))
    saved = tmp_path / "arm.xml"
    first.save(saved)
    with pytest.raises(mobee.MobeeError, match="exists already"):
        first.save(saved)
    assert mobee.load(saved).joint_names == first.joint_names


def test_errors_have_the_words_of_the_command_line(repository: Path, tmp_path: Path) -> None:
    urdf = tmp_path / "arm.urdf"
    urdf.write_text('<robot name="r">\n<link name="a"/>\n<joint name="j" type="revolute"><parent link="a"/><child link="b"/></joint></robot>')
    with pytest.raises(mobee.MobeeError) as caught:
        mobee.load(urdf)
    assert caught.value.code == "file"
    assert caught.value.message == "joint `j` names the link `b`, which does not exist"
    assert caught.value.place == f"{urdf}:3:1"
    assert caught.value.remedy == "correct the name, or add that link"
    assert str(urdf) in str(caught.value) and "help: correct" in str(caught.value)
    for path, options, code in [
        ("nowhere.urdf", {}, "file"),
        (repository, {}, "file"),
        (repository / "configs/robots/ur5.xml", {"srdf": "x.srdf"}, "options"),
        (repository / "configs/robots/ur5.xml", {"visual": True}, "options"),
        (repository / "configs/robots/ur5.xml", {"shapes": 20}, "options"),
        (urdf, {"overshoot": float("nan")}, "bounds"),
        (urdf, {"mesh_dirs": ["/nowhere"]}, "file"),
    ]:
        with pytest.raises(mobee.MobeeError) as caught:
            mobee.load(path, **options)  # type: ignore[arg-type]
        assert caught.value.code == code and caught.value.remedy
    ur5 = mobee.load(repository / "configs/robots/ur5.xml")
    with pytest.raises(mobee.MobeeError, match="forearm_link"):
        ur5.fk(ur5.home, "forearm_lnk")
