"""Speed of orbit generation and propagation relative to public integrators.

    python benchmarks/orbits.py

Prints how many times faster a family of halo orbits is generated with the compiled DOP853 than with
the same corrector on `scipy.integrate.solve_ivp`, how the propagation of single and of many
trajectories compares with the Taylor integrator of heyoka (scalar and batch), and the cost of
transition matrices and of a step under ephemeris forces. Ratios measured in one run depend much
less on the machine than times.
"""

import argparse
import importlib.util
import time

import numpy as np
from _timing import alternated, best_time
from numpy.polynomial import Chebyshev, Polynomial
from numpy.polynomial.chebyshev import chebpts1
from scipy.integrate import solve_ivp

from cislunar.constants import LENGTH_UNIT_KM, MU, TIME_UNIT_S
from cislunar.dynamics.bundle import propagate_bundle
from cislunar.dynamics.cr3bp import EARTH_MOON, equations_of_motion, variational_matrix
from cislunar.dynamics.ephemeris import UNITS, forces_between
from cislunar.dynamics.frames import pulsating_frame, to_inertial
from cislunar.dynamics.propagation import propagate, propagate_many, propagate_stm
from cislunar.ephemeris.bodies import read_table
from cislunar.ephemeris.time_scales import tdb_seconds
from cislunar.orbits import branches, continuation, corrector
from cislunar.orbits.catalog import periodic_orbits
from cislunar.orbits.families import observer_library, spaced_members

HALO_PERIOD = 3.0
MEMBERS = 23


def propagate_stm_scipy(state, duration, *, forces=EARTH_MOON, rtol=1e-13, atol=1e-13):
    """`propagate_stm` with the DOP853 of SciPy and derivatives in NumPy."""

    def derivative(_, y):
        slope = np.empty(42)
        slope[:6] = equations_of_motion(y[:6], forces.mu)
        slope[6:] = (variational_matrix(y[:6], forces.mu) @ y[6:].reshape(6, 6)).ravel()
        return slope

    start = np.concatenate([np.asarray(state, dtype=float), np.eye(6).ravel()])
    solution = solve_ivp(derivative, (0.0, duration), start, "DOP853", rtol=rtol, atol=atol)
    end = solution.y[:, -1]
    return end[:6], end[6:].reshape(6, 6)


def generate_family() -> np.ndarray:
    """Crossings of equally spaced L2 halos from the bifurcation to a period of `HALO_PERIOD`."""
    seed = branches.halo_seed(2)
    branch = continuation.continue_branch(
        seed.half, seed.direction, lambda member: member.half.period < HALO_PERIOD
    )
    members = spaced_members(branch, MEMBERS, by_arc=False)
    return np.array([member.half.crossing for member in members])


def compare_generation() -> None:
    """Print the time ratio of orbit generation."""
    crossings = generate_family()
    compiled = best_time(generate_family)
    corrector.propagate_stm = propagate_stm_scipy
    try:
        start = time.perf_counter()
        by_scipy = generate_family()
        interpreted = time.perf_counter() - start
    finally:
        corrector.propagate_stm = propagate_stm
    print(
        f"{MEMBERS} L2 halos: {compiled:.3f} s compiled, {interpreted:.1f} s on solve_ivp: "
        f"{interpreted / compiled:.0f} times faster (crossings differ by "
        f"{np.abs(crossings - by_scipy).max():.1e})"
    )


def compare_propagation() -> None:
    """Print the time ratios of the propagation of one orbit over ten periods."""
    orbit = periodic_orbits("Halo_L2_S", period=2.3)
    state, end = orbit.state[0], 10.0 * orbit.period[0]
    times = np.linspace(0.0, end, 1001)
    truth = propagate(state, times, method="dop853", rtol=2.5e-14, atol=2.5e-14)
    for method, scipy_method, tolerance in (
        ("dopri5", "RK45", 1e-10),
        ("dop853", "DOP853", 1e-13),
    ):
        ours = best_time(lambda m=method: propagate(state, times, method=m), 20)
        theirs = best_time(
            lambda m=scipy_method, tol=tolerance: solve_ivp(
                lambda _, y: equations_of_motion(y),
                (0.0, end),
                state,
                m,
                t_eval=times,
                rtol=tol,
                atol=tol,
            ),
            1,
        )
        error = np.abs(propagate(state, times, method=method) - truth).max()
        print(
            f"{method} at {tolerance:.0e}: {1e3 * ours:.2f} ms for ten periods, error {error:.1e}, "
            f"{theirs / ours:.0f} times faster than SciPy"
        )


