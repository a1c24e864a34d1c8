"""Each option of `hairfit render` does what it says, as pixels show."""

import dataclasses
import json
import shutil
import stat

import cv2
import numpy as np
import pytest
from PIL import Image, ImageSequence
from tiny_capture import HEIGHT, WIDTH, write_tiny_capture

from hairfit.cli import main
from hairfit.io.strands import save_strands
from hairfit.io.tree import save_tree
from hairfit.model.maps import even_maps
from hairfit.render.gl import NoContextError
from hairfit.render.gl.context import COMPUTE, open_context
from hairfit.report.result import FORMAT, write_report
from hairfit.synthetic import make_head, make_scalp, make_style
from hairfit.types import Strands

SIZE = ("--size", 64, 80)
DRAFT = ("--quality", "draft", "--quiet")


@pytest.fixture(scope="module")
def opengl():
    try:
        context = open_context()
    except NoContextError as error:
        pytest.skip(f"OpenGL is needed here: {error}")
    version = context.version_code
    context.release()
    if version < COMPUTE:
        pytest.skip(f"OpenGL 4.3 is needed here, this is {version}.")


@pytest.fixture
def hair(tmp_path):
    """A curtain of hair before a ball, more of it on the person's left."""
    rng = np.random.default_rng(0)
    x = rng.uniform(-0.03, 0.06, (900, 1))
    z = 0.105 + 0.01 * rng.uniform(size=(900, 1))
    t = np.linspace(0.0, 1.0, 10)[None]
    points = np.stack([x + 0 * t, 0.06 - 0.12 * t + 0 * x, z + 0 * t], -1)
    path = tmp_path / "curtain.hair"
    save_strands(path, Strands.from_array(points))
    return path


@pytest.fixture
def capture(tmp_path):
    return write_tiny_capture(tmp_path / "tiny")


def run(*words):
    return main([str(word) for word in words])


def drawn(path, hair, *words):
    assert run("render", hair, "--out", path, *DRAFT, *words) == 0
    with Image.open(path) as picture:
        return np.asarray(picture).astype(int)


def refused(capsys, *words):
    assert run("render", *words) == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    return line


def test_a_transparent_picture_has_the_hair_as_alpha(opengl, hair, tmp_path):
    picture = drawn(tmp_path / "a.png", hair, *SIZE, "--transparent")
    assert picture.shape == (80, 64, 4)
    assert picture[0, 0, 3] == 0 and picture[40, 32, 3] > 230


def test_the_background_has_its_colour(opengl, hair, tmp_path):
    picture = drawn(tmp_path / "a.png", hair, *SIZE, "--background", "#204060")
    assert picture[0, 0].tolist() == [0x20, 0x40, 0x60]


@pytest.mark.parametrize("shading", ["kajiya-kay", "chiang", "marschner"])
def test_hair_has_its_colour(opengl, hair, tmp_path, shading):
    words = (*SIZE, "--shading", shading, "--colour")
    blue = drawn(tmp_path / "blue.png", hair, *words, "102090")[30:50, 24:40]
    red = drawn(tmp_path / "red.png", hair, *words, "red")[30:50, 24:40]
    assert blue[..., 2].mean() > 1.3 * blue[..., 0].mean()
    assert red[..., 0].mean() > 1.3 * red[..., 2].mean()


def test_a_tree_is_drawn_in_the_colour_painted_on_it(opengl, tmp_path):
    blue = even_maps(4, 4, colour=(0.03, 0.06, 0.4))
    tree = make_style("straight", 0, make_scalp(make_head()))
    save_tree(tmp_path / "blue.hairtree", dataclasses.replace(tree, maps=blue))
    words = (tmp_path / "blue.hairtree", *SIZE, "--transparent")
    own, red = (
        drawn(tmp_path / "a.png", *words),
        drawn(tmp_path / "b.png", *words, "--colour", "red"),
    )
    dense = own[..., 3] > 250
    assert dense.sum() > 100
    assert own[dense, 2].mean() > 1.5 * own[dense, 0].mean()
    assert red[dense, 0].mean() > 1.5 * red[dense, 2].mean()


