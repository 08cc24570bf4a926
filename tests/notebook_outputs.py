"""Run a notebook, and hold what it prints against the outputs stored in it: `make notebooks`.

    python -m tests.notebook_outputs [--write] NOTEBOOK

`--write` stores what came out instead. Words have to be the same. Numbers may differ by one unit of their
last digit printed, or a millionth, as kernels of BLAS differ; what is rounding, or one over it, may be any
such number. A cell tagged `times` prints how long something took: its numbers are not compared. One tagged
`rounding` shows what rounding, or programs that need not be here, make of a task: nothing of it is.
"""

import argparse
import json
import os
import re
import sys
from itertools import zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

NUMBER = re.compile(r"([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)")
ROUNDING = 1e-9  # sizes of closures, tails and misfits, whose values are noise
ALIKE = 1e-6  # relative; iterations end nearer than that to one another on any processor
TIMES, NOISE = "times", "rounding"  # tags of cells
TIMEOUT = 600  # [s] of a cell


def differences(stored: str, fresh: str, *, times: bool = False) -> list[str]:
    """Return what of a cell's text is not as it was."""
    pairs = zip_longest(NUMBER.split(stored), NUMBER.split(fresh), fillvalue="")
    return [
        f"{old.strip()!r} is {new.strip()!r} now"
        for k, (old, new) in enumerate(pairs)
        if not (_same_number(old, new, times) if k % 2 and old and new else old.split() == new.split())
    ]


def _same_number(old: str, new: str, times: bool) -> bool:
    a, b = float(old), float(new)
    size = max(abs(a), abs(b))
    rounding = size < ROUNDING or min(abs(a), abs(b)) > 1.0 / ROUNDING
    return times or rounding or abs(a - b) <= max(1.01 * min(_unit(old), _unit(new)), ALIKE * size)


def _unit(number: str) -> float:
    """Return the value of one in the last digit printed."""
    mantissa, _, exponent = number.lower().partition("e")
    return float(10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2])))


def texts(notebook: dict[str, Any]) -> list[tuple[str, list[str]]]:
    """Return what each cell of code has printed, pictures left out, and its tags."""
    return [
        ("".join(_text(output) for output in cell["outputs"]), cell["metadata"].get("tags", []))
        for cell in notebook["cells"]
        if cell["cell_type"] == "code"
    ]


def _text(output: dict[str, Any]) -> str:
    data = output.get("data", {})
    found = output.get("text", "" if any("image" in kind for kind in data) else data.get("text/plain", ""))
    return "".join(found)


def execute(file: Path) -> dict[str, Any]:
    """Run a notebook in its folder; return it with its outputs as they come."""
    import nbformat
    from nbclient import NotebookClient
    from traitlets.config import Config

    notebook = nbformat.read(file, as_version=4)
    with (
        TemporaryDirectory() as folder
    ):  # of the kernel's sockets: two kernels at once may draw the same port
        NotebookClient(
            notebook,
            config=Config(KernelManager={"transport": "ipc", "ip": f"{folder}/kernel"}),
            timeout=TIMEOUT,
            coalesce_streams=True,
            record_timing=False,
            resources={"metadata": {"path": str(file.parent)}},
        ).execute(env={**os.environ, "NO_COLOR": "1"})
    return json.loads(nbformat.writes(notebook))


def main() -> int:
    """Run one notebook; returns 1 if its outputs are not those stored."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("notebook", type=Path)
    parser.add_argument("--write", action="store_true", help="store what came out")
    options = parser.parse_args()
    stored, fresh = json.loads(options.notebook.read_text()), execute(options.notebook)
    if options.write:
        fresh["metadata"]["language_info"] = stored["metadata"]["language_info"]
        options.notebook.write_text(json.dumps(fresh, indent=1, ensure_ascii=False) + "\n")
        return 0
    changes = [
        f"{options.notebook}, cell of code {number}: {change}"
        for number, ((old, tags), (new, _)) in enumerate(zip(texts(stored), texts(fresh), strict=True), 1)
        if NOISE not in tags
        for change in differences(old, new, times=TIMES in tags)
    ]
    print("\n".join(changes) or f"{options.notebook}: prints what is stored")
    return 1 if changes else 0


if __name__ == "__main__":
    sys.exit(main())
