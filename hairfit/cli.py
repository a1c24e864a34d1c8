"""The command line: one frozen dataclass a command, whose docstrings are the help."""

import dataclasses
import json as json_format
import os
import sys
import time
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from tyro.conf import OmitArgPrefixes, Positional, arg, subcommand

from .errors import InputError
from .report.render_options import (
    BackgroundOptions,
    CameraOptions,
    HairOptions,
    LightOptions,
    RenderOptions,
)


@dataclasses.dataclass(frozen=True)
class Fit:
    """Recover a hair tree from photographs.

    CAPTURE is a folder with `images/`, `masks/hair/`, `cameras.json` and `head.obj`.
    RESULT becomes a folder with `tree.hairtree`, `strands.hair`, `report.json`,
    `report.html` and `preview/`. A fit that was stopped goes on where it was when the
    same command is given again.
    """

    capture: Annotated[Positional[Path], arg(metavar="CAPTURE")]
    """The photographs."""
    out: Annotated[Path, arg(metavar="RESULT")]
    """The folder to write. An earlier result there is replaced when the fit is done."""
    views: Annotated[str | None, arg(metavar="NAMES|COUNT")] = None
    """Names (00,02,04), or how many (8), spread evenly over directions; else all."""
    quality: Literal["draft", "normal", "high"] = "normal"
    """How much time to take."""
    time_limit: float | None = None
    """Seconds in which to be done: by a coarser quality and less refinement."""
    seed: int = 0
    """The same seed gives the same result."""
    strands: int = 16_000
    """How many strands to write."""
    quiet: bool = False
    """Show no progress."""
    json: bool = False
    """Print what `report.json` says as one line."""

    def run(self) -> None:
        """Fit, and write the result."""
        from .capture import load_capture, require_for_fit
        from .report.progress import say
        from .report.result import check_out

        start = time.monotonic()
        at_least_one(self.strands, "--strands")
        if self.time_limit is not None and not self.time_limit > 0.0:
            raise InputError(
                f"--time-limit must be a number of seconds, not {self.time_limit:g}."
            )
        check_out(self.out, self.capture)
        capture = load_capture(self.capture, self.views)
        require_for_fit(capture)
        for note in capture.notes:
            say(note, quiet=self.quiet)

        from .fit import FitConfig
        from .report.fitting import before_fit, fit_to_folder

        config = FitConfig(self.quality, self.seed, self.strands, self.time_limit)
        for sentence in before_fit(capture, config):
            say(sentence, quiet=self.quiet)
        report = fit_to_folder(capture, config, self.out, quiet=self.quiet)
        for doubt in report["suspects"]:
            say(doubt["sentence"], quiet=self.quiet)
        seconds = round(time.monotonic() - start, 1)
        if self.json:
            print_json({"result": str(self.out), "seconds": seconds, **report})
            return
        print(f"{report['clusters']} clusters, {report['strands']} strands")
        print(f"wrote '{self.out}' in {seconds:.0f} s")
        print(f"open '{self.out / 'report.html'}' to look at it")


@dataclasses.dataclass(frozen=True)
class Synth:
    """Make a known hairstyle and photograph it: a capture with its truth."""

    style: Annotated[Positional[str], arg(metavar="STYLE")]
    """straight, wavy, curly or ponytail."""
    out: Annotated[Path, arg(metavar="CAPTURE")]
    """The folder to write; it must be new or empty."""
    views: int = 8
    """How many photographs: up to 8 on a ring around the head, the others above it."""
    size: tuple[int, int] = (480, 640)
    """Width and height of the photographs, in pixels."""
    strands: int = 6000
    """How many strands are photographed."""
    seed: int = 0
    """The same seed gives the same hairstyle."""
    quiet: bool = False
    """Show no progress."""

    def run(self) -> None:
        """Make and write the capture."""
        from .report.progress import shown_progress
        from .synthetic import (
            STYLES,
            Scene,
            make_head,
            make_scalp,
            make_style,
            write_capture,
        )

        if self.style not in STYLES:
            raise InputError(
                f"no style '{self.style}'; choose one of {', '.join(STYLES)}."
            )
        at_least_one(self.views, "--views")
        at_least_one(self.strands, "--strands")
        at_least_one(min(self.size), "--size")
        scene = Scene(
            views=self.views, size=self.size, strands=self.strands, seed=self.seed
        )
        head = make_head()
        with shown_progress(quiet=self.quiet) as progress:
            progress("growing the hair", 0.0)
            tree = make_style(self.style, self.seed, make_scalp(head))
            write_capture(tree, head, self.out, scene, progress=progress)
        print(f"wrote '{self.out}'")
        print(f"try `hairfit fit {self.out} --out {self.out.name}-result`")


