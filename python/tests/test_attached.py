"""Objects that a robot carries."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mobee

LINK = "ee_link"
WRIST = ["wrist_1_link", "wrist_2_link", "wrist_3_link"]
REST = np.array([0.0, -1.2, 1.2, 0.0, 0.0, 0.0])


def carrying(touch: list[str] = WRIST, **pose: object) -> mobee.World:
    world = mobee.World()
    world.add("floor", mobee.Box((4, 4, 0.1)), position=(0, 0, -0.3))
    world.add("rod", mobee.Box((0.04, 0.04, 0.5)), position=(3, 3, 3))
    world.attach("rod", LINK, touch=touch, **pose)  # type: ignore[arg-type]
    return world


def along_link(at: float = 0.3) -> np.ndarray:
    """The rod lengthens the flange, whose axis is y in a frame of a robot file."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    pose[1, 3] = at
    return pose


def test_an_attached_object_moves_with_its_link_and_collides(ur5: mobee.Robot) -> None:
    world = carrying(pose=along_link())
    assert world.attached == {"rod": LINK} and world.names == ["floor", "rod"]
    scene = mobee.Scene(ur5, world)
    bare = mobee.World()
    bare.add("floor", mobee.Box((4, 4, 0.1)), position=(0, 0, -0.3))
    without = mobee.Scene(ur5, bare)
    rng = np.random.default_rng(3)
    q = rng.uniform(ur5.lower, ur5.upper, (3000, ur5.dof))
    free, free_without = scene.free(q), without.free(q)
    assert not (free & ~free_without).any(), "with a rod nothing becomes free"
    lost = q[free_without & ~free]
    assert len(lost) > 100
    # what is lost touches the rod, and the rod alone: an oracle from the link's pose and the rod's corners
    for contacts in scene.contacts(lost[:200]):
        assert contacts and all("rod" in contact.a + contact.b for contact in contacts)
    corners = np.array([[x, y, z, 1] for x in (-0.02, 0.02) for y in (-0.02, 0.02) for z in (-0.25, 0.25)])
    lowest = np.array([(pose @ along_link() @ corners.T)[2].min() for pose in ur5.fk(lost, LINK)])
    floor = np.array([any("floor" in c.a + c.b for c in contacts) for contacts in scene.contacts(lost)])
    assert np.array_equal(floor, lowest <= -0.25 + 1e-9)


def test_what_may_touch_it_is_not_tested(ur5: mobee.Robot) -> None:
    inside = along_link(0.0)
    assert not mobee.Scene(ur5, carrying([], pose=inside)).free(REST)
    assert mobee.Scene(ur5, carrying(pose=inside)).free(REST)
    (part,) = ur5.parts
    assert mobee.Scene(ur5, carrying([part], pose=inside)).free(REST), "a part stands for its links"


def test_its_edges_are_proved_and_its_plans_respect_it(ur5: mobee.Robot) -> None:
    goal = REST + [1.2, 0, 0, 0, 0, 0]
    world = carrying(pose=along_link(0.3))
    tip = (ur5.fk((REST + goal) / 2, LINK) @ along_link(0.3))[:3, 3]
    world.add("post", mobee.Sphere(0.05), position=tip)
    scene = mobee.Scene(ur5, world, clearance=0.005)
    verdict = scene.edge(REST, goal)
    assert isinstance(verdict, mobee.Blocked) and verdict.by is not None
    assert {name.split("#")[0].split(":")[-1] for name in verdict.by} == {"rod", "post"}
    plan = scene.plan(REST, goal)
    assert isinstance(plan, mobee.Plan)
    assert all(isinstance(v, mobee.Free) for v in scene.edge(plan.path[:-1], plan.path[1:]))
    assert len(ur5.ik(ur5.fk(goal, LINK), LINK, seed=goal, scene=scene)) >= 1, "the scene has this robot"


