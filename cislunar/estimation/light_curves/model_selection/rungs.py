"""The models of a body between which its light curve decides, and the posterior over them.

The models, called rungs, differ in the prior standard deviations of shape, surface and reflection
law, from the assumed body to one that is known only roughly.
"""

from typing import NamedTuple

import numpy as np

from cislunar.estimation.light_curves.light_curve import LightCurveModel
from cislunar.estimation.light_curves.model_selection.correlated import Minimum, ModelError
from cislunar.estimation.light_curves.row_blocks import ROTATION
from cislunar.observation.body_parameters import BodyParameterPrior
from cislunar.runtime import Array

RUNGS = {
    "known": BodyParameterPrior(),
    "material": BodyParameterPrior(log_albedo=0.25, log_slope=0.25, logit_reflectance=0.5),
    "small deviations": BodyParameterPrior(
        log_albedo=0.25, log_slope=0.25, logit_reflectance=0.5, log_axis_scale=0.1,
        log_facets=0.2, phong_share=0.7, lommel_seeliger_share=0.5, phase_slope=0.1,
        phase_curvature=0.1,
    ),
    "other law": BodyParameterPrior(
        log_albedo=0.5, log_slope=0.5, logit_reflectance=1.0, log_axis_scale=0.1,
        log_facets=0.2, phong_share=0.7, lommel_seeliger_share=0.5, phase_slope=0.3,
        phase_curvature=0.3,
    ),
    "medium deviations": BodyParameterPrior(
        log_albedo=0.5, log_slope=0.35, logit_reflectance=1.0, log_axis_scale=0.2,
        log_facets=0.5, phong_share=0.7, lommel_seeliger_share=0.5, phase_slope=0.2,
        phase_curvature=0.2,
    ),
    "large deviations": BodyParameterPrior(
        log_albedo=0.5, log_slope=0.5, logit_reflectance=1.0, log_axis_scale=0.3,
        log_facets=1.0, phong_share=0.7, lommel_seeliger_share=0.5, phase_slope=0.3,
        phase_curvature=0.3,
    ),
}  # fmt: skip
"""Prior standard deviations of the models, apart from "other law" from the narrowest to the widest.
"other law" has the shape priors of "small deviations" and the law priors of "large deviations"."""

EXACT = ("known", "material")
"""Rungs that are fitted without a model error."""

WIDE = ("small deviations", "other law", "medium deviations", "large deviations")
"""Rungs that are also fitted with a model error."""

UNKNOWN_SHAPE = ("medium deviations", "large deviations")
"""Rungs with which the body frame is uncertain, because the shape is."""


class Candidate(NamedTuple):
    """A minimum of the cost, with its rung and its model error."""

    rung: str
    error: ModelError
    minimum: Minimum


class SelectedModel(NamedTuple):
    """Posterior of a light curve over models of the body.

    Attributes
    ----------
    candidates : tuple of Candidate
        Modes of the mixture, best first.
    weight : ndarray, shape (mode,)
        Their shares in the posterior, which sum to 1.
    log_evidence : dict of str to float
        Of each rung, before tempering, up to a common constant; -inf for a rung that was not
        fitted.
    model_error_mag : float
        Root mean square of the correlated model error over the posterior.
    tempering : float
        Exponent beta of the likelihood of the mixture; 1 without tempering.
    """

    candidates: tuple[Candidate, ...]
    weight: Array
    log_evidence: dict[str, float]
    model_error_mag: float
    tempering: float

    @property
    def noise_factor(self) -> float:
        """Factor of the best mode on the noise variance of the light curve's model; 1 if that is
        known."""
        return self.candidates[0].minimum.noise_factor

    @property
    def wide(self) -> bool:
        """Whether the rungs of `WIDE` were fitted."""
        return self.log_evidence[WIDE[-1]] > -np.inf

    @property
    def rung(self) -> str:
        """The rung of the greatest evidence."""
        return max(self.log_evidence, key=self.log_evidence.__getitem__)


def model_of_rung(model: LightCurveModel, rung: str) -> LightCurveModel:
    """The light-curve model with the surface deviations of a rung. The rotation deviations (inertia
    and torque) are those of the given model."""
    kinds, sigma = RUNGS[rung].surface_kinds(model.surface.areas.size)
    rotation = model.sigma[: ROTATION + model.rotation_kinds.size]
    return model._replace(sigma=np.concatenate([rotation, sigma]), surface_kinds=kinds)
