"""Stubs: complete, true of the module, and enough for strict checks of the examples."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parents[1]


def test_stubs_are_true_of_the_module(tmp_path: Path) -> None:
    # not from here: the sources have no compiled module
    done = subprocess.run([sys.executable, "-m", "mypy.stubtest", "mobee"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_examples_pass_strict_checks(tmp_path: Path) -> None:
    files = [str(PACKAGE / folder) for folder in ("examples", "benches")]
    command = [sys.executable, "-m", "mypy", "--strict", "--cache-dir", str(tmp_path), *files]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout


def test_every_public_thing_has_a_docstring() -> None:
    import mobee

    for name in mobee.__all__:
        thing = getattr(mobee, name)
        assert thing.__doc__, name
        for member, value in vars(thing).items() if isinstance(thing, type) else []:
            if not member.startswith("_") and callable(value):
                assert value.__doc__, f"{name}.{member}"
