import dataclasses
import json
import os
import subprocess
import sys
from importlib.metadata import version

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tiny_capture import HEIGHT, NAMES, WIDTH, write_tiny_capture

from hairfit import fit
from hairfit.capture.orientation import OrientationMap
from hairfit.capture.photos import read_photo
from hairfit.capture.shake import Smear
from hairfit.cli import main, sooner
from hairfit.fit.suspects import shaken_doubt
from hairfit.io.mesh import save_mesh
from hairfit.io.strands import load_strands, save_strands
from hairfit.io.tree import load_tree
from hairfit.model.cylinder import GeneralizedCylinder
from hairfit.model.scalp import Scalp
from hairfit.model.tree import HairTree, ScalpContour
from hairfit.report.show import TURNS
from hairfit.synthetic import head_distance, make_head
from hairfit.types import Mesh, Strands


@pytest.fixture
def capture(tmp_path):
    return write_tiny_capture(tmp_path / "tiny")


def ball_scalp():
    """A scalp on the upper part of a ball of 10 cm."""
    side = np.linspace(-0.06, 0.06, 13)
    x, z = np.meshgrid(side, side, indexing="ij")
    control = np.stack([x, np.sqrt(0.01 - x**2 - z**2), z], axis=-1)
    return Scalp(jnp.asarray(control))


def one_cluster():
    """A tree of one cluster that falls to the side and covers most of the scalp."""
    t = np.linspace(0.0, 1.0, 6)
    skeleton = np.stack([0.1 * t, 0.1 + 0.03 * t - 0.1 * t**2, 0 * t], axis=1)
    contour = jax.vmap(ScalpContour)(
        jnp.array([[0.5, 0.5]]), jnp.array([0.4]), jnp.zeros((1, 32))
    )
    cylinder = jax.vmap(GeneralizedCylinder)(
        jnp.asarray(skeleton[None]),
        jnp.array([[0.0, 0.0, 1.0]]),
        jnp.full((1, 6), 0.03),
        jnp.zeros((1, 6, 32)),
        jnp.ones((1, 6, 2)),
        jnp.zeros((1, 6)),
        jnp.zeros((1, 6)),
    )
    return HairTree(ball_scalp(), contour, cylinder, jnp.zeros(1), (-1,))


def hair(count=40, knots=8):
    """Strands that fall from the top of the ball in front of it."""
    x = np.linspace(-0.05, 0.05, count)[:, None]
    t = np.linspace(0.0, 1.0, knots)[None]
    points = np.stack([x + 0 * t, 0.11 - 0.12 * t + 0 * x, 0.105 + 0 * x + 0 * t], -1)
    return Strands.from_array(points)


class FakeFit:
    """Stands for `fit_capture`: answers at once, and can be stopped half way."""

    def __init__(self):
        self.stop = None
        self.resumed = False
        self.doubts = ()

    def __call__(self, capture, config, *, checkpoint, progress):
        stage = checkpoint / "stage.txt"
        self.resumed = stage.exists()
        progress("looking", 0.0)
        stage.write_text("done")
        progress("growing", 0.5)
        if self.stop is not None:
            raise self.stop
        shape = (HEIGHT, WIDTH)
        found = OrientationMap(
            np.full(shape, np.pi / 2), np.ones(shape), np.full(shape, 0.1)
        )
        return fit.FitResult(
            tree=one_cluster(),
            strands=hair(),
            owner=np.zeros(hair().count, int),
            looks=None,
            figures={"quality": config.quality, "loss": 0.125},
            maps=[found for _ in capture.views],
            views=tuple(capture.views),
            depths=[np.full(shape, np.inf) for _ in capture.views],
            doubts=self.doubts,
        )


@pytest.fixture
def fake(monkeypatch):
    fake = FakeFit()
    monkeypatch.setattr("hairfit.report.fitting.fit_capture", fake)
    monkeypatch.setattr("hairfit.report.show.TURNS", dict.fromkeys(TURNS, 2))
    monkeypatch.setattr("hairfit.report.show.TURNTABLE_SIZE", (24, 30))
    return fake


