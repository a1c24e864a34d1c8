import pathlib
import struct
import zipfile

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hairfit.errors import InputError
from hairfit.io.strands import load_strands, save_strands
from hairfit.types import Strands

FLOATS = st.floats(-10, 10, width=32)


@st.composite
def hairs(draw):
    counts = draw(st.lists(st.integers(1, 6), min_size=1, max_size=8))
    points = draw(hnp.arrays(np.float32, (sum(counts), 3), elements=FLOATS))
    return Strands(points, np.concatenate([[0], np.cumsum(counts)]).astype(np.int64))


@pytest.mark.parametrize("suffix", [".hair", ".npz"])
@hypothesis.given(strands=hairs())
@hypothesis.settings(max_examples=40, deadline=None)
def test_strands_come_back_as_they_were_saved(tmp_path_factory, suffix, strands):
    path = tmp_path_factory.mktemp("strands") / f"a{suffix}"
    save_strands(path, strands)
    again = load_strands(path)
    assert np.array_equal(again.points, strands.points)
    assert np.array_equal(again.offsets, strands.offsets)
    first = path.read_bytes()
    save_strands(path, again)
    assert path.read_bytes() == first


def hair(counts=(3, 3)):
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    points = np.arange(3.0 * offsets[-1]).reshape(-1, 3).astype(np.float32)
    return Strands(points, offsets)


def header(count, points, flags, default):
    return struct.pack(
        "<4sIIIIff3f88s", b"HAIR", count, points, flags, default, 1, 0, 1, 1, 1, b""
    )


def test_even_strands_need_no_table_of_segments(tmp_path):
    save_strands(tmp_path / "a.hair", hair((3, 3)))
    content = (tmp_path / "a.hair").read_bytes()
    assert len(content) == 128 + 6 * 12
    assert struct.unpack_from("<4sIIII", content) == (b"HAIR", 2, 6, 2, 2)
    save_strands(tmp_path / "b.hair", hair((2, 4)))
    content = (tmp_path / "b.hair").read_bytes()
    assert len(content) == 128 + 2 * 2 + 6 * 12
    assert struct.unpack_from("<4sIIII", content) == (b"HAIR", 2, 6, 3, 0)
    assert struct.unpack_from("<2H", content, 128) == (1, 3)


def test_thickness_and_colours_are_passed_over(tmp_path):
    points = np.arange(12, dtype="<f4")
    content = header(2, 4, 0b11111, 0) + struct.pack("<2H", 0, 2) + points.tobytes()
    (tmp_path / "a.hair").write_bytes(content + bytes(4 * 4 + 4 * 4 + 4 * 12))
    strands = load_strands(tmp_path / "a.hair")
    assert strands.offsets.tolist() == [0, 1, 4]
    assert np.array_equal(strands.points.ravel(), points)


def test_a_file_by_the_format_s_author_is_read():
    path = pathlib.Path(__file__).parents[3] / "shared" / "files" / "straight.hair"
    if not path.is_file():
        pytest.skip("the hair file made by others is not at ../shared/files")
    strands = load_strands(path)
    assert strands.count == 10_000 and np.all(np.diff(strands.offsets) == 16)
    low, high = strands.points.min(0), strands.points.max(0)
    assert np.allclose(low, [-32.496, -33.901, -22.709], atol=1e-3)
    assert np.allclose(high, [30.899, 24.074, 63.678], atol=1e-3)


def test_a_result_folder_stands_for_its_strands(tmp_path):
    with pytest.raises(InputError, match=r"no 'strands\.hair' in '.*`hairfit fit`"):
        load_strands(tmp_path)
    save_strands(tmp_path / "strands.hair", hair())
    assert load_strands(tmp_path).count == 2


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.hairtree", r"is a tree; grow its strands with `hairfit strands .*a\.hair`"),
        ("a.abc", r"is not a file of strands; give a \.hair or an \.npz"),
        ("a.hair", r"there is no '.*a\.hair'; check the path"),
    ],
)
def test_what_holds_no_strands_is_refused(tmp_path, name, message):
    with pytest.raises(InputError, match=message):
        load_strands(tmp_path / name)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is not a .hair file"),
        (b"hello " * 40, "is not a .hair file"),
        (header(1, 2, 1, 1), "holds no points"),
        (header(1, 2, 2, 1) + bytes(23), "ends early: it has 151 of 152 bytes"),
        (header(4_000_000_000, 2, 2, 9) + bytes(24), "its strands need 40000000000"),
        (header(0, 0, 2, 0), "holds no strand"),
        (header(1, 2, 3, 0) + b"\5\0" + bytes(24), "need 6 points, it has 2"),
        (header(1, 1, 2, 0) + np.full(3, np.nan, "<f4").tobytes(), "not finite"),
    ],
)
def test_a_damaged_hair_file_is_refused(tmp_path, content, message):
    path = tmp_path / "a.hair"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        load_strands(path)


def test_a_damaged_npz_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    for content in (b"", b"hello"):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"is damaged or no \.npz of strands"):
            load_strands(path)
    save_strands(path, hair())
    whole = path.read_bytes()
    for cut in range(1, len(whole), 37):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError, match=r"is damaged or no \.npz of strands"):
            load_strands(path)


@pytest.mark.parametrize(
    ("points", "offsets", "message"),
    [
        (None, [0, 2], "has no array `points`"),
        (np.zeros((2, 3)), None, "has no array `offsets`"),
        (np.zeros((2, 2)), [0, 2], r"`points` in .* of shape \(2, 2\)"),
        (np.zeros((2, 3)), [0.0, 2.0], "`offsets` in .* are float64"),
        (np.zeros((2, 3)), [0, 3], "do not run from 0 to its 2 points"),
        (np.zeros((2, 3)), [0, 2, 2], "holds a strand without points"),
        (np.zeros((2, 3)), [0], "holds no strand"),
        (np.full((2, 3), np.inf), [0, 2], "points that are not finite"),
    ],
)
def test_arrays_that_are_no_strands_are_refused(tmp_path, points, offsets, message):
    arrays = {"points": points, "offsets": offsets}
    given = {name: np.asarray(v) for name, v in arrays.items() if v is not None}
    np.savez(tmp_path / "a.npz", allow_pickle=False, **given)
    with pytest.raises(InputError, match=message):
        load_strands(tmp_path / "a.npz")


def test_pickles_are_not_opened(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, points=np.array([{}], object), offsets=np.array([0, 1]))
    with pytest.raises(InputError, match=r"is damaged or no \.npz of strands"):
        load_strands(path)


def test_compressed_arrays_are_read(tmp_path):
    np.savez_compressed(
        tmp_path / "a.npz", points=hair().points, offsets=hair().offsets
    )
    assert load_strands(tmp_path / "a.npz").count == 2
    with zipfile.ZipFile(tmp_path / "a.npz") as archive:
        assert archive.infolist()[0].compress_type == zipfile.ZIP_DEFLATED


def test_strands_too_long_for_a_hair_file_are_refused(tmp_path):
    long = Strands(np.zeros((65_537, 3), np.float32), np.array([0, 65_537]))
    with pytest.raises(InputError, match=r"holds strands of 1 to 65536 points"):
        save_strands(tmp_path / "a.hair", long)
    with pytest.raises(InputError, match=r"saved as \.hair or \.npz, not as 'a\.abc'"):
        save_strands(tmp_path / "a.abc", hair())
    assert list(tmp_path.iterdir()) == []
