"""Variables and attributes that the data sets of architectures share."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cislunar.architecture.cost import CostFunction
from cislunar.errors import ConfigurationError
from cislunar.runtime.netcdf import variable
from cislunar.runtime.provenance import provenance

_LAMBDA_MEANING = (
    "1 / satellites",
    "1 / sum of satellites x stability index",
    "cumulative observability",
    "observations per target",
    "proximity to Earth and Moon",
    "1 if all orbits differ",
)


def dimensionless(**described: tuple[Any, Any, str]) -> dict[str, xr.Variable]:
    """Variables without a unit, from (dimensions, values, meaning) by name."""
    return {
        name: variable(dims, values, "1", meaning)
        for name, (dims, values, meaning) in described.items()
    }


def architecture_variables(
    orbit: np.ndarray, satellites: np.ndarray, cost: CostFunction
) -> dict[str, xr.Variable]:
    """Variables of one architecture: orbits and satellites of shape (slot,), J and its factors."""
    factors = zip(cost.factors(orbit, satellites), _LAMBDA_MEANING, strict=True)
    return dimensionless(
        orbit=("slot", orbit, "index into orbits/families.nc"),
        satellites=("slot", satellites, "satellites on the orbit"),
        J=((), cost.value(orbit, satellites), "figure of merit J; larger is better"),
        **{f"lambda_{k}": ((), *described) for k, described in enumerate(factors, start=1)},
    )


def phases_of(architecture: xr.Dataset) -> np.ndarray:
    """Phases of the satellites of each slot relative to the paper's, shares of the period (slot,).

    They are the optional variable `phase`, zero without it. Raises `ConfigurationError` if one is
    not within [0, 1].
    """
    if "phase" not in architecture:
        return np.zeros(architecture["orbit"].shape)
    phase = architecture["phase"].values
    if not np.all((phase >= 0.0) & (phase <= 1.0)):
        raise ConfigurationError(
            f"architecture {architecture.attrs.get('title', '')!r}: phase = {phase.tolist()} must "
            "be shares of the period, within 0 .. 1"
        )
    return phase


def history_variables(values: np.ndarray, satellites: np.ndarray) -> dict[str, xr.Variable]:
    """Variables of the course of a search: J and total satellites of shape (evaluation,)."""
    sizes = satellites.astype(np.int32)
    return dimensionless(
        J_history=("evaluation", values, "J of each evaluation"),
        satellites_history=("evaluation", sizes, "total satellites of each evaluation"),
    )


def architecture_attributes(
    visibility: xr.Dataset, title: str, settings: Mapping[str, Any], seed: int | None = None
) -> dict[str, Any]:
    """Global attributes of an architecture's data set, with those of the photometry of
    `visibility`."""
    kept = ("diffuse_reflection_coefficient", "visibility_magnitude", "n_steps")
    return provenance(title, settings=settings, seed=seed) | {
        key: visibility.attrs[key] for key in kept
    }