def test_it_is_put_down_where_one_says(ur5: mobee.Robot) -> None:
    world = carrying(pose=along_link())
    with pytest.raises(mobee.MobeeError, match="attached to ee_link") as error:
        world.move("rod", position=(1, 1, 1))
    assert error.value.code == "attached"
    at = ur5.fk(REST + 0.5, LINK) @ along_link()
    carried = mobee.Scene(ur5, world)
    world.detach("rod", at)
    assert world.attached == {}
    added = mobee.World()
    added.add("floor", mobee.Box((4, 4, 0.1)), position=(0, 0, -0.3))
    added.add("rod", mobee.Box((0.04, 0.04, 0.5)), at)
    q = np.random.default_rng(3).uniform(ur5.lower, ur5.upper, (2000, ur5.dof))
    free = mobee.Scene(ur5, world).free(q)
    assert np.array_equal(free, mobee.Scene(ur5, added).free(q)) and not np.array_equal(free, carried.free(q))
    with pytest.raises(mobee.MobeeError, match="not attached"):
        world.detach("rod")


def test_links_are_looked_up_in_the_scene(ur5: mobee.Robot) -> None:
    world = carrying()
    world.attach("rod", "ee_lnk")
    with pytest.raises(mobee.MobeeError, match="no robot has such a link"):
        mobee.Scene(ur5, world)
    world.attach("rod", LINK, touch=["writs_1_link"])
    with pytest.raises(mobee.MobeeError, match="no frame") as error:
        mobee.Scene(ur5, world)
    assert error.value.place == "touch" and "wrist_1_link" in (error.value.remedy or "")
    with pytest.raises(mobee.MobeeError, match="cup"):
        world.attach("cup", LINK)
    world.attach("rod", LINK, robot="other")
    with pytest.raises(mobee.MobeeError, match="no robot has such a link"):
        mobee.Scene(ur5, world)


@pytest.mark.parametrize("turned", [False, True])
def test_its_pose_is_that_of_the_link_in_a_urdf(repository: Path, turned: bool) -> None:
    bent = mobee.load(repository / "tests/data/bent_arm.urdf", poses=200)
    assert any(not np.allclose(bent.fk(bent.home, frame)[:3, :3], np.eye(3)) for frame in bent.frames)
    rng = np.random.default_rng(5)
    pose = np.eye(4)
    pose[:3, 3] = 0.3, 0.2, -0.4
    if turned:
        pose[:3, :3] = [[0, -1, 0], [0, 0, -1], [1, 0, 0]]
    tested = 0
    for link in bent.frames:
        world = mobee.World()
        world.add("mark", mobee.Sphere(0.01), position=(5, 4, 3))
        world.add("tool", mobee.Box((0.02, 0.1, 0.4)))
        world.attach("tool", link, pose, touch=bent.frames)
        scene = mobee.Scene(bent, world)
        q = rng.uniform(bent.lower, bent.upper)
        mark = np.linalg.solve(bent.fk(q, link) @ pose, (5, 4, 3, 1))[:3]
        # the distance of the mark from the box, in the box's frame
        expected = np.linalg.norm(np.maximum(abs(mark) - (0.01, 0.05, 0.2), 0)) - 0.01
        found = [c.distance for c in scene.contacts(q, within=20.0) if "tool" in c.a + c.b and "mark" in c.a + c.b]
        if found:  # what hangs at the base is never tested
            assert found == [pytest.approx(expected, abs=1e-6)]
            tested += 1
    assert tested >= bent.dof


def test_what_may_touch_it_where_the_file_lists_no_pairs(repository: Path) -> None:
    icub = mobee.load(repository / "configs/robots/icub.xml")
    world = mobee.World()
    world.add("ball", mobee.Sphere(0.12))
    for touch, free in ([], False), (["left_arm"], False), (["right_arm"], True):
        world.attach("ball", "r_hand_dh_frame", touch=touch)
        assert mobee.Scene(icub, world).free(icub.home) == free, touch
