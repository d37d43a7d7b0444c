"""The mission table, and the refusal of tables that cannot be used."""

from pathlib import Path

import numpy as np
import pytest

from cislunar.errors import InputFileError
from cislunar.targets.missions import highest_lunar_jacobi, load_missions

TABLE = Path(__file__).parents[2] / "config" / "missions.csv"


def write(tmp_path, text):
    path = tmp_path / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_table_has_the_papers_count_and_range():
    """Paul & Fan, section 3: 64 missions, JC from 2.91 (Artemis I) to 5.49 (lunar landers)."""
    table = load_missions(TABLE)
    assert len(table) == 64
    assert table["mission"].is_unique
    assert table.loc[table["jacobi"].idxmin(), "mission"] == "Artemis I"
    assert table["jacobi"].min() == 2.91
    assert round(table["jacobi"].max(), 2) == 5.49
    landers = table[table["jacobi"].round(2) == 5.49]
    assert landers["orbit_type"].str.startswith("landed").sum() > 5
    assert (table["source"] != "").all()
    assert set(table["confidence"]) <= {"high", "medium", "low"}


def test_jacobi_of_circular_orbits_follows_from_their_altitude():
    """About the Moon, to first order in r: JC = (1-mu)^2 + 2(1-mu) + 2 mu/r - v^2 + 2 h_z."""
    table = load_missions(TABLE)
    known = ~(table["perilune_alt_km"].isna() | table["inclination_deg"].isna())
    circular = table[known & (table["perilune_alt_km"] == table["apolune_alt_km"])]
    assert len(circular) > 15
    mu = 0.01215
    r = (1737.4 + circular["perilune_alt_km"]) / 384400.0
    speed2 = mu / r
    momentum = np.sqrt(mu * r) * np.cos(np.radians(circular["inclination_deg"]))
    constant = (1.0 - mu) ** 2 + 2.0 * (1.0 - mu) + 2.0 * mu / r - speed2 + 2.0 * momentum
    np.testing.assert_allclose(circular["jacobi"], constant, atol=2e-4)


def test_numbers_and_text(tmp_path):
    path = write(tmp_path, 'mission,jacobi,year,source\n A ,3.1,2024,\n"B, the 2nd",4,,x\n')
    table = load_missions(path)
    assert table["mission"].tolist() == ["A", "B, the 2nd"]
    assert table["jacobi"].tolist() == [3.1, 4.0]
    assert table["year"][0] == 2024.0 and np.isnan(table["year"][1])


@pytest.mark.parametrize(
    "value",
    ["", " ", "abc", "nan", "NaN", "inf", "-inf", "0", "-3.1", "54.9", "8.4", "3,1"],
)
def test_impossible_jacobi_constants_name_file_row_and_mission(tmp_path, value):
    path = write(tmp_path, f'mission,jacobi\nFirst,3.1\n\nSecond,"{value}"\n')
    with pytest.raises(InputFileError) as caught:
        load_missions(path)
    for text in (str(path), "row 4", "'Second'", "acobi"):
        assert text in str(caught.value)


def test_missing_field_is_a_missing_jacobi_constant(tmp_path):
    path = write(tmp_path, "mission,jacobi\nFirst,3.1\nSecond\n")
    with pytest.raises(InputFileError, match=r"row 3, mission 'Second': no Jacobi constant"):
        load_missions(path)


def test_bounds_of_possible_jacobi_constants(tmp_path):
    """2U on the Moon's far side, by hand: (x^2) + 2(1-mu)/d + 2 mu/r."""
    mu, r = 0.01215, 1737.4 / 384400.0
    near = (1 - mu - r) ** 2 + 2 * (1 - mu) / (1 - r) + 2 * mu / r
    far = (1 - mu + r) ** 2 + 2 * (1 - mu) / (1 + r) + 2 * mu / r
    assert highest_lunar_jacobi() == pytest.approx(max(near, far), rel=1e-14)
    path = write(tmp_path, f"mission,jacobi\nA,{max(near, far) - 1e-3}\nB,1e-3\n")
    assert len(load_missions(path)) == 2


def test_duplicate_missions_are_refused(tmp_path):
    path = write(tmp_path, "mission,jacobi\nA,3.1\nB,3.2\nA ,3.3\n")
    with pytest.raises(InputFileError, match=r"row 4, mission 'A': .* in row 2"):
        load_missions(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no column mission, jacobi"),
        ("mission,JC\nA,3.1\n", "no column jacobi"),
        ("mission,jacobi\n", "contains no mission"),
        ("mission,jacobi\n,3.1\n", "row 2: the mission has no name"),
        ("mission,jacobi\nA,3.1,x\n", "row 2: 3 fields where the header has 2"),
        ("mission,jacobi,year\nA,3.1,soon\n", "row 2, mission 'A': year = 'soon'"),
    ],
)
def test_unusable_tables_are_refused(tmp_path, text, message):
    with pytest.raises(InputFileError, match=message):
        load_missions(write(tmp_path, text))


def test_missing_and_binary_files_are_refused(tmp_path):
    with pytest.raises(InputFileError, match="no such file"):
        load_missions(tmp_path / "absent.csv")
    binary = tmp_path / "binary.csv"
    binary.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(InputFileError, match=r"binary\.csv: cannot be read"):
        load_missions(binary)
