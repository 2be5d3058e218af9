"""Hostile calls: an answer or an exception, and never an abort. In a process of its own, so that one would be seen."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

CALLS = 10_000
RUNS = 40


def test_no_call_aborts(tmp_path: Path) -> None:
    program = Path(__file__).with_name("fuzz.py")
    done = subprocess.run([sys.executable, str(program), str(CALLS), "1"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, f"{done.returncode}: {done.stderr[-2000:]}"
    assert f"{CALLS} calls" in done.stdout


def test_no_answer_of_an_agent_aborts(tmp_path: Path) -> None:
    program = Path(__file__).with_name("fuzz.py")
    command = [sys.executable, str(program), "agents", str(RUNS), "1"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, f"{done.returncode}: {done.stderr[-2000:]}"
    assert f"{RUNS} runs" in done.stdout


def test_no_answer_of_a_detector_aborts(tmp_path: Path) -> None:
    program = Path(__file__).with_name("fuzz.py")
    done = subprocess.run([sys.executable, str(program), "senses", "20", "1"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, f"{done.returncode}: {done.stderr[-2000:]}"
    assert "20 runs" in done.stdout and "deaths" in done.stdout and "sighted" in done.stdout


def test_no_driver_aborts(tmp_path: Path) -> None:
    program = Path(__file__).with_name("fuzz.py")
    done = subprocess.run([sys.executable, str(program), "drivers", "3000", "1"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, f"{done.returncode}: {done.stderr[-2000:]}"
    assert "3000 calls" in done.stdout and "reply: fine" in done.stdout
