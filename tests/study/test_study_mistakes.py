"""Mistakes around a study, in Python, YAML and the command: each is one line that names it."""

import datetime
import inspect
import math
import pydoc

import numpy as np
import pandas as pd
import pytest
import yaml
from click.testing import CliRunner

import cislunar as cs
from cislunar.command.main import cislunar
from cislunar.errors import CislunarError, ConfigurationError
from cislunar.study.settings import StudySettings, study_files

EYE, OBSERVER = {"eye": "Halo_L2_S,period=6.56"}, {"family": "Halo_L2_S", "period_days": 6.56}
TARGET = {"a": "Lyap_L2,period=15"}
STATE = {"state_km": [400_000.0, 0.0, -60_000.0, 0.0, 0.1, 0.0]}
NAN = float("nan")
FALLING, INSIDE = [0.95, 0.0, 0.0, 0.0, 0.0, 0.0], np.array([[0.988, 0.0, 0.0, 0.0, 0.0, 0.0]])


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
    "a blank at the end": (
        lambda: studied({"eye ": EYE["eye"]}),
        "observers: 'eye ' begins or ends with a blank; remove it",
    ),
    "misspelled family": (lambda: studied({"e": "Halo_L2_Q,period=6.56"}), "did you mean"),
    "no such period": (lambda: studied({"e": "Halo_L2_S,period=600"}), "the family has about"),
    "two members": (lambda: studied({"e": "Halo_L2_S,jacobi=3.05"}), "add member=N"),
    "period of no member": (target(family="Halo_L2_S", period_days=600), "target 'a': no member"),
    "members of no family": (target(family="Halo", count=2), "target 'a': unknown orbit family"),
    "text of no member": (
        lambda: studied({"e": "Halo_L2_S,period=600"}),
        "observer 'e': orbit 'Halo_L2_S,period=600': no member",
    ),
    "NaN": (lambda: studied(EYE, {"a": [NAN] * 6}), "state is not finite"),
    "km without a unit": (lambda: studied(EYE, {"a": STATE["state_km"]}), "units of 384400 km"),
    "meters as km": (target(state_km=[4e8, 0, 0, 0, 100, 0]), "x = 4e+08 is taken in km"),
    "five numbers": (lambda: studied(EYE, {"a": [1, 2, 3, 4, 5]}), "has shape"),
    "no orbit": (target(), "no orbit given"),
    "None": (lambda: studied(EYE, {"a": None}), "target 'a': state = None"),
    "a text as state": (target(state="abc"), "state = 'abc' must be numbers"),
    "inside the Moon": (target(state_km=[379_729.0, 0, 0, 0, 0, 0]), "lies inside the Moon"),
    "an observer that meets the Moon": (
        lambda: studied({"e": FALLING}, duration_hours=48),
        "observer 'e': its orbit meets the Moon: it comes within",
    ),
    "a text that meets the Moon": (
        lambda: studied(["365180,0,0,0,0,0"], duration_hours=48),
        "observer 1: its orbit meets the Moon: it comes within",
    ),
    "a member inside the Moon": (
        lambda: studied(EYE, cs.periodic_orbits("DRO", period_days=12)._replace(state=INSIDE)),
        "DRO: lies inside the Moon",
    ),
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
    "unknown center": (
        target(icrf_km=[4e5, 0, 0, 0, 1, 0], center="MARS"),
        "center = 'MARS' must be one of EARTH, MOON",
    ),
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
    "family spread too far": (target(family="Halo_L2_S", count=10**9), "at most 10,000"),
    "a text count": (target(family="Halo_L2_S", count="2"), "count = '2' must be a whole number"),
    "NaN as phase": (
        lambda: studied({"e": "Halo_L2_S,period=6.56,phase=nan"}),
        "'nan' is not a number",
    ),
    "days of a text orbit": (
        lambda: studied({"e": "Halo_L2_S,period_days=6.56"}),
        "is not one of jacobi=, period= (days)",
    ),
    "a data frame": (
        lambda: studied(EYE, pd.DataFrame({"x": [1.1]})),
        "targets = x 0  1.1: give a mapping of names",
    ),
    "no center": (
        target(icrf_km=[4e5, 0, 0, 0, 1, 0], center=None),
        "target 'a': center = 'NONE' must be one of EARTH, MOON, EARTH BARYCENTER",
    ),
    "meters in the ICRF": (target(icrf_km=[4e8, 0, 0, 0, 1e3, 0]), "taken in km"),
    "m/s as km/s": (target(state_km=[4e5, 0, -6e4, 0, 100, 0]), "taken in km/s"),
    "infinite rate": (target(**STATE, angular_velocity_deg_h=[math.inf, 0, 0]), "is not finite"),
    "sensor of an observer": (
        lambda: studied({"e": OBSERVER | {"sensor": {"angle_noise_arcsec": -3}}}),
        "'observers.e.sensor.angle_noise_arcsec' = -3: must be a number above 0",
    ),
    "sensor of no mapping": (
        lambda: studied({"e": OBSERVER | {"sensor": "x"}}),
        "'observers.e.sensor' = 'x': must be a mapping",
    ),
    "sensors of no observer": (
        setting(sensors={"g": {"observers": [5], "sensor": {}}}),
        "'sensors.g.observers': 5 is none of the observers",
    ),
    "a date in digits": (lambda: studied(EYE, TARGET, 20240101), "change epoch or duration_hours"),
    "a modified Julian date": (lambda: studied(EYE, TARGET, 60_000.5), "must be a Julian date"),
    "no time": (lambda: studied(EYE, TARGET, pd.NaT), "'NaT' is not a date"),
    "another time scale": (lambda: studied(EYE, TARGET, "2027-03-01 TDB"), "is not a date"),
    "text of a section": (setting(dynamics="ephemeris"), "'dynamics' = 'ephemeris': must be a"),
    "nested setting": (setting(batch={"mode": 3}), "'batch.mode': did you mean 'modes'"),
    "negative radiation": (
        setting(dynamics={"srp": {"area_to_mass": -1}}),
        "'dynamics.srp.area_to_mass' = -1: must be a number at least 0",
    ),
    "campaign's name": (lambda: cs.Study(EYE, TARGET, **{"self": 3}), "unknown setting 'self'"),
    "realizations of a run": (
        lambda: studied().run(seeds=10**6),
        "setting 'seeds' = 1000000: must be a whole number at least 1 and at most 10,000",
    ),
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


