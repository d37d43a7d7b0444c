"""Searches of a light curve for the modes of its posterior, outside of compiled code."""

from collections.abc import Sequence

import numpy as np

from cislunar.estimation.light_curves.batch_settings import SearchSettings
from cislunar.estimation.light_curves.hypotheses import prior_hypotheses, search
from cislunar.estimation.light_curves.light_curve import LightCurveModel
from cislunar.runtime import Array

_FIRST_ROWS, _GROWTH = 12, 1.5
"""Rows of the first search, and the factor by which the rows grow from search to search."""


def search_modes(
    data: Array,
    model: LightCurveModel,
    settings: SearchSettings,
    rng: np.random.Generator,
    known: Sequence[Array] = (),
) -> list[Array]:
    """Modes of a light curve, best first, by searches of a growing share of its rows. With `known`
    modes, such as those of a shorter light curve, a single search begins with them."""
    modes, rows = prior_hypotheses(settings.modes, model.sigma.size), 0
    if known:
        count = min(len(known), settings.modes)
        modes.u[:count], modes.count[0], rows = known[:count], count, len(data)
        modes.weight[:count] = 1.0 / count
        search(modes, data, model, settings._replace(starts=0, first_starts=0), rng, False)
        search(modes, data, model, settings, rng, False)
    while rows < len(data):
        rows = min(len(data), max(_FIRST_ROWS, int(_GROWTH * rows)))
        search(modes, data[:rows], model, settings, rng, False)
    return [u.copy() for u in modes.u[: modes.count[0]]]