def test_strands_of_a_result_are_as_wide_as_masks_asked_for(opengl, hair, tmp_path):
    covered = []
    for name, total_width in ("thin", 0.02), ("thick", 0.2), ("unknown", None):
        result = tmp_path / name
        result.mkdir()
        shutil.copy(hair, result / "strands.hair")
        maps = even_maps(4, 4, colour=(0.2, 0.1, 0.05))
        tree = make_style("straight", 0, make_scalp(make_head()))
        save_tree(result / "tree.hairtree", dataclasses.replace(tree, maps=maps))
        looks = None if total_width is None else {"total_width": total_width}
        report = {"format": FORMAT, "capture": "gone", "looks": looks}
        write_report(result, report)
        words = (*SIZE, "--transparent")
        own = drawn(tmp_path / "a.png", result, *words)
        if total_width is not None:
            words = *words, "--width-mm", max(1000.0 * total_width / 900, 0.06)
            assert (own == drawn(tmp_path / "b.png", result, *words)).all()
        covered.append(own[..., 3].mean())
    thin, thick, unknown = covered
    assert 1.2 * thin < thick < 1.2 * unknown


def test_pigment_makes_hair_dark(opengl, hair, tmp_path):
    light = drawn(tmp_path / "a.png", hair, *SIZE, "--melanin", 0.1, 0.1)
    dark = drawn(tmp_path / "b.png", hair, *SIZE, "--melanin", 6, 0.3)
    assert light[40, 20:44].mean() > 2.0 * dark[40, 20:44].mean()


def test_wider_hair_covers_more_and_clear_hair_less(opengl, hair, tmp_path):
    words = (*SIZE, "--transparent", "--width-mm")
    thin = drawn(tmp_path / "a.png", hair, *words, 0.05)[..., 3].sum()
    wide = drawn(tmp_path / "b.png", hair, *words, 0.4)[..., 3].sum()
    clear = drawn(tmp_path / "c.png", hair, *words, 0.4, "--alpha", 0.2)[..., 3].sum()
    assert thin < 0.7 * wide and clear < 0.7 * wide


def test_light_comes_from_where_it_is_put(opengl, hair, tmp_path):
    words = (*SIZE, "--sky", 0, "--transparent", "--light")
    before = drawn(tmp_path / "a.png", hair, *words, 0, 20, 2)
    behind = drawn(tmp_path / "b.png", hair, *words, 180, 20, 2)
    both = drawn(
        tmp_path / "c.png", hair, *words, 0, 20, 2, "--light", 90, 0, 1, "--no-shadows"
    )
    middle = (slice(30, 50), slice(24, 40), slice(3))
    assert before[middle].mean() > 1.5 * behind[middle].mean()
    assert both[middle].mean() > 1.1 * before[middle].mean()


def test_the_photograph_is_behind_the_hair_and_the_head_hides_hair(
    opengl, hair, capture, tmp_path
):
    words = ("--capture", capture, "--photo", "--view")
    photo = np.asarray(Image.open(capture / "images/00.png")).astype(int)
    front = drawn(tmp_path / "a.png", hair, *words, "00")
    assert front.shape == (HEIGHT, WIDTH, 3)
    changed = np.abs(front - photo).max(-1) > 8
    assert changed[32, 30] and not changed[:4].any() and not changed[:, :4].any()
    # Views 01 and 02 are behind the ball: most of the curtain is hidden, and no skin
    # is drawn at the ball's outline.
    side = drawn(tmp_path / "b.png", hair, *words, "01")
    assert (np.abs(side - photo).max(-1) > 8).mean() < 0.5 * changed.mean()
    bare = tmp_path / "far.hair"
    save_strands(bare, Strands.from_array(np.full((1, 2, 3), 9.0) + [[[0], [0.01]]]))
    assert np.abs(drawn(tmp_path / "c.png", bare, *words, "00") - photo).max() <= 1


def test_a_photograph_may_be_drawn_at_another_size(opengl, hair, capture, tmp_path):
    words = ("--capture", capture, "--view", "00", "--scale", 2)
    assert drawn(tmp_path / "a.png", hair, *words).shape == (2 * HEIGHT, 2 * WIDTH, 3)
    words = (*words, "--photo")
    large = drawn(tmp_path / "b.png", hair, *words)
    assert abs(large[0, 0, 0] - 180) <= 1