FILE = "observers: {e: 'Halo_L2_S,period=6.56'}\ntargets: {a: 'Lyap_L2,period=15'}\n"
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
        ({"ra": "12h30m"}, "row 1: ra = 12h30m must be a finite number"),
        ({"obsTime": NAN}, "row 1: obsTime = nan must be given"),
        ({"obsTime": "2027-03-01T00:30:00+02:00"}, "no time zone"),
        ({"obsTime": "2027-03-01T00:15:00"}, "row 2: obsTime = 2027-03-01T00:15:00 must differ"),
    ],
)
def test_a_mistake_in_observations_is_one_line(change, words):
    earlier = OBSERVATION | {"obsTime": "2027-03-01T00:15:00"}
    table = pd.DataFrame([OBSERVATION | change, earlier], dtype=object)
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
        ("observers: {e: x, e: y}\ntargets: {}", "study.yaml, line 1: e occurs twice; rename one"),
        (f"{FILE}observers: {{}}", "line 3: observers occurs twice"),
        (f"{FILE}epoch: 2027-13-01", "setting 'epoch' = '2027-13-01': '2027-13-01' is not a date"),
        (f"{FILE}duration_hours: 1e1", "setting 'duration_hours' = '1e1': must be a number"),
        (f"{FILE}self: 1", "unknown setting 'self'"),
        (f"{FILE}sensor: !!python/object:os.system {{}}", "no YAML (could not determine"),
        ("observers: {no: 'Halo_L2_S,period=6.56'}\ntargets: {}", "False is no name"),
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


def test_a_study_lists_the_files_that_it_names(tmp_path):
    (tmp_path / "bodies.csv").write_text("target,shape\na,bus.stl\n")
    (tmp_path / "own.bsp").touch()
    given = {
        "observers": {"e": "Halo_L2_S,period=6.56", "f": "f.oem", "g": {"oem": "g.txt"}},
        "targets": "targets.csv",
        "observations": "seen.psv",
        "kernel": str(tmp_path / "own.bsp"),
        "body": {"shape": "hull.obj", "table": str(tmp_path / "bodies.csv")},
        "epoch": "2027-03-01",
    }
    path = tmp_path / "own.yaml"
    path.write_text(yaml.safe_dump(given))
    named = {"f.oem", "g.txt", "targets.csv", "seen.psv", "hull.obj", "bus.stl"}
    inside = {str(tmp_path / name) for name in ("own.yaml", "own.bsp", "bodies.csv")}
    assert {*study_files(path)} == named | inside
    path.write_text(yaml.safe_dump(given | {"observers": ["f.oem"], "kernel": "de421"}))
    assert {*study_files(path)} == (named | inside) - {"g.txt", str(tmp_path / "own.bsp")}


