"""Recovered against true hair, with the capture where it can be found."""

from pathlib import Path

from ..capture import load_capture
from ..errors import InputError
from ..evaluate import Evaluation, evaluate
from ..io.strands import load_strands
from .hairstyles import must_exist, read_strands
from .progress import say
from .result import captured_from, is_result, read_report


def compare(
    recovered: Path, truth: Path, capture: Path | None = None, *, quiet: bool = False
) -> Evaluation:
    """Return how recovered hair compares with the true hair.

    Of a capture, the photographs that a result was made from are used, else all.

    Args:
        recovered: A result, a tree or strands.
        truth: A capture with `truth.npz`, or strands.
        capture: The capture; where None, the one beside the truth or of the result.
        quiet: Say nothing about what is left out.

    Raises:
        InputError: If something cannot be read.
    """
    strands = read_strands(recovered)
    must_exist(truth)
    if truth.is_dir() and not is_result(truth):
        if not (truth / "truth.npz").is_file():
            raise InputError(
                f"no 'truth.npz' in '{truth}'; give a capture that has one, or strands."
            )
        truth = truth / "truth.npz"
    true_strands = load_strands(truth)
    folder = capture or find_capture(recovered, truth)
    if folder is None:
        say(
            "no capture is known, so that nothing is said about photographs; name it "
            "with --capture.",
            quiet=quiet,
        )
        return evaluate(strands, true_strands, head=None, views=None)
    chosen = read_report(recovered)["views"] if is_result(recovered) else None
    loaded = load_capture(folder, chosen)
    return evaluate(strands, true_strands, head=loaded.head, views=loaded.views)


def find_capture(recovered: Path, truth: Path) -> Path | None:
    """Return the capture that the truth lies in, or that the result was made from."""
    if (truth.parent / "cameras.json").is_file():
        return truth.parent
    return captured_from(recovered) if is_result(recovered) else None
