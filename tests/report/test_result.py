import dataclasses
import json

import numpy as np
import pytest
from tiny_capture import write_tiny_capture

from hairfit.capture import load_capture
from hairfit.errors import InputError
from hairfit.report.result import (
    FORMAT,
    captured_from,
    close_checkpoint,
    is_result,
    open_checkpoint,
    plain,
    read_report,
    whole_folder,
    write_report,
)


@dataclasses.dataclass(frozen=True)
class Config:
    seed: int = 0


@pytest.fixture
def capture(tmp_path):
    return load_capture(write_tiny_capture(tmp_path / "tiny"))


def write(out, text):
    with whole_folder(out) as folder:
        (folder / "a.txt").write_text(text)


def test_a_folder_appears_whole_and_replaces_the_old(tmp_path):
    out = tmp_path / "deep/result"
    write(out, "old")
    write(out, "new")
    assert (out / "a.txt").read_text() == "new"
    assert list(out.parent.iterdir()) == [out]
    assert (
        out.stat().st_mode & 0o077 == tmp_path.joinpath("deep").stat().st_mode & 0o077
    )


@pytest.mark.parametrize("stop", [RuntimeError, KeyboardInterrupt])
def test_a_stop_leaves_the_old_folder_and_nothing_else(tmp_path, stop):
    out = tmp_path / "result"
    write(out, "old")
    with pytest.raises(stop), whole_folder(out) as folder:
        (folder / "a.txt").write_text("half")
        raise stop
    assert (out / "a.txt").read_text() == "old"
    assert list(tmp_path.iterdir()) == [out]


def test_a_report_is_what_makes_a_result(tmp_path):
    assert not is_result(tmp_path)
    with pytest.raises(InputError, match="is not a result of hairfit; make one with"):
        read_report(tmp_path)
    write_report(tmp_path, {"format": FORMAT, "capture": "../anna"})
    assert is_result(tmp_path) and read_report(tmp_path)["capture"] == "../anna"


def test_a_result_finds_its_capture_until_it_is_gone(tmp_path):
    out = tmp_path / "result"
    out.mkdir()
    write_report(out, {"format": FORMAT, "capture": "../tiny"})
    assert captured_from(out) is None
    write_tiny_capture(tmp_path / "tiny")
    assert captured_from(out) == tmp_path / "tiny"


def test_a_checkpoint_resumes_the_same_fit_only(tmp_path, capture):
    out = tmp_path / "result"
    first = open_checkpoint(out, capture, Config())
    assert not first.resuming
    (first.folder / "stage.npz").write_bytes(b"work")
    close_checkpoint(first, keep=True)
    assert open_checkpoint(out, capture, Config()).resuming
    other = open_checkpoint(out, capture, Config(seed=1))
    assert not other.resuming and not (other.folder / "stage.npz").exists()


def test_a_checkpoint_without_stages_is_not_left_behind(tmp_path, capture):
    checkpoint = open_checkpoint(tmp_path / "result", capture, Config())
    close_checkpoint(checkpoint, keep=True)
    assert not checkpoint.folder.exists()


def test_figures_become_plain_json():
    figures = {"a": np.float32(0.25), "b": [np.nan, 2], "c": {"d": np.arange(2)}}
    expected = {"a": 0.25, "b": [None, 2], "c": {"d": [0, 1]}}
    assert json.loads(json.dumps(plain(figures), allow_nan=False)) == expected