@pytest.mark.parametrize("option", [["--seeds", "0"], ["--seeds", "x"], ["--unknown"], []])
def test_a_mistake_in_the_command_is_one_line(option):
    done = CliRunner().invoke(cislunar, ["study", *option])
    assert done.exit_code == 2
    assert done.output.strip().splitlines()[-1].startswith("error: ")


def test_a_shortened_interval_is_announced(caplog):
    studied(duration_hours=6.3)
    assert "duration_hours = 6.3 is no multiple of interval_minutes = 60" in caplog.text


def test_a_target_that_meets_the_moon_is_announced(caplog):
    targets = TARGET | {"b": FALLING}
    studied(EYE, targets, duration_hours=2)
    assert not caplog.records
    studied(EYE, targets, duration_hours=48)
    (line,) = caplog.messages
    assert line.startswith("warning: target 'b': its orbit meets the Moon: it comes within")


def test_a_file_is_checked_without_a_run(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(FILE)
    done = CliRunner().invoke(cislunar, ["study", str(path), "--check"])
    assert done.exit_code == 0
    assert done.output.startswith("Study of 1 targets by 1 observers")


def test_a_folder_that_cannot_be_written_to_is_found_before_a_run(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(FILE)
    done = CliRunner().invoke(cislunar, ["study", str(path), "--output", str(path)])
    assert done.exit_code == 2
    last = done.output.strip().splitlines()[-1]
    assert last == f"error: --output {path}: File exists; give a folder that can be written to"


@pytest.mark.parametrize(
    "date",
    [
        "2027-03-01 06:00",
        "2027-03-01T08:00:00+02:00",
        datetime.datetime(2027, 3, 1, 6),
        np.datetime64("2027-03-01T06:00", "ns"),
        pd.Timestamp("2027-03-01T06:00", tz="UTC"),
    ],
    ids=str,
)
def test_dates_of_python_are_in_utc(date):
    assert studied(EYE, TARGET, date).settings.epoch == 2461465.75


def test_observations_may_have_dates_of_pandas():
    table = pd.DataFrame([OBSERVATION]).astype({"obsTime": "datetime64[ns]"})
    for dates in (table["obsTime"], table["obsTime"].dt.tz_localize("UTC")):
        given = {"observations": table.assign(obsTime=dates), "dynamics": {"truth": "cr3bp"}}
        study = studied(EYE, TARGET, "2027-03-01", **given)
        assert study._observed.elapsed_s == pytest.approx([1800.0], abs=1e-6)


@pytest.mark.parametrize("name", cs.__all__)
def test_help_shows_public_names_only(name):
    lines = pydoc.render_doc(getattr(cs, name), renderer=pydoc.plaintext).splitlines()
    usual = {"__dict__", "__init__", "__repr__", "__weakref__"}
    own = {line[4:].split("(")[0].split(" =")[0] for line in lines if line.startswith(" |  __")}
    assert own <= usual and not any("pydantic_" in line for line in lines)


def test_help_states_the_defaults_of_a_study():
    chosen = studied().settings
    shown = inspect.signature(StudySettings).parameters
    for key in ("seeds", "duration_hours", "step_s", "tasking", "sensor", "initial_sigma", "body"):
        assert shown[key].default == getattr(chosen, key)


def test_realizations_of_real_observations_are_refused(tmp_path):
    """Neither the call nor the settings are ignored without a word."""
    table = pd.DataFrame([OBSERVATION])
    given = {"observations": table, "dynamics": {"truth": "cr3bp"}}
    words = r"^seeds = 3: observations have one realization; leave it out$"
    with pytest.raises(ConfigurationError, match=words):
        studied(EYE, TARGET, "2027-03-01", **given, seeds=3)
    study = studied(EYE, TARGET, "2027-03-01", **given)
    with pytest.raises(ConfigurationError, match=words):
        study.run(seeds=3)