def run(*words):
    return main([str(word) for word in words])


def test_a_fit_writes_the_whole_result(fake, capture, tmp_path, capsys):
    out = tmp_path / "result"
    assert run("fit", capture, "--out", out, "--seed", 3, "--json") == 0
    printed = capsys.readouterr()
    line = json.loads(printed.out)
    assert line["result"] == str(out) and line["seconds"] >= 0
    figures = {"quality": "normal", "loss": 0.125}
    assert line["figures"] == figures and line["views"] == list(NAMES)
    report = json.loads((out / "report.json").read_text())
    assert report["capture"] == "../tiny"
    assert report["settings"] == {"quality": "normal", "seed": 3, "strands": 16000}
    assert set(report["photographs"]) == set(NAMES)
    found = {path.name for path in out.iterdir()}
    assert found == {
        "tree.hairtree",
        "strands.hair",
        "report.json",
        "report.html",
        "scalp.json",
        "preview",
    }
    assert {f"{name}.png" for name in NAMES} <= {
        path.name for path in (out / "preview").iterdir()
    }
    assert (out / "report.html").stat().st_size < 6_000_000
    assert load_strands(out).count == 40
    assert "growing" in printed.err
    assert not (tmp_path / "result.partial").exists()
    again = tmp_path / "again"
    assert run("fit", capture, "--out", again, "--seed", 3, "--quiet") == 0
    assert (again / "report.json").read_bytes() == (out / "report.json").read_bytes()
    assert (again / "report.html").read_bytes() == (out / "report.html").read_bytes()


def test_a_fit_says_what_it_will_take_and_keeps_its_limit(
    fake, capture, tmp_path, capsys
):
    out = tmp_path / "result"
    words = "fit", capture, "--out", out, "--quality", "high"
    assert run(*words) == 0
    said = capsys.readouterr().err
    assert "hairfit: 3 photographs at quality high: about " in said
    assert " GB on two cores." in said and "longer than" not in said
    assert "no photograph faces" not in said
    assert run(*words, "--views", f"{NAMES[0]},{NAMES[1]}") == 0
    said = capsys.readouterr().err
    assert "hairfit: no photograph faces the " in said and "both sides" in said
    assert run(*words, "--time-limit", 5) == 0
    said = capsys.readouterr().err
    assert "high would take about " in said and "at quality draft: about " in said
    assert "longer than --time-limit" in said
    settings = json.loads((out / "report.json").read_text())["settings"]
    assert settings["time_limit"] == 5
    assert run(*words, "--time-limit", 0) == 2
    assert "--time-limit must be a number of seconds" in capsys.readouterr().err


