"""Tasking methods compared on the same problems."""

import numpy as np
from small_cell_datasets import small_settings

from cislunar.campaign.settings.cells import Cell
from cislunar.campaign.tracking.cell import CellInputs
from cislunar.campaign.tracking.tasking_comparison import compared_dataset, concatenate_comparisons


def test_tasking_methods_are_compared_on_the_same_problems(sources):
    comparison = {
        "epochs": [0, 2],
        "runs": 2,
        "evaluations": [20, 5],
        "tpe_evaluations": 5,
        "sampler": "compiled",
        "early_stop": 100,
    }
    settings = small_settings()
    cells = [
        compared_dataset(
            Cell("A", "tpe", "mukf", n, 60),
            CellInputs(**sources),
            settings,
            comparison,
            propagator="dop853",
            seed=3,
        )
        for n in (4, 5)
    ]
    whole = concatenate_comparisons(cells)
    assert whole["information"].dims == ("cell", "search", "epoch", "run", "budget")
    best = whole["direct_information"].sel(direct="exact").values[:, None, :, None, None]
    assert np.nanmax(whole["information"].values - best) <= 1e-9
    random = whole.sel(search="random")
    np.testing.assert_array_equal(random["evaluations"].values[..., 1], 20)
    # a larger budget continues the smaller one
    np.testing.assert_allclose(
        random["information"].values[..., 0], random["history"].values[..., 4], rtol=1e-12
    )
    tpe = whole.sel(search="tpe")
    assert np.isnan(tpe["information"].values[..., 1]).all()
    assert np.isfinite(tpe["information"].values[..., 0]).all()
    assert (tpe["elapsed"].values[..., 0] > 0.0).all()
