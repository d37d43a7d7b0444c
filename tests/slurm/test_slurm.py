"""A few cells on a Slurm of one node, the same as without; only where it is asked for."""

import os
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent


@pytest.mark.workflow
@pytest.mark.skipif(
    os.environ.get("CISLUNAR_SLURM") != "1",
    reason="sets up a Slurm cluster as root; asked for by CISLUNAR_SLURM=1",
)
def test_cells_are_the_same_on_slurm(tmp_path):
    cells = [f"results/compared/task2/A/random/mukf/nt{n}_dt60.nc" for n in (4, 5)]
    done = subprocess.run(
        [HERE / "run.sh", tmp_path / "slurm", HERE.parent / "data/tiny.yaml", *cells],
        cwd=HERE.parents[1],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    assert "0 differ" in done.stdout
