"""Candidate pairs of tracks and detections over a window of exposures.

The unscented transform of each track's orbit is propagated over the window. The direction that an
exposure measures is then linear in the standardized deviation of the track's state at the begin of
the window, with a covariance of one. A track whose orbit is a Gaussian mixture is represented by
the moments of the mixture.

The probability that an exposure detects a track is that of lying in the field, times that of being
brighter than the limit, times the share that is not lost. The magnitude is predicted by a diffuse
sphere, whose error has the standard deviation `magnitude_sigma`, since attitude and shape change
the brightness of a target by more than its distance.

Assumptions and limitations
---------------------------
- In the probability of lying in the field, errors along both axes of the field are independent. It
  is inexact where a corner of the field cuts a long error ellipse: by 0.05 for a correlation of
  0.56.
- Predicted magnitudes lack the dimming by shadows and by the atmosphere.
"""

from typing import NamedTuple

import numpy as np

from cislunar.association.likelihood import gate_threshold
from cislunar.association.window import Window
from cislunar.compiled import njit, njit_noalloc
from cislunar.constants import MU
from cislunar.detection.exposures import Detections, Exposures, boresight_vectors, tangent_offset
from cislunar.detection.process import DetectionProcess
from cislunar.dynamics.bundle import step_cloud
from cislunar.dynamics.forces import of_state
from cislunar.dynamics.tableau import STAGES8
from cislunar.elementary import normal_cdf
from cislunar.estimation.estimator import OrbitEstimates
from cislunar.estimation.track_arrays import covariance_roots
from cislunar.estimation.unscented import UNSCENTED_WEIGHTS, sigma_points
from cislunar.observation.scene import Scene
from cislunar.observation.sensor import SensorLimits, limits_of, noise_variance_at
from cislunar.observation.sightline import (
    CLEAR,
    direction_angles,
    obstacle,
    sphere_margin,
    wrap_angle,
)
from cislunar.runtime import Array

_POINTS = 13
_AT_LEAST = 1e-4
"""Detection probability below which an exposure is no chance to detect a track."""


class Expectation(NamedTuple):
    """What the association assumes of detections: the process of false alarms and losses, the
    logarithm of the density of detections that are of no track, per square radian and magnitude, is
    the sum of false alarms and of `unknown_deg2` detections of objects without a track; `sigma` is
    the standard deviation of a predicted magnitude, `gate` the probability that a gate keeps a
    detection, and `faintness` (observer,) that of `cislunar.photometry.sphere` per squared unit of
    length."""

    process: DetectionProcess
    unknown_deg2: float
    sigma: float
    gate: float
    faintness: Array


@njit_noalloc
def _within(offset, edge, deviation):
    """Probability that a normal variable about `offset` lies within +- edge."""
    return normal_cdf(edge - offset, deviation) - normal_cdf(-edge - offset, deviation)


