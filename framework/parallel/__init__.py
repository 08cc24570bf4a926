"""Many independent computations on the cores of this machine or of a cluster, kept as they are finished.

Tasks go out in chunks that are the same whatever computes them, so that results do not depend on it. Open
`tasks` first; `workers` are its processes, `kept` holds finished chunks on disk.
"""

MAX_WORKERS = 1000  # processes
