import json

import pytest
from accuracy_gate import (
    TOLERANCES,
    baseline_runs,
    complaints,
    not_compared,
    read_baseline,
    write_baseline,
)
from accuracy_table import COLUMNS

F = "all.3mm_30deg.unsigned.f"
GROUP = "ruby, 8 views, normal"


def baseline(figures, tolerances, seed=0):
    return {
        "tolerances": tolerances,
        "runs": [{"group": GROUP, "seed": seed, "figures": figures}],
    }


def judge(now, was, tolerance, key=F):
    return complaints({GROUP: {0: {key: now}}}, baseline({key: was}, {key: tolerance}))


@pytest.mark.parametrize(
    ("tolerance", "was", "well", "ill"),
    [
        ({"fall": 0.01}, 0.5, 0.495, 0.485),
        ({"fall": 0.01}, 0.5, 0.9, 0.0),
        ({"rise": 2.0}, 10.0, 11.9, 12.1),
        ({"rise": 2.0}, 10.0, 0.0, 13.0),
        ({"away": 0.1}, -0.2, 0.29, 0.31),
        ({"away": 0.1}, 0.2, -0.29, -0.31),
        ({"factor": 1.5}, 100.0, 149.0, 151.0),
        ({"factor": 1.5}, 0.0, 0.0, 0.1),
        ({"fall": 0.01}, 0.5, 0.5, float("nan")),
    ],
)
def test_what_is_beyond_its_tolerance_is_complained_of(tolerance, was, well, ill):
    assert judge(well, was, tolerance) == []
    (sentence,) = judge(ill, was, tolerance)
    assert sentence.startswith(f"{GROUP}: {F} went from {was:.4g} to {ill:.4g}; it may")


def test_a_sentence_says_what_was_allowed():
    assert judge(0.4, 0.5, {"fall": 0.01}) == [
        f"{GROUP}: {F} went from 0.5 to 0.4; it may fall by 0.01."
    ]


def test_a_figure_that_is_lost_is_worse_and_a_new_one_is_not():
    known = baseline({F: 0.5}, {F: {"fall": 0.01}, "new": {"fall": 0.01}})
    assert complaints({GROUP: {0: {"new": 0.0}}}, known) == [
        f"{GROUP}: {F} was 0.5 and is unknown now."
    ]


def test_the_same_seeds_are_compared():
    known = baseline({F: 0.5}, {F: {"fall": 0.01}})
    known["runs"].append({"group": GROUP, "seed": 1, "figures": {F: 0.1}})
    # Seed 1 was bad and seed 2 is: neither counts for what seed 0 and 1 do now.
    assert complaints({GROUP: {0: {F: 0.5}, 2: {F: 0.0}}}, known) == []
    assert len(complaints({GROUP: {0: {F: 0.4}, 2: {F: 0.9}}}, known)) == 1
    # The mean of both seeds is what is held against their mean.
    assert complaints({GROUP: {0: {F: 0.3}, 1: {F: 0.3}}}, known) == []


def test_nothing_to_compare_is_no_success():
    known = baseline({F: 0.5}, {F: {"fall": 0.01}})
    runs = {"bob, 8 views, normal": {0: {F: 0.5}}}
    (sentence,) = complaints(runs, known)
    assert "has none of these captures" in sentence
    assert not_compared(runs, known) == ["bob, 8 views, normal"]
    assert "has none" in complaints({GROUP: {7: {F: 0.5}}}, known)[0]


def test_a_baseline_is_read_as_it_was_written(tmp_path):
    path = tmp_path / "baseline.json"
    runs = {GROUP: {0: {F: 0.123456789, "seconds": 61.0, "other": 1.0}, 2: {F: 0.2}}}
    write_baseline(path, runs, "a machine")
    found = read_baseline(path)
    assert baseline_runs(found) == {
        GROUP: {0: {F: 0.123457, "seconds": 61.0}, 2: {F: 0.2}}
    }
    assert found["machine"] == "a machine" and found["tolerances"] == TOLERANCES
    assert complaints(runs, found) == []


@pytest.mark.parametrize(("share", "told"), [(0.11, False), (0.98, True)])
def test_turns_of_straight_hair_are_not_judged(tmp_path, share, told):
    path = tmp_path / "baseline.json"
    radius = "curls.median_radius_relative"
    figures = {F: 0.5, "curls.true_share": share, radius: -0.44}
    write_baseline(path, {GROUP: {0: figures}}, "a machine")
    assert (radius in baseline_runs(read_baseline(path))[GROUP][0]) == told


def test_tolerances_that_were_edited_stay(tmp_path):
    path = tmp_path / "baseline.json"
    write_baseline(path, {GROUP: {0: {F: 0.5}}}, "a machine")
    text = json.loads(path.read_text())
    text["tolerances"] = {F: {"fall": 0.25}}
    path.write_text(json.dumps(text))
    write_baseline(path, {GROUP: {0: {F: 0.6}}}, "a machine")
    assert complaints({GROUP: {0: {F: 0.4}}}, read_baseline(path)) == []
    assert len(complaints({GROUP: {0: {F: 0.3}}}, read_baseline(path))) == 1


def test_a_slow_hour_does_not_allow_more_time(tmp_path):
    path = tmp_path / "baseline.json"
    fast, slow = {F: 0.5, "seconds": 50.0}, {F: 0.6, "seconds": 80.0}
    for took in (fast, slow):
        write_baseline(path, {GROUP: {0: took}}, "a machine")
    assert baseline_runs(read_baseline(path))[GROUP][0] == {F: 0.6, "seconds": 50.0}
    write_baseline(path, {GROUP: {0: fast | {"seconds": 40.0}}}, "a machine")
    assert baseline_runs(read_baseline(path))[GROUP][0]["seconds"] == 40.0
    write_baseline(path, {GROUP: {0: slow}}, "another machine")
    assert baseline_runs(read_baseline(path))[GROUP][0]["seconds"] == 80.0


@pytest.mark.parametrize("wrong", [{"sink": 1.0}, {}, {"fall": 1.0, "rise": 1.0}])
def test_a_tolerance_that_means_nothing_is_refused(tmp_path, wrong):
    path = tmp_path / "baseline.json"
    path.write_text(json.dumps(baseline({F: 0.5}, {F: wrong})))
    with pytest.raises(SystemExit, match="must be one of fall, rise, away, factor"):
        read_baseline(path)


def test_a_missing_baseline_says_how_to_make_one(tmp_path):
    with pytest.raises(SystemExit, match="make one with --write-baseline"):
        read_baseline(tmp_path / "none.json")


def test_what_is_judged_by_default_is_what_the_table_shows():
    shown = {key for column in COLUMNS for key in column.keys}
    assert set(TOLERANCES) <= shown
