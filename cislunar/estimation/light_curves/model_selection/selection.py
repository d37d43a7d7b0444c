"""Choice between models of a body by the evidence of its light curve.

The models of `cislunar.estimation.light_curves.model_selection.body_models` are fitted and weighted
by Laplace's approximation of the evidence. While a narrow one leaves residuals that are those of
the noise, the wider ones are left out if their evidence is much smaller, and fitted without a model
error if it is not much larger. Otherwise they are also fitted with a correlated model error of two
lengths, whose standard deviation is estimated. If the best model is then one of the wider ones, the
likelihood is tempered, because its model error is described only roughly. docs/attitude.md has the
equations.
"""

from collections.abc import Iterable, Sequence
from functools import partial

import numpy as np
from scipy.linalg import solve
from scipy.special import logsumexp

from cislunar.errors import ConfigurationError
from cislunar.estimation.light_curves.batch_settings import BatchSettings
from cislunar.estimation.light_curves.light_curve import LightCurveModel
from cislunar.estimation.light_curves.model_selection.body_models import (
    BODY_MODELS,
    DROP,
    EXACT,
    WIDE,
    Candidate,
    SelectedModel,
    by_evidence,
    mixture,
    wide_needed,
    with_body_model,
)
from cislunar.estimation.light_curves.model_selection.correlated import (
    MERGE_DISTANCE,
    Bins,
    CorrelatedFit,
    Minimum,
    ModelError,
    bins_of_rows,
    distinct_minima,
)
from cislunar.estimation.light_curves.model_selection.mode_search import search_modes
from cislunar.estimation.light_curves.model_selection.residual_tests import explains
from cislunar.estimation.light_curves.model_selection.rows import expected_rows
from cislunar.estimation.light_curves.model_selection.settings import ModelSelectionSettings
from cislunar.estimation.light_curves.row_blocks import MAGNITUDE, ROTATION, SEEN
from cislunar.runtime import Array
from cislunar.runtime.threads import single_threaded_algebra

_LEAST_TEMPERING = 0.9
_CLEARLY_LESS = 5.0
"""Difference in log evidence beyond which the wide body models are not fitted."""
_NO_ERROR = ModelError(0.0, 1.0)
_SCREENED = "medium deviations"
"""Body model that tells which modes are fitted with a model error."""
_REFITTED_SHARE = 0.99
"""Share of the posterior whose modes are fitted again to a longer light curve."""
_LARGEST_CHANGE = ROTATION + 4.0 * np.sqrt(2.0 * ROTATION)
"""Squared distance of a rotation from the previous ones, four standard deviations of chi squared
above its mean, beyond which it is a new one."""


