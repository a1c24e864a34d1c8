import pytest
from accuracy_table import COLUMNS, Column, Spread, gather, markdown, mean_group

KEYS = {key for column in COLUMNS for key in column.keys}


def figures(value: float) -> dict[str, float]:
    return {key: value for key in KEYS}


def test_seeds_give_mean_and_deviation():
    group = gather([{"f": 0.1}, {"f": 0.2}, {"f": 0.6}])
    assert group["f"].mean == pytest.approx(0.3)
    assert group["f"].deviation == pytest.approx(0.07**0.5)  # of the sample


def test_one_seed_has_no_deviation():
    assert gather([{"f": 0.1}])["f"] == Spread(0.1, 0.0)


def test_a_figure_that_one_seed_lacks_is_the_mean_of_the_others():
    group = gather([{"f": 0.2, "g": 1.0}, {"f": 0.4}, {"f": 0.6, "g": 3.0}])
    assert group["f"].mean == pytest.approx(0.4) and group["g"].mean == 2.0


def test_captures_count_alike_and_their_differences_are_no_deviation():
    many = gather([{"f": 0.0}, {"f": 0.2}, {"f": 0.1}])
    found = mean_group([many, gather([{"f": 0.5}])])["f"]
    assert found.mean == pytest.approx(0.3) and found.deviation == 0.0


def test_a_cell_names_unit_and_deviation_and_what_is_unknown():
    column = Column("x", ("a", "b", "c"), 100.0, 1, " %")
    group = {"a": Spread(0.1234, 0.012), "b": Spread(-0.5, 0.0)}
    assert column.cell(group) == "12.3 % ± 1.2, -50.0 %, –"


def test_the_table_has_a_row_a_group_and_one_for_their_mean():
    groups = {
        "ruby, 8 views": gather([figures(0.25), figures(0.75)]),
        "bob, 8 views": gather([figures(0.0)]),
        "bob, 3 views": gather([figures(1.0)]),
    }
    table = markdown(groups, lambda name: name.split(", ")[1])
    lines = table.splitlines()
    assert len({line.count("|") for line in lines}) == 1
    assert [line.split("|")[1].strip() for line in lines] == [
        "",
        "---",
        "ruby, 8 views",
        "bob, 8 views",
        "bob, 3 views",
        "mean of 2, 8 views",
    ]
    f = [line.split("|")[2].strip() for line in lines]
    assert f[2] == ", ".join(["50.0 ± 35.4"] * 3)
    assert f[5] == "25.0, 25.0, 25.0"


def test_no_two_columns_have_one_title():
    titles = [column.title for column in COLUMNS]
    assert len(set(titles)) == len(titles)
