"""How a long step shows where it is, and how long it will take."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Progress = Callable[[str, float], None]


class TimeLeft:
    """Estimates the time left from the share done since the first report.

    A fit that resumes starts with a share above zero; it was not done just now.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.clock = clock
        self.first: tuple[float, float] | None = None

    def __call__(self, share: float) -> float | None:
        """Return the seconds left after `share` of the work, None if unknown yet."""
        now = self.clock()
        if self.first is None:
            self.first = (now, share)
        start, done = self.first
        if share - done < 0.005:
            return None
        return (now - start) * max(0.0, 1.0 - share) / (share - done)


def spoken(seconds: float | None) -> str:
    """Return a time left as a person says it."""
    return f"{about(seconds)} left" if seconds else ""


def about(seconds: float) -> str:
    """Return a time as a person says it."""
    if seconds < 90:
        return f"about {max(1, round(seconds))} s"
    return f"about {round(seconds / 60)} min"


@contextmanager
def shown_progress(*, quiet: bool) -> Iterator[Progress]:
    """Give a function that takes a stage's name and the share of all work done.

    On a terminal it moves a bar on standard error; else it writes a line per stage.
    """
    if quiet:
        yield lambda stage, share: None
    elif sys.stderr.isatty():
        with progress_bar() as report:
            yield report
    else:
        yield progress_lines()


def progress_lines() -> Progress:
    """Return a progress function that writes a line whenever the stage changes."""
    left, last = TimeLeft(), [""]

    def report(stage: str, share: float) -> None:
        seconds = left(share)
        if stage != last[0]:
            last[0] = stage
            line = f"{100 * share:3.0f} %  {stage}  {spoken(seconds)}"
            print(line.rstrip(), file=sys.stderr, flush=True)

    return report


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """Give a progress function that moves a bar on the terminal."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        SpinnerColumn,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
    )

    left = TimeLeft()
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[left]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("starting", total=1.0, left="")

        def report(stage: str, share: float) -> None:
            words = spoken(left(share))
            bar.update(task, description=stage, completed=share, left=words)

        yield report


def say(sentence: str, *, quiet: bool = False) -> None:
    """Print a sentence for the user on standard error, beside the output proper."""
    if not quiet:
        print(f"hairfit: {sentence}", file=sys.stderr, flush=True)
