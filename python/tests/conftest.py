from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

import mobee

REPOSITORY = Path(__file__).parents[2]
# what is imported here is imported anew, and kept from the user's own
os.environ["XDG_CACHE_HOME"] = tempfile.mkdtemp(prefix="mobee-tests-")


@pytest.fixture(scope="session")
def repository() -> Path:
    return REPOSITORY


@pytest.fixture(scope="session")
def ur5() -> mobee.Robot:
    return mobee.load(REPOSITORY / "configs/robots/ur5.xml")


@pytest.fixture(scope="session")
def rail() -> mobee.Robot:
    """Two joints that slide, two that turn."""
    return mobee.load(REPOSITORY / "tests/data/rail_arm.urdf", poses=500)
