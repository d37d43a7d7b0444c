"""Observers, targets and settings of a study of three targets."""

EPOCH = "2027-03-01T06:00:00"
OBSERVERS = {"north": "Halo_L1_N,period=9.5", "south": "Halo_L2_S,period=6.56"}
TARGETS = {
    "zulu": {"family": "Halo_L2_S", "jacobi": 3.05, "member": 1, "phase": 0.3},
    "alpha": "Lyap_L2,period=15",
    "mike": {"state_km": [400_000.0, 1_000.0, -60_000.0, 0.01, 0.1, 0.0]},
}
SETTINGS = {
    "duration_hours": 1.5,
    "interval_minutes": 30,
    "estimator": "mukf",
    "record_minutes": 5,
    "sensor": {"limiting_magnitude": 22},
    "filter": {"splitting": False},
}
