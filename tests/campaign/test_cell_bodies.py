"""Bodies of the targets of a cell from a mesh file and from a table."""

import numpy as np
import pytest
from small_cell_datasets import small_settings

from cislunar.campaign.settings.cell_settings import cell_files
from cislunar.campaign.settings.cell_tree import CellSettings
from cislunar.campaign.settings.library import loop_settings, nominal_surfaces, truth_model
from cislunar.observation.body_factory import body_from_spec
from cislunar.observation.body_spec import BodySpec
from cislunar.observation.target_surfaces import body_of
from cislunar.photometry.materials import Material


def _facets(body):
    return body_from_spec(BodySpec(**body), Material()).facets


def test_body_from_a_mesh_file_sets_the_tasking_sphere(tmp_path):
    corners = ["1 1 1", "1 -1 -1", "-1 1 -1", "-1 -1 1"]
    faces = ["1 2 3", "1 4 2", "1 3 4", "2 4 3"]
    lines = [f"v {c}" for c in corners] + [f"f {f}" for f in faces]
    path = tmp_path / "tetrahedron.obj"
    path.write_text("\n".join(lines))
    body = {"shape": str(path), "radius_m": None, "meters_per_unit": 0.5, "axis_scale": [1, 1, 1]}
    area = 4.0 * np.sqrt(3.0) / 4.0 * (0.5 * np.sqrt(8.0)) ** 2
    assert _facets(body).total_area == pytest.approx(area)
    settings = small_settings(body=body)
    radius = loop_settings(CellSettings(**settings), 60).tasking.radius_m
    assert radius == pytest.approx(np.sqrt(area / (4.0 * np.pi)))
    assert cell_files(settings) == [str(path)]
    assert cell_files(small_settings()) == []
    assert cell_files(small_settings(truth={"body": body})) == [str(path)]
    assert cell_files(small_settings(body=body, truth={"body": body})) == [str(path)]
    larger = _facets(body | {"axis_scale": [2, 2, 2]})
    assert larger.total_area == pytest.approx(4.0 * area)


def test_table_of_bodies_is_of_the_targets_it_names(tmp_path):
    """By number or name; the others, and tasking's sphere, keep the body of the settings."""
    table = tmp_path / "bodies.csv"
    header = "target,shape,radius_m,materials,inertia_x,inertia_y,inertia_z"
    rows = [header, "1,box-with-wings,2,,3,2,2"]
    rows.append("GATEWAY,icosahedron,3,=0.2 0.1 0.3 0.2 0.4,,,")
    table.write_text("\n".join(rows))
    truth = {"body": {"table": str(table), "inertia": [1.0, 1.2, 0.9]}}
    settings = CellSettings(**small_settings(truth=truth))
    names = [["1"], ["7", "GATEWAY"], ["3", "X"]]
    assumed, true = nominal_surfaces(settings, names), truth_model(settings, names).surfaces
    np.testing.assert_array_equal(true.composite, [True, False, False])
    sizes = np.add.reduceat(true.areas, true.first[:-1]) / (4.0 * np.pi)
    np.testing.assert_allclose(sizes, [4.0, 9.0, 1.0])
    assert body_of(true, 1).materials.tolist() == [[0.2, 0.1, 0.3, 0.2, 0.4]]
    np.testing.assert_array_equal(body_of(true, 2).areas, body_of(assumed, 2).areas)
    assert not assumed.composite.any()
    moments = np.diagonal(true.inertia, axis1=1, axis2=2)
    np.testing.assert_array_equal(moments, [[3, 2, 2], [1, 1.2, 0.9], [1, 1.2, 0.9]])
    np.testing.assert_array_equal(assumed.inertia, [np.eye(3)] * 3)
    assert (
        loop_settings(settings, 60).tasking
        == loop_settings(CellSettings(**small_settings()), 60).tasking
    )
    assert cell_files(settings.model_dump()) == [str(table)]
