"""Estimators that run another estimator."""

from typing import Any

from cislunar.estimation.estimator import Estimator


class WrappedEstimator:
    """Runs the estimator `inner`, and has all attributes of it that a derived class lacks."""

    def __init__(self, inner: Estimator) -> None:
        self._inner = inner

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):  # while a copy is made there is no inner estimator yet
            raise AttributeError(name)
        return getattr(self._inner, name)
