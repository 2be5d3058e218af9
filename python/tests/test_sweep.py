"""Sweeps: a row for each seed, whatever happens to its call; a sweep that was killed goes on."""

from __future__ import annotations

import functools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mobee

TORTURE = Path(__file__).parents[2] / "configs/behaviors/torture.toml"


def square(seed: int) -> dict[str, Any]:
    if seed == 3:
        raise ArithmeticError("three is odd")
    return {"square": seed * seed, "array": np.arange(seed), "share": np.float64(0.5)}


def power(exponent: int, seed: int) -> int:
    return int(seed**exponent)


def dies(seed: int) -> int:
    if seed == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return seed


def check_squares(rows: list[dict[str, Any]]) -> None:
    assert [row["seed"] for row in rows] == [5, 3, 0]
    assert [row["ok"] for row in rows] == [True, False, True]
    assert rows[0]["square"] == 25 and rows[0]["array"] == [0, 1, 2, 3, 4] and rows[0]["share"] == 0.5
    assert rows[1]["error"] == "ArithmeticError: three is odd" and "in square" in rows[1]["traceback"]
    assert all(row["seconds"] >= 0.0 for row in rows)


@pytest.mark.parametrize("backend", ["threads", "processes"])
def test_each_seed_has_a_row_and_a_failure_is_only_its_own(backend: Any, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    file = tmp_path / "rows.jsonl"
    rows = mobee.sweep(square, [5, 3, 0], backend=backend, workers=2, results=file, progress=lambda *done: seen.append(done))
    check_squares(rows)
    assert seen == [(0, 3), (1, 3), (2, 3), (3, 3)]
    stored = [json.loads(line) for line in file.read_text().splitlines()]
    assert stored[0] == {"sweep": "square"} and sorted(stored[1:], key=lambda row: -row["seed"]) == rows


def test_ray() -> None:
    ray = pytest.importorskip("ray", reason="Ray is not installed: pip install ray")
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    # tests are no module that workers could import
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, runtime_env={"env_vars": {"PYTHONPATH": os.pathsep.join([*sys.path, str(Path(__file__).parent)])}})
    try:
        check_squares(mobee.sweep(square, [5, 3, 0], backend="ray"))
        rows = mobee.sweep(dies, [1, 2], backend="ray", workers=1)
        assert [row["ok"] for row in rows] == [True, False] and "process ended" in rows[1]["error"]
        assert ray.is_initialized(), "a cluster of one's own stays"
    finally:
        ray.shutdown()


def test_the_death_of_a_process_is_the_result_of_its_seed() -> None:
    rows = mobee.sweep(dies, range(5), backend="processes", workers=2)
    assert [row["ok"] for row in rows] == [True, True, False, True, True]
    assert rows[2]["error"] == "the process ended: signal 9"


def test_a_sweep_that_was_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text("""
import os, signal, sys, time
import mobee
def slow(seed):
    open(f"called-{seed}", "a").write("x")
    if seed == 5 and "again" not in sys.argv:
        os.kill(os.getpid(), signal.SIGKILL)
    return seed
if __name__ == "__main__":
    print([row["value"] for row in mobee.sweep(slow, range(8), workers=1, results="rows.jsonl")])
""")
    done = subprocess.run([sys.executable, program], cwd=tmp_path, timeout=60)
    assert done.returncode == -signal.SIGKILL
    # cut off in the middle of a line
    file = tmp_path / "rows.jsonl"
    file.write_text(file.read_text() + '{"seed": 5, "ok": tr')
    done = subprocess.run([sys.executable, program, "again"], cwd=tmp_path, timeout=60, capture_output=True, text=True)
    assert done.stdout == "[0, 1, 2, 3, 4, 5, 6, 7]\n", done.stderr
    assert [len((tmp_path / f"called-{seed}").read_text()) for seed in range(8)] == [1, 1, 1, 1, 1, 2, 1, 1]


def test_failures_are_called_again_only_on_request(tmp_path: Path) -> None:
    calls: list[int] = []

    def mends(seed: int) -> int:
        calls.append(seed)
        if len(calls) < 3:
            raise OSError("not yet")
        return seed

    file = tmp_path / "rows.jsonl"
    for retry, expected in ((False, [False, False]), (False, [False, False]), (True, [True, True])):
        rows = mobee.sweep(mends, [1, 2], workers=1, results=file, retry=retry)
        assert [row["ok"] for row in rows] == expected
    assert len(calls) == 4
    assert [row["value"] for row in mobee.sweep(mends, [2, 1], results=file)] == [2, 1]
    # further seeds are added
    assert [row["ok"] for row in mobee.sweep(mends, [7, 1], results=file)] == [True, True] and calls[4:] == [7]


def test_ctrl_c_ends_a_sweep_at_once(tmp_path: Path) -> None:
    for backend in ("threads", "processes"):
        program = tmp_path / f"{backend}.py"
        program.write_text(f"""
import time
import mobee
def waits(seed):
    open("begun-{backend}", "w").close()
    time.sleep(0 if seed == 0 else 2)
    return seed
if __name__ == "__main__":
    try:
        mobee.sweep(waits, range(100), backend="{backend}", workers=1, results="{backend}.jsonl")
    except KeyboardInterrupt:
        print("ended", flush=True)
""")
        process = subprocess.Popen([sys.executable, program], cwd=tmp_path, stdout=subprocess.PIPE, text=True)
        until = time.monotonic() + 30
        file = tmp_path / f"{backend}.jsonl"
        while time.monotonic() < until and not (file.exists() and len(file.read_text().splitlines()) == 2):
            time.sleep(0.01)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=20)
        assert out == "ended\n" and len(file.read_text().splitlines()) == 2