def test_all_views_go_into_a_folder(opengl, hair, capture, tmp_path, capsys):
    words = ("--capture", capture, "--view", "all", "--json", *DRAFT)
    assert run("render", hair, "--out", tmp_path / "all", *words) == 0
    fact = json.loads(capsys.readouterr().out)
    assert fact["pictures"] == 3 and fact["size"] == [WIDTH, HEIGHT]
    assert fact["engine"] == "gl" and fact["seconds"] > 0
    found = sorted(path.name for path in (tmp_path / "all").iterdir())
    assert found == ["00.png", "01.png", "02.png"]


def test_a_picture_with_depth_hides_the_hair_behind_it(opengl, hair, tmp_path):
    behind = np.full((80, 64, 3), 255, np.uint8)
    cv2.imwrite(str(tmp_path / "scene.png"), behind)
    depth = np.full((80, 64), np.nan, np.float32)
    depth[:, :32] = 0.01  # a wall before the left half
    np.save(tmp_path / "depth.npy", depth)
    cv2.imwrite(str(tmp_path / "depth.tiff"), depth)
    words = ("--behind", tmp_path / "scene.png", "--behind-depth")
    pictures = [
        drawn(tmp_path / f"{k}.png", hair, *words, tmp_path / f"depth.{kind}")
        for k, kind in enumerate(("npy", "tiff"))
    ]
    assert (pictures[0] == pictures[1]).all()
    assert pictures[0].shape == (80, 64, 3)
    assert (pictures[0][:, :32] == 255).all() and pictures[0][40, 36].max() < 250


def test_a_turntable_turns(opengl, hair, tmp_path):
    out = tmp_path / "turns"
    words = ("--turntable", 2, *SIZE, *DRAFT)
    assert run("render", hair, "--out", out, *words) == 0
    frames = [np.asarray(Image.open(out / f"frame-000{k}.png")) for k in range(2)]
    assert np.abs(frames[0].astype(int) - frames[1]).max() > 40
    gif = tmp_path / "turns.gif"
    assert run("render", hair, "--out", gif, "--turntable", 3, *SIZE, *DRAFT) == 0
    with Image.open(gif) as film:
        assert len(list(ImageSequence.Iterator(film))) == 3 and film.size == (64, 80)
        film.seek(0)
        assert film.info["loop"] == 0
        shown = np.asarray(film.convert("RGB")).astype(int)
    assert np.abs(shown - frames[0]).mean() < 6.0


def fake_ffmpeg(folder, monkeypatch, lines):
    folder.mkdir()
    program = folder / "ffmpeg"
    program.write_text("#!/bin/sh\n" + lines)
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")


def test_a_film_is_made_by_ffmpeg(opengl, hair, tmp_path, monkeypatch):
    fake_ffmpeg(
        tmp_path / "bin",
        monkeypatch,
        'for last; do :; done; echo "$@" > "$last.txt"; cat > "$last"\n'
        f'mv "$last.txt" {tmp_path}/words\n',
    )
    film = tmp_path / "a.mp4"
    assert run("render", hair, "--out", film, "--turntable", 2, *SIZE, *DRAFT) == 0
    assert film.stat().st_size == 2 * 64 * 80 * 3
    assert "-pix_fmt rgb24 -s 64x80" in (tmp_path / "words").read_text()


def test_a_film_that_fails_leaves_nothing(opengl, hair, tmp_path, monkeypatch, capsys):
    lines = "echo 'no such encoder' >&2; exit 3\n"
    fake_ffmpeg(tmp_path / "bin", monkeypatch, lines)
    words = ("--out", tmp_path / "a.mp4", "--turntable", 2, *SIZE, *DRAFT)
    line = refused(capsys, hair, *words)
    assert "ffmpeg could not write the film (no such encoder); end --out with" in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bin", "curtain.hair"]