@dataclasses.dataclass(frozen=True)
class Evaluate:
    """Compare recovered strands with the true ones.

    Precision, recall and F at 2 mm/20 degrees, 3 mm/30 and 4 mm/40, and more. Where the
    capture is known, hair that its cameras see is also counted apart from the interior,
    and the strands are compared with each photograph.
    """

    recovered: Annotated[Positional[Path], arg(metavar="RESULT_OR_STRANDS")]
    """A result of `hairfit fit`, or strands (.hair or .npz)."""
    truth: Annotated[Positional[Path], arg(metavar="TRUTH")]
    """A capture with a `truth.npz`, or strands (.hair or .npz)."""
    capture: Annotated[Path | None, arg(metavar="CAPTURE")] = None
    """The capture, if neither the result nor the truth tells."""
    quiet: bool = False
    """Show no progress."""
    json: bool = False
    """Print all figures as one line of JSON."""

    def run(self) -> None:
        """Evaluate, and print the figures."""
        from .report.compare import compare

        found = compare(self.recovered, self.truth, self.capture, quiet=self.quiet)
        if self.json:
            print_json(found.to_dict())
        else:
            print_table(found.table())


@dataclasses.dataclass(frozen=True)
class Render:
    """Draw a hairstyle: as photographs saw it, from any direction, or all around.

    OUT is a PNG. Several pictures (`--view all`, `--turntable`) go into a new folder,
    those of a turntable also into a .gif or, if there is ffmpeg, an .mp4.
    """

    hair: Annotated[Positional[Path], arg(metavar="RESULT_TREE_OR_STRANDS")]
    """A result of `hairfit fit`, a tree (.hairtree), or strands (.hair or .npz)."""
    out: Annotated[Path, arg(metavar="OUT")]
    """What to write."""
    capture: Annotated[Path | None, arg(metavar="CAPTURE")] = None
    """The capture whose head is drawn; a result knows its own."""
    head: Annotated[Path | None, arg(metavar="MESH")] = None
    """A head to draw, if no capture tells, or another one."""
    camera: OmitArgPrefixes[CameraOptions] = CameraOptions()
    style: OmitArgPrefixes[HairOptions] = HairOptions()
    lights: OmitArgPrefixes[LightOptions] = LightOptions()
    behind: OmitArgPrefixes[BackgroundOptions] = BackgroundOptions()
    lines: bool = False
    """Draw it with pen and ink."""
    quality: Literal["draft", "normal", "high"] = "normal"
    """How fine shadows and borders are."""
    engine: Literal["auto", "gl", "jax"] = "auto"
    """OpenGL, or JAX where there is none."""
    quiet: bool = False
    """Show no progress."""
    json: bool = False
    """Print what was written as one line of JSON."""

    def run(self) -> None:
        """Draw, and write the pictures."""
        from .report.render_command import render

        start = time.monotonic()
        options = RenderOptions(
            self.camera,
            self.style,
            self.lights,
            self.behind,
            lines=self.lines,
            quality=self.quality,
            engine=self.engine,
            quiet=self.quiet,
        )
        facts = render(
            self.hair, self.out, options, capture=self.capture, head=self.head
        )
        if self.json:
            print_json({**facts, "seconds": round(time.monotonic() - start, 1)})
        else:
            print(f"wrote '{self.out}'")


