"""Force models: what the integrators ask of them, chosen by type when a kernel is compiled.

A force model is a NamedTuple of numbers and arrays, passed to every step with the time. Its class
implements the four functions below, so that a kernel is compiled for each model without a branch
or a call by pointer in its loops, and is cached on disk like any other. `cislunar.dynamics.cr3bp`
is the model of the paper; another is added beside it by
`cislunar.compiled.implements` alone.

What depends on time alone (where bodies are) belongs into `at`, which is evaluated once for a stage
and all states that share it. Times and states are nondimensional, times since the epoch. Where the
primaries are is asked of the model's `mu`, the mass ratio of its frame.
"""


def at(forces, t):
    """What acts at a time: a NamedTuple, the field the other three functions take first.

    A model that does not depend on time returns itself.
    """
    raise NotImplementedError


def acceleration(field, x, y, z, vx, vy, vz):
    """Acceleration (ax, ay, az) of one state."""
    raise NotImplementedError


def partials(field, x, y, z, vx, vy, vz):
    """Derivatives of the acceleration at a state, a tuple for `acceleration_change`."""
    raise NotImplementedError


def acceleration_change(derivatives, dx, dy, dz, dvx, dvy, dvz):
    """Change of the acceleration, to first order, by a small change of the state."""
    raise NotImplementedError
