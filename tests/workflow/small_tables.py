"""Tables as the campaign writes them, with few rows."""

import pandas as pd

from cislunar.campaign.readings.photometry import photometry_table
from workflow.documents.blocks import BLOCKS
from workflow.documents.claims.judges import BEYOND, NOT_REPRODUCED, PARTLY, REPRODUCED, Claim
from workflow.documents.results_page import LISTED

MATERIAL = {
    "diffuse_weight": 0.5,
    "specular_weight": 0.5,
    "diffuse_albedo": 0.5,
    "rms_slope": 0.3,
    "normal_reflectance": 0.5,
}


def cell_rows(values, **more):
    """Every quantity of the lists of cells, and one that they do not show."""
    cell = {"scenario": "A", "architecture": "tpe", "estimator": "mukf", "targets": 20}
    rows = [
        cell | {"variant": None, "interval_minutes": 60, "quantity": quantity, "part": part or None}
        | {"unit": unit} | values | more
        for quantity, part, unit in [*(c.measure for c in LISTED.values()), ("failed", "", "1")]
    ]  # fmt: skip
    return pd.DataFrame(rows)


def small_tables():
    """Tables as the campaign writes them, with few rows."""
    claims = [
        ("section 3", "orbits", "302", "302", "equal", REPRODUCED, "302", "evidence", "-"),
        (
            "section 5.1",
            "J | A",
            "1.5e-4",
            "7e-5",
            "within a factor 10",
            PARTLY,
            "7e-5",
            "evidence",
            "10 evaluations",
        ),
        ("section 5.1", "satellites", "20", "44", "equal", NOT_REPRODUCED, "44", "evidence", "-"),
        ("-", "optimum", "-", "1e-3", "bound", BEYOND, "1e-3", "beyond", "-"),
    ]
    reading = {"usual": 1.0, "changed": 2.0, "difference": 1.0, "low": 0.5, "high": 1.5, "seeds": 9}
    return {
        "paper_vs_ours": pd.DataFrame(
            claims, columns=Claim._fields
        ),
        "architecture": pd.DataFrame(
            {
                "scenario": "A", "optimizer": "tpe", "family": ["Halo_L1_N", "Lyap_L3"],
                "satellites": [1, 4], "total_satellites": 5, "J": 1.5e-4,
                "union_coverage": 0.5, "never_seen": 2,
            }
        ),
        "label_comparison": pd.DataFrame({"labels": "index", "J": [1e-5, 2e-5, 4e-5]}),
        "readings_architecture": pd.DataFrame(
            {"reading": ["as configured"], "J_published": [1.5e-4], "J_random": [1e-5],
             "J_coordinate_search": [1e-3]}
        ),
        "readings_tracking": pd.concat(
            [
                cell_rows(reading, variant="process-noise"),
                cell_rows(reading | {"low": -0.5}, variant="fresnel"),
            ]
        ),
        "tracking": cell_rows(
            {"mean": 0.25, "low": 0.2, "high": 0.3, "largest": 0.75, "average": "arithmetic"}
        ),
        "model_error": pd.DataFrame({"variant": ["torque"]}),
        "photometry": photometry_table(MATERIAL, 18.0, 1),
        "run_times": pd.DataFrame(
            {"jobs": ["searches by TPE", "all"], "count": 4, "total_s": [1200.0, 2400.0],
             "median_s": 300.0, "longest_s": 400.0, "largest_mb": 350.0}
        ),
    }  # fmt: skip


def read_back(results, tables):
    """Tables as they come back from CSV."""
    return {
        name: pd.read_csv(results / f"tables/{name}.csv", dtype=str if "paper" in name else None)
        for name in tables
        if name != "run_times"
    }


def lines_of(block, tables):
    """The rows of the table of a block."""
    found = [line for line in BLOCKS[block](tables).splitlines() if line.startswith("| ")]
    return found[2:]
