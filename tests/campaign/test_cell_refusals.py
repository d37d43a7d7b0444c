"""Impossible cells and files that are not of cells are refused."""

import pytest
import xarray as xr
from small_cell_datasets import small_cell

from cislunar.campaign.tracking.summary import read_cell_metrics
from cislunar.errors import ConfigurationError, InputFileError
from cislunar.runtime.netcdf import read_dataset


def test_an_architecture_without_observers_is_refused(sources):
    empty = sources["architecture"].assign(satellites=("slot", [0, 0]))
    with pytest.raises(ConfigurationError, match=r"architecture/A/tpe\.nc has no observers"):
        small_cell(sources | {"architecture": empty})
    foreign = sources["architecture"].assign(orbit=("slot", [0, 9]))
    with pytest.raises(ConfigurationError, match=r"architecture/A/tpe\.nc .*orbit 9"):
        small_cell(sources | {"architecture": foreign})


def test_a_missing_architecture_names_the_file(tmp_path):
    with pytest.raises(InputFileError, match=r"nowhere\.nc: no such file"):
        read_dataset(tmp_path / "nowhere.nc")


def test_impossible_cells_are_refused(sources):
    with pytest.raises(ConfigurationError, match="n_T = 203"):
        small_cell(sources, targets=203)
    with pytest.raises(ConfigurationError, match=r"n_T = 6 .*there are 5 targets"):
        small_cell(sources, targets=6)
    with pytest.raises(ConfigurationError, match="dt7"):
        small_cell(sources, minutes=7, step_s=50)


def test_a_file_that_is_no_cell_is_refused(tmp_path):
    path = tmp_path / "other.nc"
    xr.Dataset({"a": ("x", [1.0])}).to_netcdf(path)
    with pytest.raises(InputFileError, match=r"other\.nc lacks coverage"):
        read_cell_metrics(path)
