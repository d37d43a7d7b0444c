"""An estimator whose targets are tested for maneuvers."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cislunar.estimation.estimator import Estimates, Estimator
from cislunar.estimation.maneuvers.likelihood_ratio import ManeuverEstimates, ManeuverTest
from cislunar.estimation.wrapped_estimator import WrappedEstimator
from cislunar.observation.records import Measurements


class MonitoredEstimator(WrappedEstimator):
    """An `Estimator` that runs another one, whose estimates it does not change, and tests them.

    Parameters
    ----------
    inner : Estimator
    test : ManeuverTest
    threshold : float
        Of the statistic, above which there is an alarm.
    """

    def __init__(self, inner: Estimator, test: ManeuverTest, threshold: float) -> None:
        super().__init__(inner)
        self._test, self.maneuver_threshold = test, threshold
        self._largest: ManeuverEstimates | None = None

    def advance(
        self,
        measurements: Measurements,
        *,
        covariance: bool = False,
        final: bool = True,
        histories: bool = True,
    ) -> Estimates:
        """See `Estimator.advance`. The test needs the orbits at every step, also without
        `histories`."""
        del histories
        start = self._inner.orbits()
        found = self._inner.advance(measurements, covariance=True, final=final)
        now, _ = self._test.advance(start, measurements, found)
        before = self._largest
        if before is not None:
            larger = now.statistic > before.statistic
            now = ManeuverEstimates(
                *(
                    np.where(larger.reshape(-1, *[1] * (new.ndim - 1)), new, old)
                    for new, old in zip(now, before, strict=True)
                )
            )
        self._largest = now
        return found if covariance else found._replace(covariance=found.covariance[:, :0])

    def tested_maneuvers(self) -> ManeuverEstimates:
        """The largest statistic of each target in the steps since the previous call, or since the
        number of targets changed."""
        found, self._largest = self._largest, None
        return self._test.nothing() if found is None else found

    def _added(self, n_new: int, forces: tuple | None) -> None:
        """See `WrappedEstimator`."""
        self._test.add(n_new, forces)
        self._largest = None

    def remove(self, targets: ArrayLike) -> None:
        """See `Estimator.remove`."""
        self._inner.remove(targets)
        self._test.remove(targets)
        self._largest = None
