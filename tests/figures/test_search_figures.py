"""Figures of sweeps and objectives: words on axes, no empty panel, numbers that do not overlap."""

import numpy as np
import pandas as pd
import pytest

from cislunar.figures.search.objectives import objectives_figure
from cislunar.figures.search.sweep import sweep_figure


def swept(values, quantities=("final_attitude_error_median", "never_observed"), targets=50):
    rows = [
        {"value": value, "estimator": estimator, "targets": targets, "quantity": quantity,
         "part": "", "unit": "1", "mean": 1.0 + k + 0.1 * (estimator == "batch"),
         "low": 0.5 + k, "high": 2.0 + k, "label": "tasking mode", "seeds": 10}
        for k, value in enumerate(values)
        for estimator in ("mukf", "batch")
        for quantity in quantities
    ]  # fmt: skip
    return pd.DataFrame(rows)


def no_texts_overlap(texts, figure):
    renderer = figure.canvas.get_renderer()
    figure.draw(renderer)
    boxes = [text.get_window_extent(renderer) for text in texts if text.get_text()]
    return not any(box.overlaps(other) for k, box in enumerate(boxes) for other in boxes[:k])


def test_values_that_are_no_numbers_stand_in_words_on_the_vertical_axis():
    figure = sweep_figure(swept(["as-in-the-paper", "learned", "of-my-own"]))
    first, second = figure.axes
    names = first.get_yticklabels()
    assert [name.get_text() for name in names] == [
        "paper's tasking",
        "learned detection",
        "of my own",
    ]
    assert no_texts_overlap(names, figure)
    width = figure.get_size_inches()[0] * figure.dpi
    assert all(0.0 <= name.get_window_extent().x0 <= width for name in names)
    assert not second.yaxis.get_tick_params()["labelleft"]
    drawn = next(line.get_xdata() for line in first.lines if line.get_label() != "")
    np.testing.assert_allclose(drawn, [1.0, 2.0, 3.0])


@pytest.mark.parametrize("value", ["ephemeris", 0.5])
def test_a_single_value_has_its_number_beside_the_marker(value):
    figure = sweep_figure(swept([value]))
    assert [text.get_text() for text in figure.axes[0].texts] == ["1", "1.1"]
    assert any("one value only" in text.get_text() for text in figure.texts)


def test_a_sweep_without_a_quantity_has_no_panel_for_it():
    assert len(sweep_figure(swept([1.0, 2.0], ("never_observed",))).axes) == 1


def architectures(scenario, information=True):
    """A front of coverage, maybe one of information, and twenty designs close to each other."""
    rng = np.random.default_rng(4)
    rows = []
    for objective, unit in (("coverage", "1"), ("information", "nat"))[: 1 + information]:
        rows += [
            {"front": objective, "objective": objective, "method": "", "unit": unit,
             "architecture": f"{objective}-{n}", "satellites": n, "value": 0.01 * n,
             "bound": 0.011 * n, "union_coverage": 0.01 * n, "information_nat": 5.0 + 0.1 * n}
            for n in (10, 20, 40)
        ]  # fmt: skip
    rows += [
        {"front": "", "objective": "information", "method": "exact", "unit": "nat",
         "architecture": f"mine-{k}", "satellites": 10 + k,
         "union_coverage": 0.3 + 0.02 * rng.random(), "information_nat": 8.0 + 0.5 * rng.random()}
        for k in range(20)
    ]  # fmt: skip
    return pd.DataFrame(rows).assign(scenario=scenario)


def test_objectives_without_a_front_have_no_panel():
    figure = objectives_figure({"A": architectures("A"), "B": architectures("B", False)})
    assert len(figure.axes) == 3 + 2
    assert all(axes.lines for axes in figure.axes)


def test_numbers_of_satellites_do_not_overlap():
    figure = objectives_figure({"A": architectures("A")})
    texts = figure.axes[2].texts
    assert 3 <= len(texts) <= 20 and no_texts_overlap(texts, figure)
