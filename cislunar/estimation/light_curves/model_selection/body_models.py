"""The models of a body between which its light curve decides, and the posterior over them.

The body models differ in the prior standard deviations of shape, surface and reflection law, from
the assumed body to one that is known only roughly.
"""

from collections.abc import Iterable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cislunar.estimation.light_curves.light_curve import LightCurveModel
from cislunar.estimation.light_curves.model_selection.correlated import Minimum, ModelError
from cislunar.estimation.light_curves.row_blocks import ROTATION
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.runtime import Array

DROP = 12.0
"""Difference in log evidence from the best minimum beyond which a minimum is dropped."""
_STRONG = 3.0
"""Difference in log evidence that is strong evidence for a model (Kass & Raftery 1995)."""
_MOST_MODES = 32


class BodyModel(NamedTuple):
    """What a model assumes of a body.

    Attributes
    ----------
    prior : BodyParameterPrior
        Prior standard deviations of shape, surface and reflection law.
    tempering_mag : float or None
        Model error, mag, at which the exponent of the likelihood is 1/2 (empirical); None for a
        model that is fitted without a model error.
    unknown_shape : bool
        Whether the shape, and with it the body frame, is uncertain.
    """

    prior: BodyParameterPrior
    tempering_mag: float | None = None
    unknown_shape: bool = False


BODY_MODELS = {
    "known": BodyModel(BodyParameterPrior()),
    "material": BodyModel(
        BodyParameterPrior(log_albedo=0.25, log_slope=0.25, logit_reflectance=0.5)
    ),
    "small deviations": BodyModel(
        BodyParameterPrior(
            log_albedo=0.25, log_slope=0.25, logit_reflectance=0.5, log_axis_scale=0.1,
            log_facets=0.2, phong_share=0.7, lommel_seeliger_share=0.5, phase_slope=0.1,
            phase_curvature=0.1,
        ),
        tempering_mag=0.05,
    ),
    "other law": BodyModel(
        BodyParameterPrior(
            log_albedo=0.5, log_slope=0.5, logit_reflectance=1.0, log_scale=1.0, log_axis_scale=0.1,
            log_facets=0.2, phong_share=0.7, lommel_seeliger_share=0.5, phase_slope=0.3,
            phase_curvature=0.3,
        ),
        tempering_mag=0.02,
    ),
    "medium deviations": BodyModel(
        BodyParameterPrior(
            log_albedo=0.5, log_slope=0.35, logit_reflectance=1.0, log_scale=1.0,
            log_axis_scale=0.2, log_facets=0.5, phong_share=0.7, lommel_seeliger_share=0.5,
            phase_slope=0.2, phase_curvature=0.2,
        ),
        tempering_mag=0.05, unknown_shape=True,
    ),
    "large deviations": BodyModel(
        BodyParameterPrior(
            log_albedo=0.5, log_slope=0.5, logit_reflectance=1.0, log_scale=1.0, log_axis_scale=0.3,
            log_facets=1.0, phong_share=0.7, lommel_seeliger_share=0.5, phase_slope=0.3,
            phase_curvature=0.3,
        ),
        tempering_mag=0.05, unknown_shape=True,
    ),
}  # fmt: skip
"""The models by name, apart from "other law" from the narrowest to the widest. "other law" has the
shape priors of "small deviations" and the law priors of "large deviations"."""

_LARGE_MODEL_ERROR_MAG = 0.25

EXACT = tuple(name for name, body in BODY_MODELS.items() if body.tempering_mag is None)
"""Body models that are fitted without a model error only."""

WIDE = tuple(name for name, body in BODY_MODELS.items() if body.tempering_mag is not None)
"""Body models that are also fitted with a model error."""


class Candidate(NamedTuple):
    """A minimum of the cost, with its body model and its model error."""

    body: str
    error: ModelError
    minimum: Minimum

    @property
    def log_evidence(self) -> float:
        """Logarithm of the evidence, with the prior probability of the model error."""
        return self.minimum.log_evidence

    def with_share(self, share: float) -> "Candidate":
        """The candidate with a prior probability as a further factor of its evidence."""
        evidence = self.log_evidence + float(np.log(share))
        return self._replace(minimum=self.minimum._replace(log_evidence=evidence))


class SelectedModel(NamedTuple):
    """Posterior of a light curve over models of the body.

    Attributes
    ----------
    candidates : tuple of Candidate
        Modes of the mixture, best first.
    weight : ndarray, shape (mode,)
        Their shares in the posterior, which sum to 1.
    log_evidence : dict of str to float
        Of each body model, before tempering, up to a common constant; -inf for one that was not
        fitted.
    model_error_mag : float
        Root mean square of the correlated model error over the posterior.
    tempering : float
        Exponent beta of the likelihood of the mixture; 1 without tempering.
    untempered : tuple of Candidate
        Modes of the mixture without tempering, best first.
    wide : bool
        Whether the body models of `WIDE` were fitted, beyond the check of the narrow ones.
    """

    candidates: tuple[Candidate, ...]
    weight: Array
    log_evidence: dict[str, float]
    model_error_mag: float
    tempering: float
    untempered: tuple[Candidate, ...] = ()
    wide: bool = True

    @property
    def noise_factor(self) -> float:
        """Factor of the best mode on the noise variance of the light curve's model; 1 if that is
        known."""
        return self.candidates[0].minimum.noise_factor

    @property
    def body(self) -> str:
        """The body model of the greatest evidence."""
        return max(self.log_evidence, key=self.log_evidence.__getitem__)

    @property
    def unknown_shape(self) -> bool:
        """Whether that body model has an uncertain shape."""
        return BODY_MODELS[self.body].unknown_shape

    @property
    def unknown_body(self) -> bool:
        """Whether the shape is uncertain or the model error exceeds 0.25 mag."""
        return self.unknown_shape or self.model_error_mag > _LARGE_MODEL_ERROR_MAG


def by_evidence(candidates: Iterable[Candidate]) -> list[Candidate]:
    """The candidates, best first."""
    return sorted(candidates, key=lambda each: each.log_evidence, reverse=True)


def mixture(candidates: Iterable[Candidate]) -> tuple[tuple[Candidate, ...], Array]:
    """The likely candidates, best first, and their weights."""
    ordered = by_evidence(candidates)
    evidence = np.array([each.log_evidence for each in ordered])
    kept = min(int(np.sum(evidence > evidence[0] - DROP)), _MOST_MODES)
    weight = np.exp(evidence[:kept] - evidence[0])
    return tuple(ordered[:kept]), weight / weight.sum()


def wide_needed(candidates: Sequence[Candidate]) -> bool:
    """Whether there is strong evidence for a body model of `WIDE`."""
    wide, exact = (
        max((each.log_evidence for each in candidates if each.body in bodies), default=-np.inf)
        for bodies in (WIDE, EXACT)
    )
    return bool(wide - exact > _STRONG)


def with_body_model(model: LightCurveModel, body: str) -> LightCurveModel:
    """The light-curve model with the surface deviations of a body model. The rotation deviations
    (inertia and torque) are those of the given model."""
    kinds, sigma = _surface_deviations(body, model.surface.areas.size)
    rotation = model.sigma[: ROTATION + model.rotation_kinds.size]
    return model._replace(sigma=np.concatenate([rotation, sigma]), surface_kinds=kinds)


@cache
def _surface_deviations(body: str, n_facets: int) -> tuple[NDArray[np.int64], Array]:
    """Kinds and prior standard deviations of the surface deviations of a body model."""
    return BODY_MODELS[body].prior.surface_kinds(n_facets)
