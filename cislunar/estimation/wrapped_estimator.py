"""Estimators that run another estimator."""

from typing import Any

import numpy as np

from cislunar.estimation.estimator import Estimator, InitialEstimate
from cislunar.observation.target_surfaces import TargetSurfaces


class WrappedEstimator:
    """Runs the estimator `inner`, and has all attributes of it that a derived class lacks."""

    def __init__(self, inner: Estimator) -> None:
        self._inner = inner

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # while a copy is made there is no inner estimator yet
            raise AttributeError(name)
        return getattr(self._inner, name)

    def add(
        self,
        initial: InitialEstimate,
        surfaces: TargetSurfaces,
        rng: np.random.Generator | None = None,
        *,
        index: int | None = None,
        forces: tuple | None = None,
    ) -> None:
        """See `Estimator.add`."""
        self._inner.add(initial, surfaces, rng, index=index, forces=forces)
        self._added(initial.translation.shape[0], forces)

    def _added(self, n_new: int, forces: tuple | None) -> None:
        """Make room for new tracks; `forces` is the model of all tracks if it changes."""