def select_model(
    data: Array,
    model: LightCurveModel,
    rng: np.random.Generator,
    settings: ModelSelectionSettings | None = None,
    previous: SelectedModel | None = None,
    modes: Sequence[Array] = (),
) -> SelectedModel:
    """Choose between models of the body by the evidence of its light curve.

    Parameters
    ----------
    data : ndarray, shape (n, ROW_COLUMNS)
        Light curve, see `cislunar.estimation.light_curves.light_curve.cost`; detections only.
    model : LightCurveModel
        Initial rotation, assumed body, rotation deviations and noise. Its surface deviations are
        not used.
    rng : numpy.random.Generator
        Generator of the random starts.
    settings : ModelSelectionSettings, optional
        Settings with `effort` 1 if omitted.
    previous : SelectedModel, optional
        Earlier or preliminary result, whose modes are further starts in the place of some random
        ones.
    modes : sequence of ndarray, shape (p,)
        Modes of `model` with its own surface deviations, if they have been searched already. The
        body models of `EXACT` are then fitted from them, and not searched.

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
    with single_threaded_algebra():
        return _Selection(data, model, rng, settings, previous, modes).run()


def refitted(
    selected: SelectedModel,
    data: Array,
    model: LightCurveModel,
    rng: np.random.Generator,
    settings: ModelSelectionSettings,
) -> tuple[SelectedModel, bool]:
    """Fit and weight the likely models for a light curve that has grown, starting from their
    previous modes, with the model errors that were not improbable. The second value tells whether a
    search is not needed: the best has residuals of the noise or a model error below the largest
    possible one, it is near a previous mode, the body is as unknown as before, and there is no
    strong evidence for a model of `WIDE` that was fitted without a model error. Otherwise the
    likelihood is not tempered. See `select_model`."""
    likely, weight = mixture(selected.untempered)
    modes: dict[str, list[Minimum]] = {}
    for each in likely[: int(np.searchsorted(np.cumsum(weight), _REFITTED_SHARE)) + 1]:
        modes.setdefault(each.body, []).append(each.minimum)
    with single_threaded_algebra():
        selection, found = _Selection(data, model, rng, settings, selected), []
        errors = {
            (each.body, each.error.length, each.error.tau > 0.0): each for each in likely[::-1]
        }
        exact = not any(with_error for *_, with_error in errors)
        for body, error, first in errors.values():
            starts = [each.u for each in modes.get(body, ())]
            given = starts, settings.iterations, first.noise_factor
            found += selection.fit(body, error, *given, exact=exact)
        if not found:
            return selected, False
        grown, largest = selection.weighed(found), settings.model_errors_mag[1]
        best = grown.candidates[0]
        nearest = min(_distance(each, best.minimum.u) for each in likely)
        if (
            (0.0 < best.error.tau < largest or selection.explained(found))
            and nearest <= _LARGEST_CHANGE
            and grown.unknown_body == selected.unknown_body
            and not (exact and wide_needed(found))
        ):
            return selection.tempered(grown, found), True
        return grown, False


def narrowed(
    selected: SelectedModel,
    data: Array,
    model: LightCurveModel,
    settings: ModelSelectionSettings,
    modes: Sequence[Array] = (),
) -> tuple[SelectedModel, bool]:
    """The choice between the models of `EXACT` alone for a light curve that has grown, starting
    from their previous modes and those of the model, and whether the residuals of the best are
    those of the noise. See `select_model`."""
    rng = np.random.default_rng(0)  # no random start is drawn
    with single_threaded_algebra():
        selection = _Selection(data, model, rng, settings, selected, modes)
        given = settings.warm_iterations
        found = [each for body in EXACT for each in selection.near_modes(body, given)]
        if not found:
            return selected, False
        return selection.weighed(found, wide=False), selection.explained(found)


class _Selection:
    """Fits of one light curve. `known` has the modes of an earlier result, best first, and `apart`
    those of them that are not near one of the modes of the model."""

    def __init__(
        self,
        data: Array,
        model: LightCurveModel,
        rng: np.random.Generator,
        settings: ModelSelectionSettings,
        previous: SelectedModel | None = None,
        modes: Sequence[Array] = (),
    ) -> None:
        self.data, self.rng, self.settings = np.ascontiguousarray(data), rng, settings
        self.bins: Bins = bins_of_rows(data, settings.bins)
        self.models = {body: with_body_model(model, body) for body in BODY_MODELS}
        self.carried = ROTATION + model.rotation_kinds.size
        usual = BatchSettings().search_settings()
        self.search_settings = usual._replace(starts=settings.effort * usual.starts)
        self.known = () if previous is None else self._distinct(previous.candidates)
        self.known = self.known[: 2 * settings.kept_modes]
        self.model, self.modes = model, modes[: 2 * settings.kept_modes]
        self.apart = [each for each in self.known if not self._among_modes(each)]

    def fit(
        self,
        body: str,
        error: ModelError,
        starts: Iterable[Array],
        iterations: int,
        noise_factor: float = 1.0,
        *,
        exact: bool = False,
    ) -> list[Candidate]:
        """Distinct minima from the starts, best first. The evidence of a model of `WIDE` contains
        the prior probability of its model error, unless all models are taken as `exact`."""
        settings = self.settings
        given = self.data, self.bins, self.models[body], error, noise_factor
        fit = CorrelatedFit(*given, settings.model_errors_mag)
        found = distinct_minima(fit.refined(start, iterations) for start in starts)
        kept = [Candidate(body, error._replace(tau=each.tau), each) for each in found]
        return kept if exact else self._with_shares(kept)

    def _with_shares(self, found: list[Candidate]) -> list[Candidate]:
        """Minima with the prior probability of their kind of model error in the evidence. A model
        of `EXACT` has no such error."""
        none, lengths = self.settings.no_error_share, self.settings.lengths
        error = (1.0 - none) / len(lengths)
        return [
            each
            if each.body in EXACT
            else each.with_share(none if each.error.tau == 0.0 else error)
            for each in found
        ]

    def start(self, body: str, candidate: Candidate) -> Array:
        """A start for a body: the rotation of a minimum of another, and the surface deviations that
        both have."""
        return self._start(body, candidate.minimum.u, self.models[candidate.body])

    def _start(self, body: str, u: Array, model: LightCurveModel) -> Array:
        """`start` from the parameters of a model."""
        own = self.models[body]
        start = np.zeros(own.sigma.size)
        start[: self.carried] = u[: self.carried]
        _, to, of = np.intersect1d(own.surface_kinds, model.surface_kinds, return_indices=True)
        to, of = to + self.carried, of + self.carried
        start[to] = u[of] * model.sigma[of] / own.sigma[to]
        return start

    def run(self) -> SelectedModel:
        """See `select_model`."""
        kept = self.settings.kept_modes
        exactly = self._searched
        if self.modes:
            exactly = partial(self.near_modes, iterations=self.settings.iterations)
        found = {body: exactly(body) for body in EXACT}
        exact = [each for body in EXACT for each in found[body]]
        explained = self.explained(exact)
        if explained:
            checks = self._checks([each for body in EXACT for each in found[body][:kept]])
            greatest = max(each.log_evidence for each in exact)
            if all(each.log_evidence < greatest - _CLEARLY_LESS for each in checks):
                return self.weighed(exact + checks, wide=False)
        found |= {body: self._searched(body, exact=explained) for body in WIDE}
        everything = [each for body in BODY_MODELS for each in found[body]]
        if explained:
            if not wide_needed(everything):
                return self.weighed(everything)
            everything = self._with_shares(everything)
        pool = self._distinct([*by_evidence(everything), *self.known])[: 3 * kept]
        everything += self._with_errors(pool)
        return self.tempered(self.weighed(everything), everything)

    def explained(self, found: Sequence[Candidate]) -> bool:
        """Whether the best of some minima without a model error leaves residuals of the noise."""
        if not found:
            return False
        best = by_evidence(found)[0]
        model, u = self.models[best.body], best.minimum.u
        residual = self.data[:, MAGNITUDE] - expected_rows(u, self.data, model)[0]
        return explains(residual, self.data, model.noise_variance, model.noise_freedom, u.size)

    def _distinct(self, found: Sequence[Candidate]) -> list[Candidate]:
        """The first of each group of minima whose initial rotations agree within their uncertainty,
        in the order given."""
        kept: list[tuple[Candidate, Array]] = []
        for each in found:
            inverse = np.linalg.inv(each.minimum.information)[:ROTATION, :ROTATION]
            for other, covariance in kept:
                apart = each.minimum.u[:ROTATION] - other.minimum.u[:ROTATION]
                if apart @ solve(inverse + covariance, apart, assume_a="pos") < MERGE_DISTANCE:
                    break
            else:
                kept.append((each, inverse))
        return [each for each, _ in kept]

    def _among_modes(self, candidate: Candidate) -> bool:
        """Whether the initial rotation of a minimum is that of a mode within its uncertainty."""
        return any(_distance(candidate, mode) < MERGE_DISTANCE for mode in self.modes)

    def near_modes(self, body: str, iterations: int) -> list[Candidate]:
        """Minima, without a model error, near the known modes and those of the model."""
        starts = [self.start(body, each) for each in self.apart]
        starts += [self._start(body, each, self.model) for each in self.modes]
        return self.fit(body, _NO_ERROR, starts, iterations)

    def _searched(self, body: str, *, exact: bool = False) -> list[Candidate]:
        """Minima of a body model without a model error, by a search. For `exact` see `fit`."""
        known = [self.start(body, each) for each in self.known]
        modes = search_modes(self.data, self.models[body], self.search_settings, self.rng, known)
        return self.fit(body, _NO_ERROR, modes, self.settings.iterations, exact=exact)

    def _checks(self, exact: list[Candidate]) -> list[Candidate]:
        """Minima of the narrowest model of `WIDE` near those of `EXACT`. If their evidence is much
        smaller, the models of `WIDE` are not fitted."""
        settings, body = self.settings, WIDE[0]
        found: list[Candidate] = []
        for error in (_NO_ERROR, ModelError(settings.check_error_mag, settings.lengths[0])):
            starts = [self.start(body, each) for each in self._distinct(exact)]
            found += self.fit(body, error, starts, settings.iterations)
        return found

    def weighed(self, everything: list[Candidate], *, wide: bool = True) -> SelectedModel:
        """The mixture of all minima, without tempering."""
        evidence = np.array([each.log_evidence for each in everything])
        of_body = {}
        for body in BODY_MODELS:
            own = [each.log_evidence for each in everything if each.body == body]
            of_body[body] = float(logsumexp(own)) if own else -np.inf
        share = np.exp(evidence - logsumexp(evidence))
        model_error = float(np.sqrt(share @ np.array([each.error.tau for each in everything]) ** 2))
        likely, weight = mixture(everything)
        return SelectedModel(likely, weight, of_body, model_error, 1.0, likely, wide)

    def tempered(self, selected: SelectedModel, everything: list[Candidate]) -> SelectedModel:
        """The mixture of all minima, which is given, or of those of a tempered likelihood if a
        model of `WIDE` has the greatest evidence and the model error is not small."""
        beta = 1.0
        if selected.body in WIDE:
            scale = BODY_MODELS[selected.body].tempering_mag
            beta = 1.0 / (1.0 + (selected.model_error_mag / scale) ** 2)
        if beta > _LEAST_TEMPERING:
            return selected
        likely, weight = mixture(self._tempered(everything, beta))
        return selected._replace(candidates=likely, weight=weight, tempering=beta)

    def _with_errors(self, pool: list[Candidate]) -> list[Candidate]:
        """Minima of the models of `WIDE` with a model error of both correlation lengths, from the
        modes of all models. One of them tells the modes that are fitted with the others."""
        settings, found = self.settings, []
        for length in settings.lengths:
            error = ModelError(settings.first_error_mag, length)
            for body in (_SCREENED, *(each for each in WIDE if each != _SCREENED)):
                starts = [self.start(body, each) for each in pool]
                fitted = self.fit(body, error, starts, settings.iterations)[: settings.kept_modes]
                found += fitted
                if body == _SCREENED:
                    pool = fitted or pool
        return found

    def _tempered(self, everything: list[Candidate], beta: float) -> list[Candidate]:
        """Minima of the tempered likelihood, for the best model error of each likely body model."""
        settings = self.settings
        ordered = by_evidence(everything)
        chosen: dict[str, Candidate] = {}
        for each in ordered:
            if each.log_evidence >= ordered[0].log_evidence - DROP and each.error.tau > 0.0:
                chosen.setdefault(each.body, each)
        found: list[Candidate] = []
        for body, each in chosen.items():
            error = each.error._replace(beta=beta)
            kind = body, error.length, True
            starts = [
                e.minimum.u
                for e in everything
                if (e.body, e.error.length, e.error.tau > 0.0) == kind
            ]
            starts += [self.start(body, other) for other in self.known]
            model = self.models[body]
            factor = each.minimum.noise_factor
            white = CorrelatedFit(self.data, self.bins, model, each.error, factor)
            variance = white.equal_white_noise(each.minimum.u) / beta
            flat = model._replace(noise_variance=variance, noise_freedom=0.0)
            few = self.search_settings._replace(modes=settings.new_starts)
            starts += search_modes(self.data, flat, few, self.rng, starts)
            for _ in range(0 if self.known else settings.new_starts):
                start = np.zeros(model.sigma.size)
                start[: self.carried] = self.rng.standard_normal(self.carried)
                starts.append(start)
            found += self.fit(body, error, starts, settings.iterations, factor)
        return found


def _distance(candidate: Candidate, u: Array) -> float:
    """Squared distance of an initial rotation from that of a minimum, in its variances."""
    covariance = np.linalg.inv(candidate.minimum.information)[:ROTATION, :ROTATION]
    apart = u[:ROTATION] - candidate.minimum.u[:ROTATION]
    return float(apart @ solve(covariance, apart, assume_a="pos"))