def compare_transition_matrices() -> None:
    """Print the time of states with transition matrices over a day, together and one by one."""
    library = observer_library()
    states, day = library.state, 86400.0 / TIME_UNIT_S
    tolerances = {"rtol": 1e-9, "atol": 1e-9}

    def together():
        return propagate_stm(states, day, **tolerances)

    def alone():
        return [propagate_stm(state, day, **tolerances) for state in states]

    times = alternated({"together": together, "alone": alone}, 5)
    together_us, alone_us = (1e6 * each / len(states) for each in times.values())
    print(
        f"{len(states)} states with transition matrices over a day at 1e-9: together "
        f"{together_us:.2f} us, one by one {alone_us:.2f} us per state   time ratio "
        f"{alone_us / together_us:.1f}"
    )


def compare_with_heyoka() -> None:
    """Print the time per trajectory for single and many trajectories, here and by heyoka."""
    if importlib.util.find_spec("heyoka") is None:
        print("heyoka is not installed: its Taylor integrator is not compared")
        return
    import heyoka

    halo, library = periodic_orbits("Halo_L2_S", period=2.3), observer_library()
    near = halo.state[0] + 1e-4 * np.random.default_rng(0).standard_normal((64, 6))
    share = np.linspace(0.0, 10.0, 1001)
    cr3bp = heyoka.model.cr3bp(mu=MU), to_canonical, from_canonical
    forces = forces_between("2024-10-01", "2024-10-02", figure=False)
    inertial = to_inertial(near, pulsating_frame(forces.table, forces.epoch)) / UNITS
    day = np.linspace(0.0, 86_400.0 / TIME_UNIT_S, 25)
    real = point_masses(heyoka, forces, day[-1]), np.array, np.array
    cases = (
        ("a halo, ten periods", near, share * halo.period[0], EARTH_MOON, cr3bp),
        ("the library, a period", library.state, np.outer(library.period, share[:101] / share[100]),
         EARTH_MOON, cr3bp),
        ("a day with Earth, Moon and Sun", inertial, day, forces, real),
    )  # fmt: skip
    for name, states, times, model, theirs in cases:
        for method, tolerance in (("dopri5", 1e-10), ("dop853", 1e-13)):
            compare_ways(heyoka, name, states, times, model, theirs, method, tolerance)


def compare_ways(heyoka, name, states, times, model, theirs, method, tolerance) -> None:
    """Print times and errors of the four methods; `theirs` are heyoka's model and coordinates."""
    system, to_theirs, from_theirs = theirs
    grid = np.broadcast_to(times, (len(states), times.shape[-1]))
    begins = to_theirs(states)
    taylor = heyoka.taylor_adaptive(system, np.zeros(6), tol=tolerance)
    width = heyoka.recommended_simd_size()
    batch = heyoka.taylor_adaptive_batch(system, np.zeros((6, width)), tol=tolerance)

    def scalar():
        ends = np.empty_like(states)
        for k, begin in enumerate(begins):
            taylor.time = 0.0
            taylor.state[:] = begin
            ends[k] = taylor.propagate_grid(grid[k])[-1][-1]
        return from_theirs(ends)

    def batched():
        ends = np.empty_like(states)
        for k in range(0, len(states), width):
            lanes = np.minimum(np.arange(k, k + width), len(states) - 1)  # the last fills up
            batch.set_time(np.zeros(width))
            batch.state[:] = begins[lanes].T
            ends[lanes] = batch.propagate_grid(np.ascontiguousarray(grid[lanes].T))[1][-1].T
        return from_theirs(ends)

    def alone():
        each = zip(states, grid, strict=True)
        return np.array([propagate(s, t, forces=model, method=method)[-1] for s, t in each])

    def many():
        return propagate_many(states, times, forces=model, method=method)[:, -1]

    ways = {"single": alone, "many": many, "heyoka": scalar, "heyoka batch": batched}
    seconds = alternated(ways, 5)
    best = {"forces": model, "method": "dop853", "rtol": 2.5e-14, "atol": 2.5e-14}
    truth = propagate_many(states, grid[:, -1:], **best)[:, 0]
    shown = ", ".join(
        f"{way} {1e3 * seconds[way] / len(states):.3f} ms "
        f"(error {np.median(np.abs(action() - truth).max(axis=1)):.0e})"
        for way, action in ways.items()
    )
    one, each, theirs, together = seconds.values()
    print(
        f"{name}, {method} at {tolerance:.0e}: {shown}; time relative to heyoka: single "
        f"{one / theirs:.2f}, many {each / theirs:.2f}; many relative to its batch of {width}: "
        f"{each / together:.2f}"
    )


