"""The notebooks run from beginning to end, and their code passes strict checks."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "examples/notebooks").glob("*.ipynb"))
NAMES = [notebook.stem for notebook in NOTEBOOKS]


def code(notebook: Path) -> list[str]:
    return ["".join(cell["source"]) for cell in json.loads(notebook.read_text())["cells"] if cell["cell_type"] == "code"]


def test_they_are_there() -> None:
    assert NAMES == ["a_policy_with_a_seat_belt", "check_a_million_poses", "plan_for_your_own_urdf", "what_undo_is_worth"]


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=NAMES)
def test_it_runs(notebook: Path) -> None:
    for module in ("nbclient", "ipykernel", "rerun", "gymnasium", "matplotlib"):
        pytest.importorskip(module, reason=f"{module} is not installed: pip install 'mobee[test]'")
    import nbclient
    import nbformat

    content = nbformat.read(notebook, as_version=4)
    nbformat.validate(content)
    resources = {"metadata": {"path": str(notebook.parent)}}
    nbclient.NotebookClient(content, timeout=120, kernel_name="python3", resources=resources).execute()
    texts = [output["text"] for cell in content.cells for output in cell.get("outputs", []) if output.get("name") == "stderr"]
    assert not any("Warning" in text for text in texts), texts


def test_their_code_passes_strict_checks(tmp_path: Path) -> None:
    files = []
    for notebook in NOTEBOOKS:
        files.append(tmp_path / f"{notebook.stem}.py")
        # a cell may end with what it displays
        files[-1].write_text("\n\n".join(code(notebook)) + "\n")
    done = subprocess.run([sys.executable, "-m", "mypy", "--strict", *map(str, files)], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
