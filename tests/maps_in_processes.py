"""Maps that other processes compute, and what they leave on disk."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
FILES = ("map.json", "map.npz", "map.csv")

SCRIPT = """
import os, signal, sys
from pathlib import Path
import numpy as np
import robots
from framework.atlas.map_files import setup_document, write_map
from framework.atlas.quantities import choose_quantities
from framework.atlas.survey import Window
from framework.atlas.workspace_map import workspace_map
from framework.numerics.kept import KeptChunks
from framework.numerics.tasks import executor_of

if __name__ == "__main__":
    out, workers, dask, lasts = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3] or None, int(sys.argv[4])
    robot = robots.load("five_bar", flexibility="flexible_links")
    quantities = choose_quantities(robot, None)
    window = Window((0, 1), np.array([-0.3, -0.4]), np.array([0.3, 0.5]), (120, 60), robot.reference.x)
    kept = KeptChunks.of(out, setup_document(robot, window, quantities))
    keep = KeptChunks.keep

    def keep_or_die(*given):
        keep(*given)
        if len(list(out.glob(".crossing-kept-*/*.npz"))) == lasts:
            os.kill(os.getpid(), signal.SIGKILL)

    KeptChunks.keep = keep_or_die
    with executor_of(workers=workers, dask=dask) as executor:
        found = workspace_map(robot, window, executor=executor, keeper=kept)
    write_map(found, out)
"""


def begun(out, workers=1, dask="", lasts=-1):
    """Begin a map; its process is killed as soon as `lasts` bands are kept."""
    script = out.parent / "script.py"
    script.write_text(SCRIPT)
    out.mkdir(exist_ok=True)
    return subprocess.Popen(
        [sys.executable, str(script), str(out), str(workers), dask, str(lasts)], env=ENVIRONMENT
    )


def kept(out):
    return sorted(Path(out).glob(".crossing-kept-*/*.npz"))


def files(out):
    return [(out / name).read_bytes() for name in FILES]