def test_a_fit_that_lacks_memory_says_so(fake, capture, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("hairfit.report.fitting.free_gigabytes", lambda: 0.5)
    assert run("fit", capture, "--out", tmp_path / "result") == 0
    assert "only 0.5 GB of memory are free; close" in capsys.readouterr().err


def test_ctrl_c_leaves_no_half_result_and_the_fit_resumes(
    fake, capture, tmp_path, capsys
):
    out = tmp_path / "result"
    fake.stop = KeyboardInterrupt()
    assert run("fit", capture, "--out", out, "--quiet") == 130
    assert capsys.readouterr().err == (
        "hairfit: stopped; the same command goes on from here.\n"
    )
    assert not out.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["result.partial", "tiny"]
    fake.stop = None
    assert run("fit", capture, "--out", out) == 0
    printed = capsys.readouterr()
    assert "hairfit: resuming the fit that '" in printed.err
    assert "open '" in printed.out
    assert fake.resumed and (out / "report.html").exists()
    assert not (tmp_path / "result.partial").exists()


def test_an_earlier_result_stays_until_the_new_one_is_done(fake, capture, tmp_path):
    out = tmp_path / "result"
    assert run("fit", capture, "--out", out, "--quiet") == 0
    before = (out / "report.json").read_bytes()
    fake.stop = RuntimeError("a slip of the program")
    with pytest.raises(RuntimeError, match="a slip of the program"):
        run("fit", capture, "--out", out, "--quiet", "--seed", 1)
    assert (out / "report.json").read_bytes() == before
    fake.stop = None
    assert run("fit", capture, "--out", out, "--quiet", "--seed", 1) == 0
    assert json.loads((out / "report.json").read_text())["settings"]["seed"] == 1


def test_a_doubtful_photograph_is_told_when_the_fit_is_done(
    fake, capture, tmp_path, capsys
):
    fake.doubts = (shaken_doubt("01", Smear(angle=0.3, share=0.25)),)
    assert run("fit", capture, "--out", tmp_path / "result") == 0
    told = "hairfit: photograph '01' is shaken: 25.0 % of the hair seems to run as"
    said = capsys.readouterr().err
    assert told in said and "17 degrees from level" in said
    assert run("fit", capture, "--out", tmp_path / "result", "--quiet") == 0
    assert not capsys.readouterr().err


def test_a_picture_without_a_camera_is_told(fake, capture, tmp_path, capsys):
    (capture / "images/extra.png").write_bytes((capture / "images/00.png").read_bytes())
    assert run("fit", capture, "--out", tmp_path / "result") == 0
    assert "extra.png' has no camera in 'cameras.json'" in capsys.readouterr().err


def test_strands_are_grown_from_a_tree(fake, capture, tmp_path, capsys):
    out = tmp_path / "result"
    assert run("fit", capture, "--out", out, "--quiet") == 0
    for name in ("a.hair", "b.npz"):
        target = tmp_path / name
        words = ("--count", 50, "--points", 9)
        assert run("strands", out / "tree.hairtree", target, *words) == 0
        strands = load_strands(target)
        assert strands.count == 50 and len(strands.points) == 450
    assert "wrote 50 strands to '" in capsys.readouterr().out


def test_info_describes_each_kind(fake, capture, tmp_path, capsys):
    out = tmp_path / "result"
    assert run("fit", capture, "--out", out, "--quiet") == 0
    capsys.readouterr()
    facts = {}
    for path in (capture, out, out / "tree.hairtree", out / "strands.hair"):
        assert run("info", path, "--json") == 0
        fact = json.loads(capsys.readouterr().out)
        facts[fact["kind"]] = fact
    assert facts["capture"]["views"] == list(NAMES)
    assert facts["capture"]["masks"] == {"hair": 3, "body": 3}
    assert facts["result"]["hair"]["strands"] == 40
    assert facts["tree"]["clusters_per_level"] == [1]
    assert np.isclose(facts["strands"]["mean_length_m"], 0.12, atol=1e-5)
    assert run("info", out) == 0
    assert "figures / loss" in capsys.readouterr().out


def test_hair_is_drawn_as_a_photograph_saw_it_and_from_the_side(
    fake, capture, tmp_path
):
    out = tmp_path / "result"
    assert run("fit", capture, "--out", out, "--quiet") == 0
    seen = tmp_path / "new/seen.png"
    assert run("render", out, "--out", seen, "--view", "01.png") == 0
    assert read_photo(seen).shape == (HEIGHT, WIDTH, 3)
    side = tmp_path / "side.png"
    words = ("--azimuth", 90, "--elevation", 20, "--size", 30, 40)
    assert run("render", out / "strands.hair", "--out", side, *words) == 0
    picture = read_photo(side)
    assert picture.shape == (40, 30, 3) and picture.std() > 0.01


def test_what_cannot_be_drawn_is_refused(capture, tmp_path, capsys):
    save_strands(tmp_path / "mine.hair", hair())
    out = ("--out", tmp_path / "a.png")
    assert run("render", tmp_path / "mine.hair", *out, "--view", "00") == 2
    assert "--view 00 needs the capture" in capsys.readouterr().err
    words = ("--capture", capture, "--view", "9x")
    assert run("render", tmp_path / "mine.hair", *out, *words) == 2
    assert "no view '9x'; the capture has 00, 01, 02." in capsys.readouterr().err
    assert run("render", tmp_path / "mine.hair", "--out", tmp_path / "a.jpg") == 2
    assert "a.jpg' must end with .png; rename it." in capsys.readouterr().err


@pytest.mark.parametrize("command", ["info", "evaluate", "render", "strands"])
def test_a_path_where_nothing_is_is_refused(command, tmp_path, capsys):
    rest = {
        "info": (),
        "evaluate": (tmp_path,),
        "render": ("--out", tmp_path / "a.png"),
        "strands": (tmp_path / "a.hair",),
    }
    gone = "gone.hairtree" if command == "strands" else "gone.hair"
    assert run(command, tmp_path / gone, *rest[command]) == 2
    line = capsys.readouterr().err
    assert "there is no '" in line and line.count("\n") == 1


def test_the_truth_against_itself_is_perfect(capture, tmp_path, capsys):
    save_strands(capture / "truth.npz", hair())
    save_strands(tmp_path / "mine.hair", hair())
    assert run("evaluate", tmp_path / "mine.hair", capture, "--json", "--quiet") == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["all"]["2mm_20deg"]["signed"]["f"] == 1.0
    assert figures["visible"] is not None and set(figures["photographs"]) == set(NAMES)
    assert run("evaluate", tmp_path / "mine.hair", tmp_path / "mine.hair") == 0
    printed = capsys.readouterr()
    assert "no capture is known" in printed.err and "--capture" in printed.err
    assert "100.0 %" in printed.out.splitlines()[1]


def test_a_capture_without_truth_is_refused(capture, tmp_path, capsys):
    save_strands(tmp_path / "mine.hair", hair())
    assert run("evaluate", tmp_path / "mine.hair", capture) == 2
    assert "no 'truth.npz' in '" in capsys.readouterr().err


def test_an_unknown_style_is_refused(tmp_path, capsys):
    assert run("synth", "mohawk", "--out", tmp_path / "new") == 2
    line = capsys.readouterr().err
    assert "no style 'mohawk'; choose one of straight, " in line
    assert not (tmp_path / "new").exists()


def test_synth_does_not_overwrite(capture, capsys):
    assert run("synth", "straight", "--out", capture) == 2
    assert (
        "is not empty; name a folder that does not exist yet" in capsys.readouterr().err
    )


def test_help_names_every_command(capsys):
    with pytest.raises(SystemExit) as stop:
        run("--help")
    assert stop.value.code == 0
    printed = capsys.readouterr().out
    for command in ("fit", "synth", "evaluate", "render", "strands", "info"):
        assert command in printed


def test_commands_are_frozen():
    from hairfit import cli

    for command in (cli.Fit, cli.Synth, cli.Evaluate, cli.Render, cli.Info):
        assert dataclasses.fields(command) and command.__doc__


def test_gallery_lists_its_hairstyles(capsys):
    assert main(["gallery"]) == 0
    names = capsys.readouterr().out.split()
    assert {"bob", "braid", "afro"} <= set(names) and len(names) >= 12


def test_gallery_refuses_what_it_has_not(tmp_path, capsys):
    assert main(["gallery", "mullet", "--out", str(tmp_path / "a.hairtree")]) == 2
    assert "the gallery has no style 'mullet'" in capsys.readouterr().err
    assert main(["gallery", "bob", "--out", str(tmp_path / "a.obj")]) == 2
    assert "must end with .hairtree" in capsys.readouterr().err


@pytest.mark.slow
def test_gallery_puts_a_hairstyle_onto_another_head(tmp_path, capsys):
    small = make_head()
    mesh = tmp_path / "head.obj"
    save_mesh(mesh, Mesh(0.9 * small.vertices + [0.0, 0.5, 0.0], small.faces))
    out = tmp_path / "buzz.hairtree"
    assert main(["gallery", "buzz-cut", "--out", str(out), "--head", str(mesh)]) == 0
    roots = np.asarray(load_tree(out).cylinder.skeleton)[:, 0]
    away = head_distance((roots - [0.0, 0.5, 0.0]) / 0.9)
    assert np.abs(away).max() < 0.002


def straight_strands(count=60):
    """Strands of 10 cm that stand on a ball of 10 cm and lean to one side."""
    rng = np.random.default_rng(0)
    out = rng.normal(size=(count, 3)) * [0.4, 0.0, 0.4] + [0.0, 1.0, 0.0]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    along = np.linspace(0.0, 0.1, 12)[None, :, None]
    return 0.1 * out[:, None] + along * out[:, None] + along**2 * [2.0, 0.0, 0.0]


@pytest.mark.slow
def test_treeify_makes_a_tree_of_strands(tmp_path, capsys):
    strands = 100.0 * straight_strands()
    save_strands(tmp_path / "a.hair", Strands.from_array(strands))
    out = tmp_path / "a.hairtree"
    command = ["treeify", str(tmp_path / "a.hair"), "--out", str(out), "--scale"]
    numbers = ["--clusters", "4", "--wisps", "0", "--quiet", "--json"]
    assert main([*command, "0.01", *numbers]) == 0
    figures = json.loads(capsys.readouterr().out)
    tree = load_tree(out)
    assert tree.count == figures["clusters"] >= 4
    assert figures["error_m"] < 0.02  # four linear maps of a fan
    # Means of roots on the ball lie a little below it.
    roots = np.linalg.norm(np.asarray(tree.cylinder.skeleton)[:, 0], axis=1)
    assert (roots > 0.09).all() and (roots < 0.101).all()
    # Without the scale it is no hair: metres are said.
    assert main([*command, "1", *numbers]) == 2
    assert "metres" in capsys.readouterr().err


@pytest.mark.slow
def test_treeify_fills_a_hole_between_roots(tmp_path):
    hair = straight_strands(600)
    crown = np.linalg.norm(hair[:, 0] - [0.0, 0.1, 0.0], axis=1) < 0.025
    save_strands(tmp_path / "a.hair", Strands.from_array(hair[~crown]))
    density = []
    for name, fill in (("plain", "0"), ("filled", "0.03")):
        out = tmp_path / f"{name}.hairtree"
        command = ["treeify", str(tmp_path / "a.hair"), "--out", str(out), "--quiet"]
        assert main([*command, "--wisps", "0", "--fill", fill]) == 0
        maps = load_tree(out).maps
        assert maps is not None
        middle = len(maps.density) // 2
        density.append(float(maps.density[middle, middle]))
    assert density[0] < 0.02 and density[1] > 0.05


def test_treeify_refuses_what_is_no_number(tmp_path, capsys):
    save_strands(tmp_path / "a.hair", Strands.from_array(straight_strands()))
    command = ["treeify", str(tmp_path / "a.hair"), "--out"]
    numbers = {"--clusters": "0", "--wisps": "-1", "--scale": "0", "--fill": "-1"}
    for option, word in numbers.items():
        assert main([*command, str(tmp_path / "a.hairtree"), option, word]) == 2
        assert option in capsys.readouterr().err
    assert main([*command, str(tmp_path / "a.obj")]) == 2
    assert "must end with .hairtree" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["gallery"], ["fit", "--help"]])
def test_who_stops_reading_is_not_complained_to(command):
    words = f"import sys; from hairfit.cli import main; sys.exit(main({command}))"
    done = subprocess.Popen(
        [sys.executable, "-c", words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert done.stdout is not None and done.stderr is not None
    done.stdout.close()
    with done.stderr as complaints:
        assert complaints.read() == ""
    assert done.wait() == 141


def test_options_of_the_compiler_are_known_to_it(tmp_path):
    words = "from hairfit.cli import main; main(['gallery']); import os, jax; "
    words += "print(os.environ.get('XLA_FLAGS'), jax.numpy.ones(3).sum())"
    plain = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
    done = subprocess.run(
        [sys.executable, "-c", words],
        env={**plain, "JAX_COMPILATION_CACHE_DIR": str(tmp_path)},
        capture_output=True,
        text=True,
        check=True,
    )
    flags = sooner(version("jaxlib"))
    assert done.stdout.splitlines()[-1] == f"{flags} 3.0"
    assert sooner("0.9.2") is None
