"""Maps and studies through a local dask cluster are those of one process, byte for byte."""

import subprocess
import sys

import pytest

from tests.maps_in_processes import ENVIRONMENT, begun, files
from tests.urdf_edits import parametric_five_bar
from tests.witness.installed import witness

pytestmark = pytest.mark.slow  # in processes of this program alone: test_cli_map.py


@pytest.fixture(scope="module")
def distributed():
    return witness("distributed", "distributed", extra="dask")  # its import takes two seconds


@pytest.fixture(scope="module")
def address(distributed):
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
    ) as cluster:
        yield cluster.scheduler_address


def test_a_map_is_the_same(address, tmp_path):
    for name, dask in (("serial", ""), ("dask", address)):
        assert begun(tmp_path / name, dask=dask).wait() == 0
    assert files(tmp_path / "dask") == files(tmp_path / "serial")


def test_a_study_by_command_is_the_same(address, tmp_path):
    file = parametric_five_bar(tmp_path)
    command = [sys.executable, "-m", "framework", "map", str(file), "--study", "--size", "12"]
    for name, more in (("serial", []), ("dask", ["--dask", address])):
        subprocess.run([*command, "--out", tmp_path / name, *more], env=ENVIRONMENT, check=True)
    for name in ("study.json", "study.npz", "study.csv"):
        assert (tmp_path / "dask" / name).read_bytes() == (tmp_path / "serial" / name).read_bytes()


def test_a_scheduler_without_workers_is_refused_in_bounded_time(distributed, tmp_path):
    with distributed.LocalCluster(
        n_workers=0, processes=False, dashboard_address=":0", protocol="tcp"
    ) as cluster:
        command = [sys.executable, "-m", "framework", "map", "five_bar", "--dask", cluster.scheduler_address]
        refused = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=120)
    assert refused.returncode == 2
    assert f"the scheduler at {cluster.scheduler_address} has no workers" in refused.stderr
