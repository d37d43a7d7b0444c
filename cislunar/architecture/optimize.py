"""One signature for every optimiser of the architecture."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cislunar.architecture.coordinate_search import MultiStartResult, coordinate_search
from cislunar.architecture.hyperopt_search import HYPEROPT_METHODS, hyperopt_search
from cislunar.architecture.published import choose_members
from cislunar.architecture.result import SearchResult
from cislunar.architecture.tables import ArchitectureTables
from cislunar.errors import ConfigurationError

METHODS = (*HYPEROPT_METHODS, "exact", "published")


def optimize(
    tables: ArchitectureTables,
    *,
    method: str,
    rng: np.random.Generator,
    n_slots: int = 10,
    published: Sequence[tuple[str, int]] = (),
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> SearchResult:
    """Choose orbits and satellite counts so that J is largest.

    Parameters
    ----------
    tables : ArchitectureTables
        Tables of one target set.
    method : str
        "tpe", "atpe" or "random" (`cislunar.architecture.hyperopt_search`), "exact" (multi-start
        coordinate search, whose result `cislunar.architecture.optimality.certificate.certify`
        proves), or "published" (given families and counts, members free).
    rng : numpy.random.Generator
        Source of randomness.
    n_slots : int
        Number of orbits to choose; ignored by "published".
    published : sequence of (str, int)
        Families and counts of the method "published".
    progress : callable, optional
        Called with (done, total).
    **settings
        Settings of the method, handed on.

    Returns
    -------
    SearchResult

    Raises
    ------
    ConfigurationError
        If the method is not known.
    """
    if method in HYPEROPT_METHODS:
        return hyperopt_search(
            tables, method=method, rng=rng, n_slots=n_slots, progress=progress, **settings
        )
    if method == "exact":
        found = coordinate_search(tables, rng, n_slots=n_slots, progress=progress, **settings)
        return _flattened(found)
    if method == "published":
        return choose_members(tables, tuple(published), rng=rng, progress=progress, **settings)
    raise ConfigurationError(f"optimizer {method!r} is not known: use one of {list(METHODS)}")


def _flattened(found: MultiStartResult) -> SearchResult:
    """Restarts one after the other: J and size of the current architecture at each evaluation."""
    values, sizes = [], []
    for improvements in found.history:
        until = np.append(improvements[1:, 0], improvements[-1, 0] + 1)
        held = (until - improvements[:, 0]).astype(int)
        values.append(np.repeat(improvements[:, 1], held))
        sizes.append(np.repeat(improvements[:, 2], held))
    return SearchResult(
        orbit=found.orbit,
        satellites=found.satellites,
        cost=found.cost,
        history=np.concatenate(values),
        satellites_history=np.concatenate(sizes).astype(np.int64),
    )
