import pytest

from hairfit import errors
from hairfit.io.atomic import atomic_path


def test_what_is_written_appears_under_its_name(tmp_path):
    with atomic_path(tmp_path / "new" / "a.txt") as path:
        assert path.suffix == ".txt" and path.parent == tmp_path / "new"
        path.write_text("hair")
        assert not (tmp_path / "new" / "a.txt").exists()
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["a.txt"]


@pytest.mark.parametrize("stop", [ValueError, KeyboardInterrupt])
def test_what_was_there_survives_an_interruption(tmp_path, stop):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(stop), atomic_path(tmp_path / "a.txt") as path:
        path.write_text("half")
        raise stop
    assert [p.read_text() for p in tmp_path.iterdir()] == ["old"]


def test_a_folder_that_was_stopped_leaves_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), atomic_path(tmp_path / "scene") as path:
        path.mkdir()
        (path / "a.txt").write_text("half")
        raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_a_whole_folder_is_moved_into_place(tmp_path):
    with atomic_path(tmp_path / "scene") as path:
        path.mkdir()
        (path / "a.txt").write_text("hair")
    assert (tmp_path / "scene" / "a.txt").read_text() == "hair"


def test_a_folder_in_the_way_is_refused_and_kept(tmp_path):
    (tmp_path / "a.hair").mkdir()
    (tmp_path / "a.hair" / "keep").write_text("old")
    with (
        pytest.raises(
            errors.InputError, match=r"cannot write '.*a\.hair': .*directory"
        ),
        atomic_path(tmp_path / "a.hair") as path,
    ):
        path.write_text("new")
    assert [p.name for p in tmp_path.iterdir()] == ["a.hair"]
    assert (tmp_path / "a.hair" / "keep").read_text() == "old"


def test_other_errors_keep_their_traceback(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "a.hair"):
        pass  # the caller forgot to write
