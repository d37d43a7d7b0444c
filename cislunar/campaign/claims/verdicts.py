"""What the verdicts on tracking rest on: the sweeps of one architecture, trends and differences."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from cislunar.campaign.claims.architecture import NOT_REPRODUCED, PARTLY, REPRODUCED, Claim
from cislunar.campaign.tracking.statistics import Interval, log_interval, slopes, t_interval
from cislunar.campaign.tracking.summary import PARTS, cell_index, seed_values

Indices = NDArray[np.intp]

ARCHITECTURES = ("published", "tpe")
"""Architectures the claims are put to; the first one that was tracked decides."""

COVERAGE = 0.97
CONSISTENT = (0.8, 3.0)
DIVERGED_SHARE = 0.03
SATISFACTORY = (
    f"position and velocity: 3-sigma coverage at least {COVERAGE}, mean ANEES within "
    f"{CONSISTENT[0]} .. {CONSISTENT[1]}, at most {DIVERGED_SHARE:.0%} of observed targets "
    "diverged, as means over seeds (geometric ones of ANEES)"
)
"""What counts as satisfactory translation."""

TREND = "95 % interval over seeds of the least-squares slope per doubling"


class Finding(NamedTuple):
    """What one architecture says of a claim.

    Attributes
    ----------
    text : str
        The numbers.
    verdict : str
        What follows from them.
    """

    text: str
    verdict: str


@dataclass(frozen=True)
class Sweeps:
    """The cells of one scenario and architecture, with the usual settings.

    Attributes
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.
    scenario, architecture : str
    estimator : str
    interval : int
        Tasking interval of the sweep over the number of targets, min.
    """

    summary: xr.Dataset
    scenario: str
    architecture: str
    estimator: str = "mukf"
    interval: int = 60

    def by_targets(self) -> Indices:
        """Cells of the sweep over the number of targets."""
        return self._index(interval_minutes=self.interval)

    def by_interval(self, targets: int) -> Indices:
        """Cells of the sweep over the tasking interval."""
        return self._index(targets=targets)

    def cell(self, targets: int, interval: int | None = None) -> Indices:
        """One cell, or none."""
        return self._index(
            targets=targets, interval_minutes=self.interval if interval is None else interval
        )

    def all_cells(self) -> Indices:
        """Every cell."""
        return self._index()

    def _index(self, **wanted: int) -> Indices:
        return cell_index(
            self.summary,
            scenario=self.scenario,
            architecture=self.architecture,
            estimator=self.estimator,
            variant="",
            **wanted,
        )

    def values(self, index, quantity: str, part: str | None = None) -> NDArray[np.float64]:
        """Values per realization; ANEES as its decimal logarithm."""
        found = seed_values(self.summary, index, quantity, part)
        return np.log10(found) if quantity.startswith("anees") else found

    def trend(self, index: Indices, along: str, quantity: str, part: str | None = None) -> Interval:
        """Slope per doubling of `targets` or `interval_minutes`."""
        x = self.summary[along].values[index]
        return t_interval(slopes(x, self.values(index, quantity, part)))

    def change(self, index: Indices, quantity: str, part: str | None = None) -> Interval:
        """Last cell less the first one, realization by realization."""
        found = self.values(index, quantity, part)
        return t_interval(found[:, -1] - found[:, 0])

    def change_of_changes(
        self, first: Indices, second: Indices, quantity: str, part: str | None = None
    ) -> Interval:
        """How much more the second sweep changes from end to end than the first."""
        few, many = self.values(first, quantity, part), self.values(second, quantity, part)
        return t_interval((many[:, -1] - many[:, 0]) - (few[:, -1] - few[:, 0]))


def range_finding(values: NDArray[np.float64], paper: int) -> Finding:
    """Whether a count of the paper lies among those of the realizations.

    Parameters
    ----------
    values : ndarray, shape (seed,)
        Counts.
    paper : int
        The paper's.

    Returns
    -------
    Finding
        Reproduced if the paper's count lies in the range, partly if within one of it.
    """
    low, high = np.nanmin(values), np.nanmax(values)
    text = f"mean {t_interval(values).text('.2f')}, range {low:.0f} .. {high:.0f}"
    if low <= paper <= high:
        return Finding(text, REPRODUCED)
    return Finding(text, PARTLY if low - 1 <= paper <= high + 1 else NOT_REPRODUCED)


def graded(holds: Sequence[bool]) -> str:
    """Reproduced if everything holds, partly if something does."""
    return REPRODUCED if all(holds) else PARTLY if any(holds) else NOT_REPRODUCED


def unsatisfactory(sweeps: Sweeps, index: Indices, consistency: str = "anees_mean") -> list[str]:
    """Cells whose translation is not satisfactory (see `SATISFACTORY`), with the reason.

    Parameters
    ----------
    sweeps : Sweeps
    index : ndarray of int
        Cells.
    consistency : str
        Quantity the consistency is judged by.

    Returns
    -------
    list of str
    """
    failing = []
    for cell in index:
        reasons = []
        for part in PARTS[2:]:
            covered = t_interval(seed_values(sweeps.summary, cell, "coverage", part)).mean
            anees = log_interval(seed_values(sweeps.summary, cell, consistency, part)).mean
            if covered < COVERAGE:
                reasons.append(f"coverage of {part} {covered:.3f}")
            if not CONSISTENT[0] <= anees <= CONSISTENT[1]:
                reasons.append(f"ANEES of {part} {anees:.2f}")
        share = t_interval(seed_values(sweeps.summary, cell, "diverged_translation_share")).mean
        if share > DIVERGED_SHARE:
            reasons.append(f"{share:.1%} diverged")
        if reasons:
            targets = int(sweeps.summary["targets"].values[cell])
            minutes = int(sweeps.summary["interval_minutes"].values[cell])
            failing.append(f"{targets} targets, {minutes} min: {', '.join(reasons)}")
    return failing


def judged(
    summary: xr.Dataset,
    scenario: str,
    judge: Callable[[Sweeps], Finding | None],
    *,
    where: str,
    claim: str,
    paper: str,
    how: str,
) -> list[Claim]:
    """Put a claim to the architectures that were tracked.

    Parameters
    ----------
    summary : xarray.Dataset
        ``task2/summary.nc``.
    scenario : str
        Scenario of the claim.
    judge : callable
        Takes the sweeps of an architecture; None if they do not speak to the claim.
    where, claim, paper, how : str
        As in `Claim`.

    Returns
    -------
    list of Claim
        One claim, or none if no architecture speaks to it. The first of `ARCHITECTURES` that does
        decides.
    """
    found = {}
    for architecture in ARCHITECTURES:
        finding = judge(Sweeps(summary, scenario, architecture, interval=usual_interval(summary)))
        if finding is not None:
            found[architecture] = finding
    if not found:
        return []
    ours = "; ".join(f"{name}: {finding.text}" for name, finding in found.items())
    decisive, finding = next(iter(found.items()))
    rule = f"{how} (architecture {decisive} decides)"
    return [Claim(where, claim, paper, ours, rule, finding.verdict)]


def usual_interval(summary: xr.Dataset) -> int:
    """Tasking interval most cells have, min."""
    values, counts = np.unique(summary["interval_minutes"].values, return_counts=True)
    return int(values[np.argmax(counts)])