@dataclasses.dataclass(frozen=True)
class GrowStrands:
    """Write strands of a tree."""

    tree: Annotated[Positional[Path], arg(metavar="TREE")]
    """A tree (.hairtree), or a result of `hairfit fit`."""
    out: Annotated[Positional[Path], arg(metavar="OUT")]
    """The strands to write: .hair or .npz."""
    count: int = 10_000
    """How many strands."""
    points: int = 32
    """How many points each strand has."""
    head: Annotated[Path | None, arg(metavar="MESH")] = None
    """A head: strands that would run under its skin are laid onto it."""
    seed: int = 0
    """The same seed gives the same strands."""

    def run(self) -> None:
        """Grow the strands, and write them."""
        from .report.hairstyles import read_tree

        at_least_one(self.count, "--count")
        if self.points < 2:
            raise InputError(f"--points must be at least 2, not {self.points}.")
        if self.out.suffix not in (".hair", ".npz"):
            raise InputError(f"'{self.out}' must end with .hair or .npz; rename it.")
        from .fit import derive_strands
        from .io.mesh import load_mesh
        from .io.strands import save_strands

        head = None if self.head is None else load_mesh(self.head)
        tree = read_tree(self.tree)
        strands = derive_strands(tree, head, self.count, self.points, self.seed)
        save_strands(self.out, strands)
        print(f"wrote {strands.count} strands to '{self.out}'")


@dataclasses.dataclass(frozen=True)
class Treeify:
    """Make a hair tree of strands from elsewhere.

    Strands are gathered into clusters of several levels, and generalized cylinders are
    fitted to them: the hair can then be edited like any tree of hairfit's.
    """

    strands: Annotated[Positional[Path], arg(metavar="STRANDS")]
    """The strands, root first, y up and the face to +z: .hair or .npz."""
    out: Annotated[Path, arg(metavar="TREE")]
    """The tree to write: .hairtree."""
    head: Annotated[Path | None, arg(metavar="MESH")] = None
    """The head that they grow on; without it the scalp follows their roots alone."""
    clusters: int | None = None
    """How many leaf clusters: more are closer to the strands, fewer easier to edit; by
    default 500, or one for every five strands."""
    levels: int = 2
    """How many levels of clusters."""
    wisps: int = 1000
    """How many wisps, which keep what clusters cannot say; 0 for none."""
    scale: float = 1.0
    """What coordinates of the strands are multiplied by: 0.01 if they are in cm."""
    fill: float = 0.0
    """Fill gaps between roots up to this radius with hair, in metres; 0 for none."""
    seed: int = 0
    """The same seed gives the same tree."""
    quiet: bool = False
    """Show no progress."""
    json: bool = False
    """Print the figures as one line of JSON."""

    def run(self) -> None:
        """Make the tree, and write it."""
        if self.clusters is not None:
            at_least_one(self.clusters, "--clusters")
        at_least_one(self.levels, "--levels")
        if self.wisps < 0:
            raise InputError(f"--wisps must be at least 0, not {self.wisps}.")
        from .fit.treeify import TreeifyConfig
        from .report.bottom_up import treeify_file
        from .report.progress import shown_progress

        config = TreeifyConfig(
            leaves=self.clusters, levels=self.levels, wisps=self.wisps, seed=self.seed
        )
        with shown_progress(quiet=self.quiet) as progress:
            figures = treeify_file(
                self.strands,
                self.out,
                config,
                head=self.head,
                scale=self.scale,
                fill=self.fill,
                progress=progress,
            )
        if self.json:
            print_json({"tree": str(self.out), **figures})
            return
        print(f"{figures['clusters']} clusters, {figures['wisps']} wisps")
        print(f"wrote '{self.out}'")


@dataclasses.dataclass(frozen=True)
class Gallery:
    """Write a named hairstyle as a tree, or list their names.

    The styles are built by the operations of `hairfit.model` on the head of
    `hairfit synth`; `--head` takes one over to another head.
    """

    name: Annotated[Positional[str | None], arg(metavar="NAME")] = None
    """The hairstyle; without it all names are printed."""
    out: Annotated[Path | None, arg(metavar="TREE")] = None
    """The tree to write: .hairtree."""
    head: Annotated[Path | None, arg(metavar="MESH")] = None
    """The head that the hair shall grow on, in metres, y up and the face to +z."""
    seed: int = 0
    """The same seed gives the same hairstyle."""

    def run(self) -> None:
        """Print the names, or write one tree."""
        from .synthetic.gallery import GALLERY, make_gallery_tree

        if self.name is None:
            print("\n".join(GALLERY))
            return
        out = self.out or Path(f"{self.name}.hairtree")
        if out.suffix != ".hairtree":
            raise InputError(f"--out '{out}' must end with .hairtree; rename it.")
        from .io.mesh import load_mesh
        from .io.tree import save_tree
        from .synthetic.wear import wear

        head = None if self.head is None else load_mesh(self.head)
        tree = make_gallery_tree(self.name, self.seed)
        save_tree(out, tree if head is None else wear(tree, head))
        print(f"wrote '{out}'")
        print(f"try `hairfit render {out} --out {self.name}.png`")