def test_a_program_without_a_guard_is_told(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text("""
import mobee
def same(seed):
    return seed
try:
    mobee.sweep(same, [1], backend="processes")
except mobee.MobeeError as e:
    print(e.code, e.remedy)
""")
    done = subprocess.run([sys.executable, program], cwd=tmp_path, timeout=60, capture_output=True, text=True)
    assert done.stdout.startswith("processes call sweep below `if __name__"), done.stdout + done.stderr


def test_results_of_another_function_or_file_are_refused_and_stay_as_they_are(tmp_path: Path) -> None:
    file = tmp_path / "rows.jsonl"
    mobee.sweep(functools.partial(power, 2), [1, 2], results=file)
    assert [row["value"] for row in mobee.sweep(functools.partial(power, 2), [1, 2], results=file)] == [1, 4]
    for content, code in (
        (file.read_bytes(), "sweep"),
        (b"notes of mine", "file"),
        (b"notes of mine\n", "file"),
        (b'{"sweep": "power(3)"}\nnotes\n', "file"),
        (b'{"sweep": "power(3)"}\n{"seed": 1}\n', "file"),
        (b"\xff\xfe\n", "file"),
    ):
        file.write_bytes(content)
        with pytest.raises(mobee.MobeeError) as caught:
            mobee.sweep(functools.partial(power, 3), [1], results=file)
        assert caught.value.code == code and caught.value.remedy and str(file) in str(caught.value.place)
        assert file.read_bytes() == content
    file.write_text("")
    lines: list[str] = []

    def inner(seed: int) -> int:
        with pytest.raises(mobee.MobeeError) as caught:
            mobee.sweep(square, [1], results=file)
        lines.append(caught.value.code)
        return seed

    mobee.sweep(inner, [1], results=file)
    assert lines == ["busy"]


@pytest.mark.parametrize(
    ("arguments", "options", "code", "place"),
    [
        ((None, [1]), {}, "type", "fn"),
        ((square, 5), {}, "type", "seeds"),
        ((square, [1, 2.5]), {}, "type", "seeds[1]"),
        ((square, [True]), {}, "type", "seeds[0]"),
        ((square, [1, 2, 1]), {}, "twice", "seeds[2]"),
        ((square, [1]), {"backend": "clouds"}, "unknown", "backend"),
        ((square, [1]), {"workers": 0}, "bounds", "workers"),
        ((square, [1]), {"results": "no/such/folder/rows"}, "file", "no/such/folder/rows"),
        ((lambda seed: seed, [1]), {"backend": "processes"}, "pickle", "fn"),
    ],
)
def test_what_is_wrong_is_named(arguments: Any, options: Any, code: str, place: str) -> None:
    with pytest.raises(mobee.MobeeError) as caught:
        mobee.sweep(*arguments, **options)
    assert (caught.value.code, caught.value.place) == (code, place) and caught.value.remedy


def test_the_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(mobee.MobeeError, match="Ray is not installed"):
        mobee.sweep(square, [1], backend="ray")


def test_a_result_that_is_no_row_is_a_failure() -> None:
    for result in ({"seed": 1}, {1: 2}, object(), [{1j}]):
        (row,) = mobee.sweep(lambda seed, result=result: result, [1])  # type: ignore[misc]
        assert not row["ok"] and "MobeeError" in row["error"]
    assert mobee.sweep(square, []) == []


def run(seed: int) -> dict[str, Any]:
    run = mobee.run(TORTURE, seed=seed, for_s=5, set=['clock="virtual"'], out=Path(os.environ["MOBEE_TEST_RUNS"]) / str(seed))
    return {"hash": run.hash, "holds": bool(run.check())}


@pytest.mark.filterwarnings("ignore::mobee.MobeeWarning")
def test_runs_in_threads_equal_runs_in_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tables = []
    for backend in ("threads", "processes"):
        monkeypatch.setenv("MOBEE_TEST_RUNS", str(tmp_path / backend))
        rows = mobee.sweep(run, range(3), backend=backend, workers=2)  # type: ignore[arg-type]
        assert all(row["ok"] and row["holds"] for row in rows), rows
        tables.append([row["hash"] for row in rows])
    assert tables[0] == tables[1] and len(set(tables[0])) == 3


def test_the_example_judges_runs_and_goes_on(tmp_path: Path) -> None:
    example = Path(__file__).parents[1] / "examples/a_sweep_of_seeds.py"
    outs = []
    for seeds in ("2", "3"):
        command = [sys.executable, "-W", "ignore", str(example), str(TORTURE), seeds, "3"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stdout + done.stderr
        outs.append(done.stdout)
    assert "2 of 2 runs ended in order, 0 with violations" in outs[0] and "3 of 3" in outs[1]
    assert len((tmp_path / "torture-sweep.jsonl").read_text().splitlines()) == 4