def point_masses(heyoka, forces, end: float) -> list:
    """Equation 2 of `docs/dynamics.md` without harmonics and radiation, in heyoka's expressions.

    heyoka reads no tables: positions of the bodies are polynomials of degree 10 in time, within
    1e-12 of the tables.
    """
    state = heyoka.make_vars("x", "y", "z", "vx", "vy", "vz")
    nodes = chebpts1(11)
    places, _, _ = read_table(forces.table, forces.epoch + 0.5 * (nodes + 1.0) * end * TIME_UNIT_S)

    def polynomial(values):
        fit = Chebyshev.fit(nodes, values / LENGTH_UNIT_KM, 10, domain=[-1.0, 1.0])
        fit = fit.convert(kind=Polynomial)
        u = (2.0 / end) * heyoka.time - 1.0
        value = fit.coef[-1]
        for coefficient in fit.coef[-2::-1]:
            value = value * u + coefficient
        return value

    bodies = [[polynomial(places[:, 3 * body + axis]) for axis in range(3)] for body in range(3)]
    gm = forces.gm_earth, forces.gm_moon, forces.gm_sun

    def pull(to, since, axis):
        """Acceleration along an axis toward a unit mass at `to`."""
        offset = [to[c] - since[c] for c in range(3)]
        return offset[axis] * heyoka.sum([each * each for each in offset]) ** -1.5

    change = list(state[3:])
    for axis in range(3):
        own = sum(gm[body] * pull(bodies[body], state[:3], axis) for body in range(3))
        origin = sum(gm[body] * pull(bodies[2], bodies[body], axis) for body in range(2))
        change.append(own - gm[2] / (gm[0] + gm[1]) * origin)
    return list(zip(state, change, strict=True))


def compare_forces() -> None:
    """Print the cost of a step under ephemeris forces relative to the CR3BP."""
    first, last = "2024-10-01", "2024-10-03"
    areas = np.full(25, 0.01)
    models = {
        "CR3BP": EARTH_MOON,
        "Earth, Moon and Sun": forces_between(first, last, figure=False),
        "with lunar J2 and C22": forces_between(first, last),
        "with radiation": forces_between(first, last, area_to_mass=0.01),
        "with radiation, own area each": forces_between(first, last, area_to_mass=areas),
    }
    # Near L1 in the propagation frame of each model, outside the shadow of the Moon.
    halo = periodic_orbits("Halo_L1_S", period=2.6).state[0]
    table = models["with radiation"].table
    inertial = to_inertial(halo, pulsating_frame(table, tdb_seconds(first))) / UNITS
    spread = 1e-5 * np.random.default_rng(0).standard_normal((25, 6))
    step, count = 60.0 / TIME_UNIT_S, 200
    starts = {name: (halo if name == "CR3BP" else inertial) + spread for name in models}
    times = dict.fromkeys(models, np.inf)
    for _ in range(40):
        for name, forces in models.items():
            seconds = best_time(
                lambda n=name, f=forces: propagate_bundle(starts[n], step, count, forces=f), 1
            )
            times[name] = min(times[name], seconds)
    for name, seconds in times.items():
        print(
            f"step of 25 states, {name}: {1e6 * seconds / count:.2f} us, "
            f"{seconds / times['CR3BP']:.2f} times the CR3BP"
        )
    days = np.array([86_400.0 / TIME_UNIT_S])
    alone = {"CR3BP": (halo, EARTH_MOON), "ephemeris": (inertial, models["with radiation"])}
    for what, run in (
        ("a day of one state", lambda s, f: propagate(s, days, forces=f, method="dop853")),
        ("with its transition matrix", lambda s, f: propagate_stm(s, days[0], forces=f)),
    ):
        ours, theirs = (
            best_time(lambda each=each, run=run: run(*each), 200) for each in alone.values()
        )
        print(f"{what}: {1e3 * theirs:.3f} ms, {theirs / ours:.2f} times the CR3BP")


def to_canonical(state: np.ndarray) -> np.ndarray:
    """Canonical coordinates of heyoka's CR3BP, which is rotated by half a revolution about z."""
    x, y, z, vx, vy, vz = np.moveaxis(state, -1, 0)
    return np.stack([-x, -y, z, -(vx - y), -(vy + x), vz], axis=-1)


def from_canonical(canonical: np.ndarray) -> np.ndarray:
    """Inverse of `to_canonical`."""
    x, y, z, px, py, pz = np.moveaxis(canonical, -1, 0)
    return np.stack([-x, -y, z, -(px + y), -(py - x), pz], axis=-1)


def main() -> None:
    """Run every comparison."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    start = time.perf_counter()
    count = len(observer_library().period)
    print(
        f"{count} orbits of the observer library, first call: {time.perf_counter() - start:.1f} s"
    )
    compare_generation()
    compare_propagation()
    compare_transition_matrices()
    compare_with_heyoka()
    compare_forces()


if __name__ == "__main__":
    main()
