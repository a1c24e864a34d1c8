import numpy as np
import pytest

from hairfit.fit.checkpoint import Checkpoint


@pytest.fixture
def arrays():
    rng = np.random.default_rng(0)
    return {
        "points": rng.normal(size=(4, 3)),
        "owner": np.array([0, -1, 2], np.int32),
        "error": np.array(0.25),
    }


def test_what_was_kept_comes_back_to_the_bit(tmp_path, arrays):
    store = Checkpoint(tmp_path / "stages")
    store.save("grown", arrays)
    found = store.load("grown")
    assert found is not None and found.keys() == arrays.keys()
    for name, values in arrays.items():
        assert found[name].dtype == values.dtype
        assert np.array_equal(found[name], values)


def test_a_stage_that_was_not_kept_is_none(tmp_path, arrays):
    store = Checkpoint(tmp_path)
    store.save("grown", arrays)
    assert store.load("cylinders") is None


def test_a_stage_that_was_interrupted_is_not_there(tmp_path, arrays, monkeypatch):
    def interrupted(file, **_):
        file.write(b"half of it")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", interrupted)
    store = Checkpoint(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        store.save("grown", arrays)
    assert store.load("grown") is None
    assert not list(tmp_path.iterdir())


def test_an_interrupted_stage_leaves_what_was_kept_before(
    tmp_path, arrays, monkeypatch
):
    store = Checkpoint(tmp_path)
    store.save("grown", arrays)

    def interrupted(file, **_):
        file.write(b"half of it")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", interrupted)
    with pytest.raises(KeyboardInterrupt):
        store.save("grown", {"points": np.zeros((1, 3))})
    found = store.load("grown")
    assert found is not None and np.array_equal(found["points"], arrays["points"])


def test_without_a_folder_nothing_is_kept(arrays):
    store = Checkpoint(None)
    store.save("grown", arrays)
    assert store.load("grown") is None
