"""Rows of the catalog of periodic orbits: read, refused, and taken as targets."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from message_files import file_of, refused, spoil

from cislunar.dynamics.cr3bp import CR3BP
from cislunar.dynamics.propagation import propagate
from cislunar.exchange.catalog import CATALOG_COLUMNS, read_catalog
from cislunar.targets.tables import load_target_states

TRUTH = Path(__file__).parents[1] / "data/orbit_truth"


def catalog_rows():
    """Published rows in the form of the catalog's export."""
    truth = pd.concat(map(pd.read_csv, sorted(TRUTH.glob("*.csv"))), ignore_index=True)
    truth = truth[np.isfinite(truth["T"]) & (truth["closure_residual"] < 1e-10)].reset_index()
    table = pd.DataFrame({"Id": truth.index + 1})
    named = ("x0", "y0", "z0", "vx0", "vy0", "vz0", "JC", "T", "stability", "mu")
    for column, name in zip(CATALOG_COLUMNS, named, strict=True):
        table[column] = truth[name].fillna(1.0)
    return table


def test_a_row_of_the_catalog_closes_after_its_period(tmp_path):
    path = tmp_path / "rows.csv"
    catalog_rows().to_csv(path, index=False)
    rows = read_catalog(path)
    assert len(rows.name) > 20
    for state, period, mu in zip(rows.state, rows.period, rows.mu, strict=True):
        end = propagate(state, [period], forces=CR3BP(mu), method="dop853")[0]
        assert np.linalg.norm(end - state) < 1e-9


@pytest.mark.parametrize(
    "old, new, message",
    [
        (r"x0 \(LU\)", "x0 (km)", r"row 1: no column x0 \(LU\); export .* units LU and TU"),
        (r"Period \(TU\)", "Period (days)", r"no column Period \(TU\)"),
        ("0.0121505856", "0.0000030035", "Mass ratio = 3.00.* is not that of Earth and Moon"),
        (r"\n2,", r"\n1,", "row 3, orbit '1': the Id is taken already in row 2"),
        (r"\n1,[^,]*", r"\n1,far", "row 2, .* x0 .* = 'far' must be a finite number"),
        (r"\n1,[^,]*,", r"\n1,", "row 2: 10 fields where the header has 11"),
        (r"(?s)\n.*", "\n", "contains no orbit"),
    ],
)
def test_a_faulty_row_is_refused_in_a_line(tmp_path, old, new, message):
    path = file_of(tmp_path, spoil(catalog_rows().to_csv(index=False), old, new), "rows.csv")
    refused(read_catalog, path, message)


def test_targets_are_read_from_the_catalog(tmp_path):
    path = tmp_path / "rows.csv"
    catalog_rows().to_csv(path, index=False)
    found, rows = load_target_states(path), read_catalog(path)
    np.testing.assert_array_equal(found.state, rows.state)
    np.testing.assert_array_equal(found.period, rows.period)
    assert found.name == rows.name
