"""Choice between models of a body by the evidence of its light curve.

The models, called rungs, differ in the prior standard deviations of shape, surface and reflection
law, from the assumed body to one that is known only roughly. All of them are fitted, the wider ones
also with a correlated model error of several standard deviations and correlation lengths, and
weighted by Laplace's approximation of the evidence. If the best model is one of the wider ones, the
likelihood is tempered, because its model error is described only roughly. docs/attitude.md has the
equations.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from threadpoolctl import threadpool_limits

from cislunar.errors import ConfigurationError
from cislunar.estimation.light_curves.batch_settings import BatchSettings, SearchSettings
from cislunar.estimation.light_curves.hypotheses import prior_hypotheses, search
from cislunar.estimation.light_curves.light_curve import LightCurveModel
from cislunar.estimation.light_curves.model_selection.correlated import (
    Bins,
    CorrelatedFit,
    Minimum,
    ModelError,
    bins_of_rows,
)
from cislunar.estimation.light_curves.model_selection.settings import ModelSelectionSettings
from cislunar.estimation.light_curves.row_blocks import ROTATION, SEEN
from cislunar.observation.body_parameters import BodyParameterPrior

Array = NDArray[np.float64]

RUNGS = {
    "known": BodyParameterPrior(),
    "material": BodyParameterPrior(log_albedo=0.25, log_slope=0.25, logit_reflectance=0.5),
    "small deviations": BodyParameterPrior(
        log_albedo=0.25, log_slope=0.25, logit_reflectance=0.5, log_axis_scale=0.1,
        log_facets=0.2, phong_share=0.7, lommel_seeliger_share=0.5, phase_slope=0.1,
        phase_curvature=0.1,
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
"""Prior standard deviations of the models, from the narrowest to the widest."""

EXACT = ("known", "material")
"""Rungs that are fitted without a model error."""

WIDE = ("small deviations", "medium deviations", "large deviations")
"""Rungs that are also fitted with a model error."""

UNKNOWN_SHAPE = ("medium deviations", "large deviations")
"""Rungs with which the body frame is uncertain, because the shape is."""

_TEMPERING_MAG = {"small deviations": 0.1, "medium deviations": 0.05, "large deviations": 0.05}
"""Model error, mag, at which the exponent of the likelihood is 1/2 (empirical)."""
_LEAST_TEMPERING = 0.9
_DROP = 12.0
"""Difference in log evidence from the best minimum beyond which a minimum is dropped."""
_CLEARLY_LESS = 5.0
"""Difference in log evidence beyond which the wide rungs are not fitted."""
_NO_ERROR = ModelError(0.0, 1.0)
_MOST_MODES = 32
_MERGE_DISTANCE = 2.0
_FIRST_ROWS, _GROWTH = 12, 1.5
"""Rows of the first search, and the factor by which the rows grow from search to search."""


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
    def rung(self) -> str:
        """The rung of the greatest evidence."""
        return max(self.log_evidence, key=self.log_evidence.__getitem__)


def model_of_rung(model: LightCurveModel, rung: str) -> LightCurveModel:
    """The light-curve model with the surface deviations of a rung. The rotation deviations (inertia
    and torque) are those of the given model."""
    kinds, sigma = RUNGS[rung].surface_kinds(model.surface.areas.size)
    rotation = model.sigma[: ROTATION + model.rotation_kinds.size]
    return model._replace(sigma=np.concatenate([rotation, sigma]), surface_kinds=kinds)


def search_modes(
    data: Array, model: LightCurveModel, settings: SearchSettings, rng: np.random.Generator
) -> list[Array]:
    """Modes of a light curve, best first, by searches of a growing share of its rows."""
    modes, rows = prior_hypotheses(settings.modes, model.sigma.size), 0
    while rows < len(data):
        rows = min(len(data), max(_FIRST_ROWS, int(_GROWTH * rows)))
        search(modes, data[:rows], model, settings, rng)
    return [u.copy() for u in modes.u[: modes.count[0]]]


def select_model(
    data: Array,
    model: LightCurveModel,
    rng: np.random.Generator,
    settings: ModelSelectionSettings | None = None,
) -> SelectedModel:
    """Choose between models of the body by the evidence of its light curve.

    Parameters
    ----------
    data : ndarray, shape (n, COLUMNS)
        Light curve, see `cislunar.estimation.light_curves.light_curve.cost`; detections only.
    model : LightCurveModel
        Initial rotation, assumed body, rotation deviations and noise. Its surface deviations are
        not used.
    rng : numpy.random.Generator
        Generator of the random starts.
    settings : ModelSelectionSettings, optional
        Settings with `effort` 1 if omitted.

    Returns
    -------
    SelectedModel

    Raises
    ------
    ConfigurationError
        If `effort` is 0, there are no rows, or a row is a non-detection.
    """
    settings = ModelSelectionSettings(effort=1) if settings is None else settings
    if settings.effort == 0:
        raise ConfigurationError("effort = 0: models are not chosen; set it to 1 or above")
    if len(data) == 0 or not np.all(data[:, SEEN] == 1.0):
        raise ConfigurationError(
            "light curve: the choice of a model needs detections and no other rows; leave out "
            "non-detections and targets that were never seen"
        )
    selection = _Selection(np.ascontiguousarray(data), model, rng, settings)
    with threadpool_limits(
        limits=1
    ):  # several threads are slower at this size, and round otherwise
        return selection.run()


def refitted(
    selected: SelectedModel, data: Array, model: LightCurveModel, settings: ModelSelectionSettings
) -> SelectedModel:
    """Fit the same models to a light curve that has grown, starting from their previous modes; see
    `select_model`."""
    rng = np.random.default_rng(0)  # no random start is drawn
    selection = _Selection(np.ascontiguousarray(data), model, rng, settings)
    modes: dict[tuple[str, ModelError], list[Minimum]] = {}
    for each in selected.candidates:
        modes.setdefault((each.rung, each.error), []).append(each.minimum)
    found = []
    with threadpool_limits(limits=1):  # see `select_model`
        for (rung, error), own in modes.items():
            given = [each.u for each in own], settings.warm_iterations, own[0].noise_factor
            found += selection.fit(rung, error, *given)
    candidates, weight = _mixture(found)
    return selected._replace(candidates=candidates, weight=weight)


class _Selection:
    """Fits of one light curve."""

    def __init__(
        self,
        data: Array,
        model: LightCurveModel,
        rng: np.random.Generator,
        settings: ModelSelectionSettings,
    ) -> None:
        self.data, self.rng, self.settings = data, rng, settings
        self.bins: Bins = bins_of_rows(data, settings.bins)
        self.models = {rung: model_of_rung(model, rung) for rung in RUNGS}
        self.carried = ROTATION + model.rotation_kinds.size
        usual = BatchSettings().search_settings()
        self.search_settings = usual._replace(starts=settings.effort * usual.starts)

    def fit(
        self,
        rung: str,
        error: ModelError,
        starts: Iterable[Array],
        iterations: int,
        noise_factor: float = 1.0,
    ) -> list[Candidate]:
        """Distinct minima from the starts, best first."""
        fit = CorrelatedFit(self.data, self.bins, self.models[rung], error, noise_factor)
        found = [fit.refined(start, iterations) for start in starts]
        if rung in WIDE:  # all model errors have equal prior probability
            settings = self.settings
            number = 1 + len(settings.model_errors_mag) * len(settings.lengths)
            found = [e._replace(log_evidence=e.log_evidence - np.log(number)) for e in found]
        found.sort(key=lambda each: -each.log_evidence)
        kept: list[Minimum] = []
        for each in found:
            apart = all(
                (each.u - other.u) @ other.information @ (each.u - other.u) >= _MERGE_DISTANCE
                for other in kept
            )
            if np.isfinite(each.log_evidence) and apart:
                kept.append(each)
        return [Candidate(rung, error, each) for each in kept]

    def start(self, rung: str, candidate: Candidate) -> Array:
        """A start for a rung: the rotation of a minimum of another, and its surface if it has the
        same parameters."""
        u, size = candidate.minimum.u, self.models[rung].sigma.size
        own, other = self.models[rung].sigma, self.models[candidate.rung].sigma
        if u.size == size:
            return u * other / own
        start = np.zeros(size)
        start[: self.carried] = u[: self.carried]
        return start

    def run(self) -> SelectedModel:
        """See `select_model`."""
        kept = self.settings.kept_modes
        found = {rung: self._searched(rung) for rung in EXACT}
        exact = [each for rung in EXACT for each in found[rung]]
        checks = self._checks([each for rung in EXACT for each in found[rung][:kept]])
        greatest = max((each.minimum.log_evidence for each in exact), default=-np.inf)
        if all(each.minimum.log_evidence < greatest - _CLEARLY_LESS for each in checks):
            return self._weighed(exact + checks)
        found |= {rung: self._searched(rung) for rung in WIDE}
        pool = [each for rung in RUNGS for each in found[rung][:kept]]
        everything = [each for rung in RUNGS for each in found[rung]]
        for rung in WIDE:
            everything += self._grid(rung, pool)
        return self._weighed(everything)

    def _searched(self, rung: str) -> list[Candidate]:
        """Minima of a rung without a model error, by a search."""
        settings = self.settings
        modes = search_modes(self.data, self.models[rung], self.search_settings, self.rng)
        return self.fit(rung, _NO_ERROR, modes, settings.iterations)

    def _checks(self, exact: list[Candidate]) -> list[Candidate]:
        """Minima of the narrowest wide rung near those of the exact ones. If their evidence is
        much smaller, the wide rungs are not fitted."""
        settings, rung = self.settings, WIDE[0]
        middle = settings.model_errors_mag[len(settings.model_errors_mag) // 2 - 1]
        found: list[Candidate] = []
        for error in (_NO_ERROR, ModelError(middle, settings.lengths[0])):
            starts = [self.start(rung, each) for each in exact]
            found += self.fit(rung, error, starts, settings.iterations)
        return found

    def _weighed(self, everything: list[Candidate]) -> SelectedModel:
        """The mixture of all minima, or of those of a tempered likelihood."""
        evidence = np.array([each.minimum.log_evidence for each in everything])
        of_rung = {}
        for rung in RUNGS:
            own = [each.minimum.log_evidence for each in everything if each.rung == rung]
            of_rung[rung] = float(logsumexp(own)) if own else -np.inf
        share = np.exp(evidence - logsumexp(evidence))
        tau = np.array([each.error.tau for each in everything])
        model_error = float(np.sqrt(share @ tau**2))
        best = max(of_rung, key=of_rung.__getitem__)
        beta = 1.0
        if best not in EXACT:
            beta = 1.0 / (1.0 + (model_error / _TEMPERING_MAG[best]) ** 2)
        if beta > _LEAST_TEMPERING:
            return SelectedModel(*_mixture(everything), of_rung, model_error, 1.0)
        tempered = self._tempered(everything, beta)
        return SelectedModel(*_mixture(tempered), of_rung, model_error, beta)

    def _grid(self, rung: str, pool: list[Candidate]) -> list[Candidate]:
        """Minima of a rung for all standard deviations and correlation lengths of the model error,
        from the modes of all rungs; only the best starts are fitted on the entire grid."""
        settings = self.settings
        starts = [self.start(rung, each) for each in pool]
        found: list[Candidate] = []
        for length in settings.lengths:
            middle = ModelError(
                settings.model_errors_mag[len(settings.model_errors_mag) // 2], length
            )
            screened = self.fit(rung, middle, starts, settings.iterations)[: settings.kept_modes]
            for direction in (1, -1):
                follow = screened
                taus = sorted(settings.model_errors_mag)
                place = taus.index(middle.tau)
                chain = taus[place + 1 :] if direction > 0 else taus[:place][::-1]
                for tau in chain:
                    begin = [each.minimum.u for each in follow]
                    error = ModelError(tau, length)
                    follow = self.fit(rung, error, begin, settings.warm_iterations)
                    found += follow
            found += screened
        return found

    def _tempered(self, everything: list[Candidate], beta: float) -> list[Candidate]:
        """Minima of the tempered likelihood, for the best model error of each likely rung."""
        settings = self.settings
        best = max(everything, key=lambda each: each.minimum.log_evidence)
        chosen: dict[str, Candidate] = {}
        for each in sorted(everything, key=lambda each: -each.minimum.log_evidence):
            behind = best.minimum.log_evidence - each.minimum.log_evidence
            if behind <= _DROP and each.rung not in EXACT:
                chosen.setdefault(each.rung, each)
        found: list[Candidate] = []
        for rung, each in chosen.items():
            error = each.error._replace(beta=beta)
            same = [
                other for other in everything
                if other.rung == rung and other.error == each.error
            ]  # fmt: skip
            starts = [other.minimum.u for other in same]
            model = self.models[rung]
            factor = each.minimum.noise_factor
            white = CorrelatedFit(self.data, self.bins, model, each.error, factor)
            known = {"noise_variance": white.equal_white_noise(each.minimum.u) / beta}
            known["noise_freedom"] = 0.0
            search_settings = self.search_settings._replace(modes=settings.new_starts)
            starts += search_modes(self.data, model._replace(**known), search_settings, self.rng)
            for _ in range(settings.new_starts):
                start = np.zeros(model.sigma.size)
                start[: self.carried] = self.rng.standard_normal(self.carried)
                starts.append(start)
            found += self.fit(rung, error, starts, settings.iterations, factor)
        return found


def _mixture(candidates: list[Candidate]) -> tuple[tuple[Candidate, ...], Array]:
    """The likely candidates, best first, and their weights."""
    ordered = sorted(candidates, key=lambda each: -each.minimum.log_evidence)
    evidence = np.array([each.minimum.log_evidence for each in ordered])
    kept = min(int(np.sum(evidence > evidence[0] - _DROP)), _MOST_MODES)
    weight = np.exp(evidence[:kept] - evidence[0])
    return tuple(ordered[:kept]), weight / weight.sum()
