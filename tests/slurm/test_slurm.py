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
    tiny = (HERE.parent / "data/tiny.yaml").read_text(encoding="utf-8")
    configuration = tmp_path / "tiny.yaml"
    split = tiny.replace("\ntask2:\n", "\ntask2:\n  realization_jobs: true\n")
    assert split != tiny
    configuration.write_text(split, encoding="utf-8")
    cells = [f"results/compared/task2/A/random/{e}/nt4_dt60.nc" for e in ("mukf", "batch")]
    done = subprocess.run(
        [HERE / "run.sh", tmp_path / "slurm", configuration, *cells],
        cwd=HERE.parents[1],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    assert "0 differ" in done.stdout
