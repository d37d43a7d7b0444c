"""Autonomous cislunar space domain awareness: observer architecture, tasking and estimation.
The functions that most notebooks need are here and are loaded on first use: after
`import cislunar as cs`, `cs.periodic_orbits("Halo_L2_S", jacobi=3.05)`. All others are in the
packages, such as `cislunar.orbits`.
"""

__version__ = "0.1.0"

_HOMES = {
    "BatchSettings": "estimation.light_curves.batch_settings",
    "BodySpec": "observation.body_spec",
    "Dynamics": "campaign.settings.cell_tree",
    "InitialSigma": "estimation.initial_sigma",
    "Material": "photometry.materials",
    "PhotonNoise": "observation.sensor",
    "ProcessNoise": "estimation.initial_sigma",
    "Sensor": "observation.sensor",
    "Study": "study.study",
    "Tasking": "campaign.settings.cell_tree",
    "apparent_magnitude": "photometry.facets",
    "coordinate_search": "architecture.coordinate_search",
    "count_visibility": "visibility.counts",
    "icosahedron": "photometry.shapes",
    "make_scene": "observation.scene",
    "observer_library": "orbits.families",
    "periodic_orbits": "orbits.catalog",
    "propagate": "dynamics.propagation",
    "propagate_periodic": "dynamics.propagation",
    "propagate_utc": "dynamics.ephemeris",
    "run_closed_loop": "tasking.closed_loop",
    "sample_ephemeris": "ephemeris.sampling",
    "sightings": "observation.sightings",
    "target_surfaces": "observation.target_surfaces",
    "tracking_problem": "tasking.demonstration",
}
"""Module of each name of this package."""

__all__ = [*_HOMES]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    if not _HOMES.keys() & globals().keys():  # before the first kernel
        import_module(f"{__name__}.runtime.kernels").drop_stale_kernels()
        import_module(f"{__name__}.runtime.compilation").announce_always()
    value = globals()[name] = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