@dataclasses.dataclass(frozen=True)
class Info:
    """Say what a capture, a result, a tree or a file of strands holds."""

    path: Annotated[Positional[Path], arg(metavar="PATH")]
    """The folder or file."""
    json: bool = False
    """Print it as one line of JSON."""

    def run(self) -> None:
        """Describe it."""
        from .report.describe import describe
        from .report.html import flat

        facts = describe(self.path)
        if self.json:
            print_json(facts)
        else:
            print_table(list(flat(facts).items()))


Command = (
    Annotated[Fit, subcommand("fit")]
    | Annotated[Synth, subcommand("synth")]
    | Annotated[Evaluate, subcommand("evaluate")]
    | Annotated[Render, subcommand("render")]
    | Annotated[GrowStrands, subcommand("strands")]
    | Annotated[Treeify, subcommand("treeify")]
    | Annotated[Gallery, subcommand("gallery")]
    | Annotated[Info, subcommand("info")]
)


# Options of XLA by the version of jaxlib: one that did not know an option would stop.
# Its older way to emit a program takes two thirds of the time of its newer one, and
# what comes out runs as fast. On a GPU it tries ways to multiply matrices; ours are
# small.
UNTUNED = "--xla_gpu_autotune_level=0"
SOONER = {"0.10.": "--xla_cpu_use_fusion_emitters=false " + UNTUNED, "0.11.": UNTUNED}


def sooner(jaxlib: str) -> str | None:
    """Return the options of a version of jaxlib with which it compiles sooner."""
    return next((o for known, o in SOONER.items() if jaxlib.startswith(known)), None)


def cache_folder() -> Path:
    """Return where compiled programs are kept between runs."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "hairfit" / "jax"


def main(args: Sequence[str] | None = None) -> int:
    """Run one command, and return its exit status.

    Args:
        args: The words after `hairfit`; those of the process if None.
    """
    try:
        try:
            return obey(args)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # Who reads what is printed, such as `head`, has read enough. What is left goes
        # nowhere, or Python would complain once more when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141


def run() -> None:
    """Obey the words of the process, and end it.

    Python would take apart what the system takes back at once: 2 s after a fit.
    """
    status = main()
    sys.stderr.flush()
    os._exit(status)


def obey(args: Sequence[str] | None) -> int:
    """Run one command, and return its exit status; help raises `SystemExit`."""
    # What is compiled once stays compiled, small programs as well: there are many.
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache_folder()))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    if options := sooner(version("jaxlib")):
        os.environ.setdefault("XLA_FLAGS", options)
    command: Any = tyro.cli(
        Command,
        prog="hairfit",
        description="From a few photographs to hair that can be edited.",
        args=args,
        config=(tyro.conf.FlagCreatePairsOff, tyro.conf.UseAppendAction),
    )
    try:
        command.run()
    except InputError as error:
        print("hairfit: " + " ".join(str(error).split()), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        goes_on = isinstance(command, Fit)
        words = "; the same command goes on from here" if goes_on else ""
        print(f"hairfit: stopped{words}.", file=sys.stderr)
        return 130
    return 0


def at_least_one(number: int, option: str) -> None:
    """Refuse an option that counts something and is less than one."""
    if number < 1:
        raise InputError(f"{option} must be at least 1, not {number}.")


def print_json(content: dict[str, Any]) -> None:
    """Print one line that machines read."""
    from .report.result import plain

    print(json_format.dumps(plain(content), ensure_ascii=False))


def print_table(rows: Sequence[Sequence[str]]) -> None:
    """Print rows in columns: the first to the left, the others to the right."""
    # A row of a name and one value does not widen the columns of numbers.
    wide = [row for row in rows if len(row) > 2]
    first = max((len(row[0]) for row in rows), default=0)
    others = max((len(cell) for row in wide for cell in row[1:]), default=0)
    for name, *cells in rows:
        line = f"{name:{first}}" + "".join(f"  {cell:>{others}}" for cell in cells)
        print(line.rstrip())