def test_films_need_ffmpeg(hair, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", str(tmp_path))
    line = refused(capsys, hair, "--out", tmp_path / "a.mp4", "--turntable", 2)
    assert "films need ffmpeg, which is not here; install it" in line


def test_a_drawing_is_black_on_white(hair, tmp_path):
    picture = drawn(tmp_path / "a.png", hair, "--size", 96, 96, "--lines")
    assert (picture[0] == 255).all() and picture.min() < 60
    assert 0.02 < (picture < 128).mean() < 0.5
    ink = drawn(tmp_path / "b.png", hair, "--size", 96, 96, "--lines", "--transparent")
    assert ink[0, 0, 3] == 0 and ink[..., 3].max() > 200


def test_without_opengl_jax_draws_and_says_so(hair, tmp_path, monkeypatch, capsys):
    def refuse():
        raise NoContextError("no OpenGL here; install some.")

    monkeypatch.setattr("hairfit.report.engines.open_context", refuse)
    words = ("--quality", "draft", *SIZE, "--transparent")
    out = tmp_path / "a.png"
    assert run("render", hair, "--out", out, *words, "--json") == 0
    printed = capsys.readouterr()
    assert "there is no OpenGL 4.3 here; JAX draws instead" in printed.err
    assert json.loads(printed.out)["engine"] == "jax"
    picture = np.asarray(Image.open(out))
    assert picture[0, 0, 3] == 0 and picture[40, 32, 3] > 200
    assert run("render", hair, "--out", out, *words, "--engine", "gl", "--quiet") == 2
    assert capsys.readouterr().err == "hairfit: no OpenGL here; install some.\n"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--size", 8, 80), "--size must be from 16 to 8192 pixels, not 8 80."),
        (("--size", 9000, 80), "--size must be from 16 to 8192 pixels, not 9000 80."),
        (("--colour", "mauve"), "--colour 'mauve' is no colour; give black, brown,"),
        (("--colour", "red", "--melanin", 1, 1), "--colour and --melanin exclude"),
        (("--melanin", -1, 1), "--melanin must be two numbers from 0 to 100"),
        (("--background", "white"), "--background 'white' is no colour; give six hexa"),
        (("--background", "fff000", "--transparent"), "--background and --transparent"),
        (("--photo",), "--photo needs to know which photograph; name it by --view."),
        (("--behind-depth", "a.npy"), "--behind-depth needs the picture itself"),
        (("--width-mm", 0), "--width-mm must be from 0.001 to 20, not 0; hair is"),
        (("--alpha", 0), "--alpha must be above 0 and at most 1, not 0."),
        (("--strands", 0), "--strands must be at least 1, not 0."),
        (("--scale", 2), "--scale enlarges a photograph's size; give --view"),
        (("--turntable", 1), "--turntable must be from 2 to 10000, not 1."),
        (("--turntable", 2), "must be a folder, .gif or .mp4 for 2 pictures; rename"),
        (("--turntable", 2, "--view", "00"), "--view and --turntable exclude each"),
        (("--view", "all"), "must be a folder for --view all; rename it."),
        (("--view", "00", *SIZE), "--view has the photograph's size; give --scale"),
        (("--sky", -1), "--sky must be at least 0, not -1."),
        (("--light", 0, 0, -1), "--light needs two angles in degrees, and a strength"),
        (9 * ("--light", 0, 0, 1), "--light is given 9 times, and 8 are the most"),
        (("--lines", "--behind", "a.png"), "--lines are drawn on plain paper; leave"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_a_sentence(
    hair, tmp_path, capsys, words, sentence
):
    line = refused(capsys, hair, "--out", tmp_path / "a.png", *words)
    assert sentence in line
    assert [path.name for path in tmp_path.iterdir()] == ["curtain.hair"]


def test_a_folder_that_holds_something_is_refused(hair, tmp_path, capsys):
    line = refused(capsys, hair, "--out", tmp_path, "--turntable", 2)
    assert "must be a new or empty folder; name another." in line


def test_a_photograph_at_a_monstrous_scale_is_refused(hair, capture, tmp_path, capsys):
    words = ("--capture", capture, "--view", "00", "--scale", 200)
    line = refused(capsys, hair, "--out", tmp_path / "a.png", *words)
    assert f"a picture of {200 * WIDTH} x {200 * HEIGHT} pixels cannot be drawn" in line


def test_a_background_of_another_size_is_refused(hair, tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "scene.png"), np.zeros((20, 30, 3), np.uint8))
    words = ("--behind", tmp_path / "scene.png", *SIZE, *DRAFT, "--engine", "gl")
    line = refused(capsys, hair, "--out", tmp_path / "a.png", *words)
    assert "has 30x20 pixels and not 64x80; render it in that size" in line
    assert not (tmp_path / "a.png").exists()
