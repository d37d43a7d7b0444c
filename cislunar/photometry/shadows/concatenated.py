"""Shadow tables of several bodies, concatenated."""

from collections.abc import Sequence

import numpy as np

from cislunar.errors import ConfigurationError
from cislunar.photometry.shadows.table import CLEAR, Shadows, no_shadows


def joined_shadows(tables: Sequence[Shadows]) -> Shadows:
    """Shadow tables of several bodies as one table; equal tables are stored once.

    Parameters
    ----------
    tables : sequence of Shadows
        One for each body.

    Returns
    -------
    Shadows
        With a `column` for the facets of all bodies, one body after the other.

    Raises
    ------
    ConfigurationError
        If the tables have different steps.
    """
    # tables of some facets of the same bodies share their arrays
    distinct = {id(each.lookup): each for each in tables if each.steps > 0}
    none = no_shadows(0)
    if len({each.steps for each in distinct.values()}) > 1:
        raise ConfigurationError("shadow table steps must be the same for all bodies")
    if len(distinct) <= 1:
        (table,) = distinct.values() or [none]
        return table._replace(column=np.concatenate([each.column for each in tables]))
    starts, lookups, settled, masks, shares = {}, [], [], [none.masks], [none.shares]
    width, found = 0, len(none.shares)
    for key, each in distinct.items():
        starts[key] = width
        # each word of `settled` belongs to one body
        spare = -each.lookup.shape[1] % 64
        shifted = np.where(each.lookup > CLEAR, each.lookup + (found - 2), each.lookup)
        lookups.append(np.pad(shifted, ((0, 0), (0, spare))))
        settled.append(each.settled)
        masks.append(each.masks[2:])
        shares.append(each.shares[2:])
        width += each.lookup.shape[1] + spare
        found += len(each.masks) - 2
    column = [np.where(t.column >= 0, t.column + starts.get(id(t.lookup), 0), -1) for t in tables]
    return Shadows(
        next(iter(distinct.values())).steps,
        np.concatenate(column),
        np.ascontiguousarray(np.concatenate(lookups, axis=1), dtype=np.int32),
        np.concatenate(masks),
        np.concatenate(shares),
        np.ascontiguousarray(np.concatenate(settled, axis=2)),
    )
