"""Mistakes around a study, in Python, YAML and the command: each is one line that names it."""

import numpy as np
import pytest
from click.testing import CliRunner

import cislunar as cs
from cislunar.command.main import cislunar
from cislunar.errors import CislunarError

EYE, OBSERVER = {"eye": "Halo_L2_S,period=6.56"}, {"family": "Halo_L2_S", "period_days": 6.56}
TARGET = {"a": "Lyap_L2,period=15"}
STATE = {"state_km": [400_000.0, 0.0, -60_000.0, 0.0, 0.1, 0.0]}
NAN = float("nan")


def studied(observers=EYE, targets=TARGET, *more, **settings):
    return cs.Study(observers, targets, *more, **settings)


def target(**keys):
    return lambda: studied(EYE, {"a": keys})


def setting(**keys):
    return lambda: studied(**keys)


MISTAKES = {
    "no observer": (lambda: studied({}), "observers: none is given"),
    "no target": (lambda: studied(EYE, []), "targets: none is given"),
    "a family alone": (lambda: studied("Halo_L2_S"), "give a mapping of names to orbits"),
    "a number": (lambda: studied(3), "observers = 3: give a mapping"),
    "a number as name": (lambda: studied({1: EYE["eye"]}), "observers: 1 is no name"),
    "no name": (lambda: studied({"": EYE["eye"]}), "observers: '' is no name"),
    "misspelled family": (lambda: studied({"e": "Halo_L2_Q,period=6.56"}), "did you mean"),
    "no such period": (lambda: studied({"e": "Halo_L2_S,period=600"}), "the family has about"),
    "two members": (lambda: studied({"e": "Halo_L2_S,jacobi=3.05"}), "add member=N"),
    "NaN": (lambda: studied(EYE, {"a": [NAN] * 6}), "state is not finite"),
    "km without a unit": (lambda: studied(EYE, {"a": STATE["state_km"]}), "units of 384400 km"),
    "meters as km": (target(state_km=[4e8, 0, 0, 0, 100, 0]), "x = 4e+08 is taken in km"),
    "five numbers": (lambda: studied(EYE, {"a": [1, 2, 3, 4, 5]}), "has shape"),
    "no orbit": (target(), "no orbit given"),
    "None": (lambda: studied(EYE, {"a": None}), "target 'a': state = None"),
    "a text as state": (target(state="abc"), "state = 'abc' must be numbers"),
    "inside the Moon": (target(state_km=[379_729.0, 0, 0, 0, 0, 0]), "lies inside the Moon"),
    "an unknown key": (target(familly="Halo_L2_S"), "did you mean 'family'"),
    "two orbits": (target(**OBSERVER, **STATE), "family and state_km given"),
    "no member": (target(family="Halo_L2_S"), "give jacobi, period_days or count"),
    "a number as family": (target(family=3, jacobi=3.0), "family = 3"),
    "a text as period": (target(family="Halo_L2_S", period_days="8"), "= '8' must be a finite"),
    "count and member": (target(family="Halo_L2_S", count=3, member=1), "leave out count"),
    "count of none": (target(family="Halo_L2_S", count=0), "count = 0 must be"),
    "a missing OEM": (lambda: studied(EYE, "missing.oem"), "missing.oem: no such file"),
    "a missing table": (lambda: studied("missing.csv"), "missing.csv: no such file"),
    "no path": (target(oem=None), "oem = None must be a path"),
    "sensor of a target": (target(**OBSERVER, sensor={}), "unknown key 'sensor'"),
    "text of a sensor": (
        lambda: cs.Sensor(angle_noise_arcsec="5"),
        "= '5' must be a number",
    ),
    "number of a section": (lambda: cs.Sensor(exclusion_deg=3), "= 3 must be a mapping"),
    "misspelled sensor key": (
        lambda: studied({"e": OBSERVER | {"sensor": {"limit": 3}}}),
        "sensor.limit': known keys",
    ),
    "small covariance": (target(**STATE, covariance_km=[1, 2]), "covariance_km has shape"),
    "negative covariance": (target(**STATE, covariance_km=-np.eye(6)), "positive definite"),
    "quaternion of norm 2": (target(**STATE, quaternion=[0, 0, 0, 2]), "has norm 2"),
    "unknown center": (target(icrf_km=[4e5, 0, 0, 0, 1, 0], center="MARS"), "'MARS' is unknown"),
    "center without ICRF": (target(**STATE, center="MOON"), "center belongs to icrf_km"),
    "a name twice": (
        lambda: studied(EYE, {"a": {"family": "Halo_L2_S", "count": 2}, "a 1": TARGET["a"]}),
        "'a 1' occurs twice",
    ),
    "no date": (lambda: studied(EYE, TARGET, "tomorrow"), "'tomorrow' is not a date"),
    "beyond the kernel": (lambda: studied(EYE, TARGET, "2100-01-01"), "covers 1899"),
    "days as text": (setting(duration_hours="2 days"), "must be a number above 0"),
    "no whole step": (setting(duration_hours=1.001), "must be a multiple of step_s"),
    "step and interval": (setting(step_s=7), "must be a multiple of step_s = 7 s"),
    "unknown estimator": (setting(estimator="kalman"), "must be one of mukf, batch"),
    "class of another section": (setting(sensor=cs.Material()), "sensor = Material(...): give a"),
    "a list of seeds": (setting(seeds=[1, 2]), "must be a whole number"),
    "misspelled setting": (setting(duration_hour=3), "did you mean 'duration_hours'"),
    "a day of a campaign": (setting(start_day=3), "change epoch"),
    "filter without truth": (setting(dynamics={"filter": "ephemeris"}), "set truth to"),
    "missing kernel": (setting(kernel="none.bsp"), "none.bsp: no such file"),
    "missing mesh": (setting(body={"shape": "missing.obj"}), "missing.obj"),
    "station at no latitude": (
        setting(stations={"x": {"latitude_deg": 100, "longitude_deg": 0}}),
        "at most 90",
    ),
    "station named as an observer": (
        setting(stations={"eye": {"latitude_deg": 10, "longitude_deg": 0}}),
        "'eye' is an observer already",
    ),
    "seeds of a run": (lambda: studied().run(seeds=[1]), "seeds = [1] must be a whole number"),
    "observations of nothing": (setting(observations=3), "observations: give a table"),
    "missing observations": (setting(observations="none.csv"), "none.csv: no readable table"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_in_python_is_one_line(name):
    call, words = MISTAKES[name]
    with pytest.raises(CislunarError) as caught:
        call()
    message = str(caught.value)
    assert words in message
    assert len(message.splitlines()) == 1
    assert "task2" not in message


OBSERVATION = {
    "obsTime": "2027-03-01T00:30:00",
    "stn": "EYE",
    "artSat": "a",
    "ra": 10.0,
    "dec": -5.0,
    "mag": 14.0,
}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"obsTime": "today"}, "row 1: obsTime: 'today' is not a date"),
        ({"obsTime": "2027-02-28"}, "row 1: obsTime = 2027-02-28 must be after the epoch"),
        ({"obsTime": "2027-03-04"}, "raise duration_hours"),
        ({"stn": "ear"}, "row 1: stn = ear must be one of eye"),
        ({"artSat": "b"}, "row 1: object = b must be one of the targets a"),
        ({"dec": 95.0}, "row 1: dec = 95.0 must be a number between -90 and 90"),
        ({"mag": None}, "row 1: mag = None must be a finite number"),
        ({"rmsDec": 0.0}, "row 1: rmsDec = 0.0 must be a positive number"),
    ],
)
def test_a_mistake_in_observations_is_one_line(change, words):
    pd = pytest.importorskip("pandas")
    table = pd.DataFrame([OBSERVATION | change], dtype=object)
    with pytest.raises(CislunarError) as caught:
        studied(EYE, TARGET, "2027-03-01", observations=table, dynamics={"truth": "cr3bp"})
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "no such file"),
        ("", "a study is a mapping"),
        ("- a", "a study is a mapping"),
        ("observers: {a: [", "no YAML"),
        ("observers: {}", "targets is missing"),
        ("1: 2\nobservers: {}\ntargets: {}", "the key 1 is no text"),
        ("observers: {e: 'Halo_L2_S,period=6.56'}\ntargets: {a: b}", "orbit 'b'"),
        ("observers: {e: 'Halo_L2_S,period=x'}\ntargets: {a: b}", "'x' is not a number"),
        ("observers: &o {e: *o}\ntargets: {}", "error"),
    ],
)
def test_a_mistake_in_a_file_is_one_line(tmp_path, text, words):
    path = tmp_path / "study.yaml"
    if text is not None:
        path.write_text(text)
    done = CliRunner().invoke(cislunar, ["study", str(path)])
    assert done.exit_code == 2
    lines = done.output.strip().splitlines()
    assert len(lines) == 1 and lines[0].startswith("error: ") and words in lines[0]
    assert not (tmp_path / "study").exists()


@pytest.mark.parametrize("option", [["--seeds", "0"], ["--seeds", "x"], ["--unknown"], []])
def test_a_mistake_in_the_command_is_one_line(option):
    done = CliRunner().invoke(cislunar, ["study", *option])
    assert done.exit_code == 2
    assert done.output.strip().splitlines()[-1].startswith("error: ")


def test_a_shortened_interval_is_announced(caplog):
    studied(duration_hours=6.3)
    assert "duration_hours = 6.3 is no multiple of interval_minutes = 60" in caplog.text


def test_a_file_is_checked_without_a_run(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("observers: {a: 'Halo_L2_S,period=6.56'}\ntargets: {b: 'Lyap_L2,period=15'}\n")
    done = CliRunner().invoke(cislunar, ["study", str(path), "--check"])
    assert done.exit_code == 0
    assert done.output.startswith("Study of 1 targets by 1 observers")