@njit(cache=True, error_model="numpy")
def _find(first, scene, forces, spread, limits, orbits, exposures, begin, detections, own, out):
    """Chances and pairs of all tracks, into `out`; returns their numbers, -1 if there is no room.
    `begin` are the first detections of each exposure."""
    translation, root = orbits
    step, observer, boresight, toward, half_field = exposures
    value, variance, log_other = detections
    kept, sigma, gate, bright_gate, faintness = own
    chance, detected, pair, residual, design, noise, weight = out
    n_chances, n_pairs = 0, 0
    slopes = np.empty((STAGES8, 6, _POINTS))
    work = np.empty((6, _POINTS))
    bundle = np.empty((6, _POINTS))
    row, here, least = np.empty((2, 6)), np.empty(2), np.empty(3)
    for j in range(translation.shape[0]):
        if not np.isfinite(translation[j, 0]):
            continue
        forced = of_state(forces, j)
        x0, y0, z0, vx, vy, vz = translation[j]
        # generous: the position is uncertain by the root, and moves by that of the velocity
        reach = 5.0 * np.sqrt(np.sum(root[j, :3] ** 2))
        drift = 5.0 * np.sqrt(np.sum(root[j, 3:] ** 2))
        pull = 2.0 * np.sqrt(vx * vx + vy * vy + vz * vz) + np.sqrt(x0 * x0 + y0 * y0 + z0 * z0)
        for body, mass in ((0, 1.0 - MU), (1, MU)):
            center = scene.primaries[first - 1, body]
            pull += mass / ((x0 - center[0]) ** 2 + (y0 - center[1]) ** 2 + (z0 - center[2]) ** 2)
        done = -1
        for e in range(step.size):
            i, o = step[e], observer[e]
            k = first + i
            place, axes = scene.observer_position[o, k], scene.observer_axes[k]
            # first along a straight line, from which gravity and the rotation of the frame bend it
            t = (i + 1) * scene.step
            dx, dy, dz = x0 + vx * t - place[0], y0 + vy * t - place[1], z0 + vz * t - place[2]
            edge = np.tan(half_field[e])
            along = dx * toward[e, 0] + dy * toward[e, 1] + dz * toward[e, 2]
            aside = np.sqrt(max(0.0, dx * dx + dy * dy + dz * dz - along * along))
            slack = reach + drift * t + pull * t * t
            if not (along > -slack and aside <= 1.5 * edge * max(along, 0.0) + slack):
                continue
            if done < 0:
                sigma_points(translation[j], root[j], spread, bundle)
            while done < i:
                done += 1
                at = (first - 1 + done) * scene.step
                step_cloud(forced, at, bundle, scene.step, slopes, work)
            dx, dy, dz = bundle[0, 0] - place[0], bundle[1, 0] - place[1], bundle[2, 0] - place[2]
            ra, dec = direction_angles(dx, dy, dz, axes)
            x, y = tangent_offset(ra, dec, boresight[e, 0], boresight[e, 1])
            if not np.isfinite(x):
                continue
            limit = limits_of(limits, o)
            sun = scene.sun_position[k]
            if (
                obstacle(place[0], place[1], place[2], dx, dy, dz, sun, limit, scene.primaries[k])
                != CLEAR
            ):
                continue
            for c in range(6):
                for s in range(2):
                    point = 1 + c + 6 * s
                    r, d = direction_angles(
                        bundle[0, point] - place[0], bundle[1, point] - place[1],
                        bundle[2, point] - place[2], axes,
                    )  # fmt: skip
                    sign = (0.5 if s == 0 else -0.5) / spread
                    if s == 0:
                        row[0, c], row[1, c] = sign * wrap_angle(r - ra), sign * (d - dec)
                    else:
                        row[0, c] += sign * wrap_angle(r - ra)
                        row[1, c] += sign * (d - dec)
            s11 = s12 = s22 = 0.0
            for c in range(6):
                s11 += row[0, c] * row[0, c]
                s12 += row[0, c] * row[1, c]
                s22 += row[1, c] * row[1, c]
            off = bundle[0, 0] - sun[0], bundle[1, 0] - sun[1], bundle[2, 0] - sun[2]
            margin = sphere_margin(dx, dy, dz, off[0], off[1], off[2], faintness[o])
            noise_variance_at(limit, limit.limiting_magnitude, least)
            inside = _within(x, edge, np.sqrt(s11) * np.cos(dec) + 1e-12)
            inside *= _within(y, edge, np.sqrt(s22) + 1e-12)
            probability = kept * inside * normal_cdf(margin, np.sqrt(sigma * sigma + least[0]))
            if not probability > _AT_LEAST:
                continue
            if n_chances == chance.shape[0]:
                return -1, -1
            chance[n_chances, 0], chance[n_chances, 1] = e, j
            detected[n_chances] = probability
            n_chances += 1
            expected = limit.limiting_magnitude - margin
            for p in range(begin[e], begin[e + 1]):
                spare = value[p, 0] - expected
                bright = sigma * sigma + variance[p, 0]
                if not spare * spare <= bright_gate * bright:
                    continue
                here[0], here[1] = wrap_angle(value[p, 1] - ra), value[p, 2] - dec
                a, b = s11 + variance[p, 1], s22 + variance[p, 2]
                squared = (b * here[0] ** 2 - 2.0 * s12 * here[0] * here[1] + a * here[1] ** 2) / (
                    a * b - s12 * s12
                )
                if not squared <= gate:
                    continue
                if n_pairs == pair.shape[0]:
                    return -1, -1
                pair[n_pairs, 0], pair[n_pairs, 1], pair[n_pairs, 2] = e, j, p
                residual[n_pairs], design[n_pairs] = here, row
                noise[n_pairs, 0], noise[n_pairs, 1] = variance[p, 1], variance[p, 2]
                log_density = -0.5 * (spare * spare / bright + np.log(2.0 * np.pi * bright))
                # a detection is in the field, so that the direction alone has its density there
                weight[n_pairs] = np.log(kept) + log_density - log_other[p]
                n_pairs += 1
    return n_chances, n_pairs


