"""Interface of force models, resolved by type when a kernel is compiled.

A force model is a NamedTuple of numbers and arrays, passed to every step together with the time.
Its class implements the functions below by `cislunar.compiled.implements`. Each kernel is compiled
for each model, without branches or calls by pointer in its loops, and is cached on disk. The
paper's model is `cislunar.dynamics.cr3bp`; another model is a further module of this kind.

Quantities that depend on time alone (such as the positions of bodies) belong into `at`, which is
evaluated once per stage for all states. Times and states are nondimensional, times since the epoch.
States are in the model's propagation frame: the rotating frame for the CR3BP; the barycentric
frame, J2000 axes, for ephemeris dynamics.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.compiled import for_all_others
from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.errors import ConfigurationError

CALM_STEP = 7e-3
"""Largest step of Dormand-Prince 5(4) relative to the time scale sqrt(d^3 / mass) of a primary.

With steps of 60 s it is reached 7,100 km from the Moon and 31,000 km from the Earth.
"""


class Nothing(NamedTuple):
    """An absent optional part of a model."""


def require_span(forces: tuple, first: float, last: float) -> None:
    """Raise a `ConfigurationError` for what is no force model, or if a model with a property `span`
    does not cover an interval."""
    if not hasattr(type(forces), "_fields"):
        raise ConfigurationError(
            f"forces = {forces!r}: give a force model of cislunar.dynamics, such as EARTH_MOON"
        )
    span = getattr(forces, "span", None)
    low, high = min(first, last), max(first, last)
    slack = 1e-9  # rounding of a converted time (0.4 ms)
    if span is not None and not (span[0] - slack <= low and high <= span[1] + slack):
        days = TIME_UNIT_S / SECONDS_PER_DAY
        raise ConfigurationError(
            f"forces: the table of bodies covers {span[0] * days:.4f} to {span[1] * days:.4f} days "
            f"after the epoch, not {low * days:.4f} to {high * days:.4f}; tabulate the bodies over "
            "the whole span"
        )


def of_targets(forces: tuple, targets: NDArray[np.int64]) -> tuple:
    """The model for some of the targets.

    Parameters
    ----------
    forces : NamedTuple
        Force model. One that has values for each target has a property `n_targets`, which is None
        if they are common, and a method `of_targets`.
    targets : ndarray of int, shape (n,)
        Their indices.

    Returns
    -------
    NamedTuple
        `forces` itself, if its values are common to the targets.
    """
    common = getattr(forces, "n_targets", None) is None
    return forces if common else forces.of_targets(targets)


def require_targets(forces: tuple, n_targets: int | None) -> None:
    """Raise a `ConfigurationError` if a model has values for another number of targets, or, if this
    is None, for each target."""
    known = getattr(forces, "n_targets", None)
    if known not in (None, n_targets):
        fault = f"forces: the model has values for {known} targets"
        if n_targets is None:
            raise ConfigurationError(f"{fault}; pass one for all states, or use propagate_bundle")
        raise ConfigurationError(f"{fault}, not for {n_targets}; pass a model of all targets")


def at(forces, t):
    """Quantities of the model at a time: a NamedTuple, the first argument of the functions below. A
    model that does not depend on time returns itself."""
    raise NotImplementedError


@for_all_others
def of_state(field, i):
    """The field, or the model, for state i of a bundle, if its targets differ."""
    return field


@for_all_others
def plain(field):
    """The field without spatially localized effects, for the vectorized loop over a bundle."""
    return field


@for_all_others
def is_special(field, x, y, z):
    """Whether localized effects may act at a position."""
    return False


@for_all_others
def is_calm(field, x, y, z, dt):
    """Whether a step by a pair of order 5 has an error below 1e-10 per day; by default false."""
    return False


def acceleration(field, x, y, z, vx, vy, vz):
    """Acceleration (ax, ay, az) of one state."""
    raise NotImplementedError


def partials(field, x, y, z, vx, vy, vz):
    """Derivatives of the acceleration at a state, for `acceleration_change`."""
    raise NotImplementedError


def acceleration_change(derivatives, dx, dy, dz, dvx, dvy, dvz):
    """First-order change of the acceleration due to a small change of the state."""
    raise NotImplementedError
