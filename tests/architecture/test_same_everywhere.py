"""Decisive results do not depend on rounding: orbits change slightly, and machines differ.

``tests/data/fingerprint.json`` contains small results of one machine. Labels, architectures,
assignments and clusters must be equal on every other machine; real numbers must agree to a
tolerance (`TOLERANCES`). After an intended change of results, run
``python tests/architecture/test_same_everywhere.py``.
"""

import hashlib
import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cislunar.architecture.cost import CostFunction
from cislunar.architecture.hyperopt_search import hyperopt_search
from cislunar.architecture.optimality.certificate import certify
from cislunar.architecture.search_space import stability_order
from cislunar.architecture.tables import ArchitectureTables
from cislunar.orbits.families import observer_library
from cislunar.orbits.stability import stability_index
from cislunar.photometry.materials import PRINTED
from cislunar.targets.clustering import cluster
from cislunar.targets.sampling import SamplingSettings, sample_zero_velocity
from cislunar.tasking.closed_loop import run_closed_loop
from cislunar.tasking.demonstration import tracking_problem
from cislunar.tasking.planning.assignment import assign
from cislunar.visibility.counts import VisibilitySettings, count_visibility, observation_times

FINGERPRINT = Path(__file__).parents[1] / "data" / "fingerprint.json"
TOLERANCES = {"stability_index": 1e-6, "center": 1e-9, "value": 1e-9, "final_sigma": 1e-6}
"""Relative to the largest value: the stability index loses digits in the monodromy matrix, the
other quantities in sums and integrations over hours."""

# A processor that changes the last digits: no fused multiplication and no wide vectors; and another
# number of threads.
PLAIN_PROCESSOR = {
    "OPENBLAS_CORETYPE": "Nehalem",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-FMA",
    "OMP_NUM_THREADS": "4",
    "OPENBLAS_NUM_THREADS": "4",
}


def small_library():
    """Mirrored families and near-stable orbits, whose stability indices differ by rounding."""
    return observer_library({"Dragonfly_N": 4, "Dragonfly_S": 4, "Halo_L2_N": 7, "Halo_L2_S": 7})


def clusters():
    """Targets from a symmetric grid, whose points are equally far from many centers."""
    settings = SamplingSettings(angular_step_deg=20.0, radial_points=6)
    return cluster(sample_zero_velocity([2.91, 3.1, 3.4, 5.49], settings).position, 300, seed=4)


def searched(orbits, change=0.0):
    """Results of the searches and of the proof, with changed states and periods of the orbits."""
    rng = np.random.default_rng(8)
    state, period = (
        each * (1.0 + change * rng.uniform(-1.0, 1.0, each.shape))
        for each in (orbits.state, orbits.period)
    )
    times = observation_times(3.0, 2.0)
    sun = 389.0 * np.stack([np.cos(times), -np.sin(times), 0.0 * times], axis=-1)
    target = np.random.default_rng(1).uniform(-1.2, 1.2, (40, 3))
    counts = count_visibility(
        state, period, target, times, sun, VisibilitySettings(), max_satellites=3
    )
    index = np.array([stability_index(*each) for each in zip(state, period, strict=True)])
    tables = ArchitectureTables(
        counts.observations, counts.distance, index, orbits.family, len(times)
    )
    cost = CostFunction(tables)
    found = {"stability_index": index, "label": stability_order(index)}
    for method in ("tpe", "random"):
        run = hyperopt_search(
            cost, method=method, rng=np.random.default_rng(3), n_slots=3, max_evaluations=60
        )
        found |= {f"{method}_orbit": run.orbit_trials, f"{method}_satellites": run.satellites}
        found[f"{method}_value"] = run.history
    proof = certify(cost, np.random.default_rng(3), n_slots=3, epsilon=0.05, restarts=2)
    found |= {"exact_orbit": proof.near_orbit, "exact_satellites": proof.near_satellites}
    # many pairs of equal information, apart from the change
    pairs = np.round(counts.distance @ np.ones((3, 30)), 3) * (1.0 + change * rng.random((22, 30)))
    found["assignment"] = assign(pairs, "exact").target
    found["greedy"] = assign(pairs, "greedy").target
    return found


def fingerprint():
    """Small results by name, as lists and hashes."""
    grouped = clusters()
    scene, surfaces, epoch, ids, loop = tracking_problem(4, 6, PRINTED, duration_hours=3.0)
    tracked = run_closed_loop(scene, surfaces, epoch, ids, (0,), loop)
    found = searched(small_library()) | {
        "members": grouped.members,
        "center": grouped.center[:20],
        "tasking": tracked.assignment[0],
        "observed": tracked.valid[0].sum(axis=0),
        "final_sigma": tracked.sigma[0, -1].astype(float),
    }
    made = {name: np.asarray(value).tolist() for name, value in found.items()}
    made["cluster_of_points"] = hashlib.sha256(grouped.label.tobytes()).hexdigest()
    return made


def differences(found, expected):
    """Names of results that differ by more than their tolerances."""
    names = []
    for name, value in expected.items():
        kind = next((each for each in TOLERANCES if name.endswith(each)), None)
        if kind is None:
            same = found[name] == value
        else:
            scale = TOLERANCES[kind] * np.max(np.abs(value))
            same = np.shape(found[name]) == np.shape(value) and np.allclose(
                found[name], value, rtol=0.0, atol=scale
            )
        names += [] if same else [name]
    return names


def test_small_changes_of_the_orbits_change_no_choice():
    orbits = small_library()
    plain, changed = searched(orbits), searched(orbits, change=1e-12)
    assert not np.array_equal(plain["stability_index"], changed["stability_index"])
    assert np.argsort(plain["stability_index"]).tolist() != plain["label"].tolist()
    for name, value in plain.items():
        if name != "stability_index" and not name.endswith("value"):
            np.testing.assert_array_equal(changed[name], value, err_msg=name)


def test_results_are_those_of_another_machine():
    assert differences(fingerprint(), json.loads(FINGERPRINT.read_text())) == []


@pytest.mark.skipif(
    (sys.platform, platform.machine()) != ("linux", "x86_64"), reason="features of other processors"
)
def test_clusters_are_those_of_another_processor():
    program = (
        "from test_same_everywhere import clusters; import json;"
        "found = clusters(); print(json.dumps([found.label.tolist(), found.center.tolist()]))"
    )
    run = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | PLAIN_PROCESSOR,
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=True,
    )
    here, (label, center) = clusters(), json.loads(run.stdout)
    if np.array_equal(here.center, center):
        pytest.skip("this processor rounds as a plain one does")
    np.testing.assert_array_equal(here.label, label)
    np.testing.assert_allclose(here.center, center, rtol=0.0, atol=1e-12)


if __name__ == "__main__":
    FINGERPRINT.write_text(json.dumps(fingerprint(), separators=(",", ":")) + "\n")