def _roots(orbits: OrbitEstimates) -> Array:
    """Lower Cholesky factors (track, 6, 6) of the covariances; NaN for failed estimates."""
    root = np.full(orbits.covariance.shape, np.nan)
    kept = np.isfinite(orbits.translation[:, 0])
    root[kept] = covariance_roots(orbits.covariance[kept])
    return root


def find_candidates(
    orbits: OrbitEstimates,
    exposures: Exposures,
    detections: Detections,
    scene: Scene,
    forces: tuple,
    limits: SensorLimits,
    expected: Expectation,
) -> Window:
    """Pairs of tracks and detections within the gates, and all chances of a detection.

    Parameters
    ----------
    orbits : OrbitEstimates
        Of the tracks, at the time before the first step of the window.
    exposures : Exposures
        Of the window; steps are counted from its first.
    detections : Detections
        Of the window; exposures are counted from its first.
    scene, forces
        Scene and force model of the tracks.
    limits : SensorLimits
        Of all observers.
    expected : Expectation

    Returns
    -------
    Window
        Its covariances are identities, and its detections rows of `detections`.

    Raises
    ------
    ConfigurationError
        If the gate of `expected` is no probability between 0 and 1.
    """
    n_tracks, n = orbits.translation.shape
    begin = np.searchsorted(detections.exposure, np.arange(exposures.step.size + 1))
    room = 4 * (exposures.step.size + detections.exposure.size) + 64
    magnitude = detections.value[:, 0]
    faintest = exposures.limiting_magnitude[detections.exposure]
    # per rad and mag of the measured values: right ascension is longer than its arc
    log_other = expected.process.log_intensity(magnitude, faintest, expected.unknown_deg2)
    log_other += np.log(np.cos(detections.value[:, 2]))
    # both gates together keep a detection with the stated probability
    each = float(np.sqrt(expected.gate))
    gates = gate_threshold(each, 2), gate_threshold(each, 1)
    own = 1.0 - expected.process.detection_loss, expected.sigma, *gates, expected.faintness
    spread = UNSCENTED_WEIGHTS.spread
    model = scene, forces, spread, limits, (orbits.translation, _roots(orbits))
    data = (
        (
            exposures.step,
            exposures.observer,
            exposures.boresight,
            boresight_vectors(exposures, scene, orbits.index + 1),
            exposures.half_field,
        ),
        begin,
        (detections.value, detections.variance, log_other),
    )
    while True:
        out = (
            np.empty((room, 2), dtype=np.int64),
            np.empty(room),
            np.empty((room, 3), dtype=np.int64),
            np.empty((room, 2)),
            np.empty((room, 2, n)),
            np.empty((room, 2)),
            np.empty(room),
        )
        n_chances, n_pairs = _find(orbits.index + 1, *model, *data, own, out)
        if n_chances >= 0:
            break
        room *= 4
    chance, probability = out[0][:n_chances], out[1][:n_chances]
    pair, *rest = (each[:n_pairs] for each in out[2:])
    order, chances = np.lexsort(pair.T[::-1]), np.lexsort(chance.T[::-1])
    exposure, track, detection = pair[order].T
    return Window(
        np.broadcast_to(np.eye(n), (n_tracks, n, n)),
        exposure,
        track,
        detection,
        *(each[order] for each in rest),
        chance[chances],
        np.log1p(-probability[chances] * expected.gate),
    )
