"""A configuration with many seeds: `python a_sweep_of_seeds.py FILE SEEDS [SECONDS] [BACKEND]`. Judged by all invariants, and counted.

For `configs/behaviors/reach-arm.toml` that is a benchmark of reaching, for `configs/behaviors/torture.toml` a torture without faults. Stop it
when you like: it goes on from `NAME-sweep.jsonl`.
"""

import functools
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import mobee


def trial(file: str, seconds: float, seed: int) -> dict[str, Any]:
    folder = Path(tempfile.mkdtemp(prefix="mobee-sweep-"))
    run = mobee.run(file, seed=seed, clock="virtual", for_s=seconds, out=folder / "run")
    verdict = run.check()
    counters = run.summary["counters"]
    row = {name: counters[name] for name in ("commits", "committed", "rolled_back", "faulted", "hard_contacts", "hard_contact_depth_mm")}
    row |= {"done": counters["done"], "hash": run.hash, "violations": [f"{v.invariant} at {v.at:.3f} s: {v.text}" for v in verdict.violations]}
    shutil.rmtree(folder)
    return row


def main(file: str, seeds: int, seconds: float = 60.0, backend: Any = "threads") -> int:
    results = f"{Path(file).stem}-sweep.jsonl"
    rows = mobee.sweep(functools.partial(trial, file, seconds), range(seeds), backend=backend, results=results)
    good = [row for row in rows if row["ok"]]
    broken = [row for row in good if row["violations"]]
    for name in ("commits", "committed", "rolled_back", "faulted", "hard_contacts"):
        print(f"{name:15} {sum(row[name] for row in good)}")
    print(f"{len(good)} of {len(rows)} runs ended in order, {len(broken)} with violations: {results}")
    for row in rows:
        if not row["ok"] or row["violations"]:
            print(f"seed {row['seed']}: {row['error'] or row['violations'][0]}")
    return int(len(good) < len(rows) or bool(broken))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2]), *map(float, sys.argv[3:4]), *sys.argv[4:5]))
