import json
import pathlib
import subprocess

import pytest
from accuracy_run import (
    COMMAND,
    PACKAGE,
    SUBSETS,
    Run,
    RunFailed,
    code_digest,
    do_run,
    environment,
    fitted_views,
    flat_figures,
    held_back_views,
    photograph_means,
    with_share_error,
)


@pytest.fixture
def capture(tmp_path):
    """Return a function that makes the folder of a capture with so many cameras."""

    def make(count):
        views = [{"name": f"{i:02d}.png"} for i in range(count)]
        folder = tmp_path / f"capture{count}"
        folder.mkdir()
        (folder / "cameras.json").write_text(json.dumps({"views": views}))
        return folder

    return make


@pytest.mark.parametrize("views", list(SUBSETS))
def test_every_photograph_is_fitted_or_held_back(capture, views):
    run = Run(capture(12), views, 0, "draft")
    fitted, held = fitted_views(run), held_back_views(run)
    assert len(fitted) == views and not set(fitted) & set(held)
    assert sorted(fitted + held) == [f"{i:02d}" for i in range(12)]


def test_the_subsets_are_those_of_the_reference_captures(capture):
    twelve = capture(12)
    assert fitted_views(Run(twelve, 3, 0, "draft")) == ["00", "03", "05"]
    assert fitted_views(Run(twelve, 4, 0, "draft")) == ["00", "02", "04", "06"]
    assert held_back_views(Run(twelve, 8, 0, "draft")) == ["08", "09", "10", "11"]


def test_a_capture_without_the_photographs_is_refused(capture):
    with pytest.raises(RunFailed, match="no photographs 06, which belong to 4 views"):
        fitted_views(Run(capture(6), 4, 0, "draft"))


def test_runs_that_differ_in_the_seed_alone_are_one_group():
    folder = pathlib.Path("bob")
    one, other = Run(folder, 8, 0, "draft"), Run(folder, 8, 1, "draft")
    assert one.group == other.group == "bob, 8 views, draft" and one.name != other.name
    assert Run(folder, 4, 0, "draft").group != one.group


def test_figures_are_named_by_their_way_and_unknown_ones_left_out():
    nested = {"a": {"b": {"f": 0.5}, "c": None}, "head": None, "n": 3}
    assert flat_figures(nested) == {"a.b.f": 0.5, "n": 3.0}


def test_photographs_without_an_angle_do_not_count_for_it():
    photographs = {
        "00": {"mean_angle_deg": 10.0, "median_angle_deg": 4.0, "hair_iou": 0.5},
        "01": {"mean_angle_deg": None, "median_angle_deg": None, "hair_iou": 0.0},
    }
    photographs["00"]["covered_iou"], photographs["01"]["covered_iou"] = 0.9, 0.7
    assert photograph_means("held_back", photographs) == {
        "held_back.mean_angle_deg": 10.0,
        "held_back.median_angle_deg": 4.0,
        "held_back.hair_iou": 0.25,
        "held_back.covered_iou": 0.8,
    }
    assert photograph_means("held_back", {}) == {}


def test_a_run_that_is_kept_is_not_done_again(capture, tmp_path, monkeypatch):
    run = Run(capture(12), 8, 0, "draft")
    kept = {
        "code": code_digest(),
        "capture": str(run.capture.resolve()),
        "figures": {"f": 0.5},
    }
    path = tmp_path / "out" / "runs" / f"{run.name}.json"
    path.parent.mkdir(parents=True)
    path.write_text(json.dumps(kept))

    def fail(*words):
        raise RunFailed("fitted")

    monkeypatch.setattr("accuracy_run.call_hairfit", fail)
    assert do_run(run, tmp_path / "out") == {"f": 0.5}
    path.write_text(json.dumps(kept | {"code": "of another day"}))
    with pytest.raises(RunFailed, match="fitted"):
        do_run(run, tmp_path / "out")


def test_too_few_curls_are_an_error_below_zero():
    figures = {"curls.share": 0.25, "curls.true_share": 1.0}
    assert with_share_error(figures) == {**figures, "curls.share_error": -0.75}
    assert with_share_error({"f": 0.5}) == {"f": 0.5}


def test_commands_run_the_package_that_is_measured_and_none_beside_them(tmp_path):
    (tmp_path / "hairfit").mkdir()
    (tmp_path / "hairfit" / "__init__.py").write_text("")
    words = [*COMMAND[:-1], "import hairfit; print(hairfit.__file__)"]
    found = subprocess.run(
        words, cwd=tmp_path, env=environment(), capture_output=True, text=True
    )
    assert pathlib.Path(found.stdout.strip()).parent == PACKAGE
