"""Force models: what the integrators ask of them, chosen by type when a kernel is compiled.

A force model is a NamedTuple of numbers and arrays, passed to every step with the time. Its class
implements the functions below, so that a kernel is compiled for each model without a branch
or a call by pointer in its loops, and is cached on disk like any other. `cislunar.dynamics.cr3bp`
is the model of the paper; another is added beside it by
`cislunar.compiled.implements` alone.

What depends on time alone (where bodies are) belongs into `at`, which is evaluated once for a stage
and all states that share it. Times and states are nondimensional, times since the epoch. Where the
primaries are is asked of the model's `mu`, the mass ratio of its frame.
"""

from typing import NamedTuple

from cislunar.compiled import for_all_others
from cislunar.constants import SECONDS_PER_DAY, TIME_UNIT_S
from cislunar.errors import ConfigurationError

CALM_STEP = 7e-3
"""Step of Dormand-Prince 5 over the time scale sqrt(d^3 / mass) of a primary, at most.

At steps of 60 s that is 7 100 km from the Moon and 31 000 km from the Earth."""


class Nothing(NamedTuple):
    """A part that a model lacks."""


def require_span(forces: tuple, first: float, last: float) -> None:
    """Refuse a propagation beyond the times a model has data for, its property `span` if any."""
    span = getattr(forces, "span", None)
    low, high = min(first, last), max(first, last)
    slack = 1e-9  # rounding of a time converted there and back (0.4 ms)
    if span is not None and not (span[0] - slack <= low and high <= span[1] + slack):
        days = TIME_UNIT_S / SECONDS_PER_DAY
        raise ConfigurationError(
            f"forces: the table of bodies covers {span[0] * days:.4f} to {span[1] * days:.4f} days "
            f"after the epoch, not {low * days:.4f} to {high * days:.4f}; tabulate the bodies over "
            "the whole span"
        )


def at(forces, t):
    """What acts at a time: a NamedTuple, the field the other three functions take first.

    A model that does not depend on time returns itself.
    """
    raise NotImplementedError


@for_all_others
def of_state(field, i):
    """The field as state i of a bundle feels it: the same, unless a model says otherwise.

    A model whose targets differ implements it; of the model itself it makes that of one target.
    """
    return field


@for_all_others
def plain(field):
    """The field without what acts in few places, for the loop over a bundle that vectorises."""
    return field


@for_all_others
def is_special(field, x, y, z):
    """Whether at a place the plain field may not be all that acts."""
    return False


@for_all_others
def is_calm(field, x, y, z, dt):
    """Whether a step from a place is exact enough by a pair of order 5: an error below 1e-10 a day.

    Unless a model knows, it is not.
    """
    return False


def acceleration(field, x, y, z, vx, vy, vz):
    """Acceleration (ax, ay, az) of one state."""
    raise NotImplementedError


def partials(field, x, y, z, vx, vy, vz):
    """Derivatives of the acceleration at a state, a tuple for `acceleration_change`."""
    raise NotImplementedError


def acceleration_change(derivatives, dx, dy, dz, dvx, dvy, dvz):
    """Change of the acceleration, to first order, by a small change of the state."""
    raise NotImplementedError
