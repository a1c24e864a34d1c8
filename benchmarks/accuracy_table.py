"""Figures of runs as mean and spread over seeds, and as a Markdown table."""

import dataclasses
import statistics
from collections.abc import Callable, Sequence
from typing import NamedTuple

Figures = dict[str, float]
THRESHOLDS = ("2mm_20deg", "3mm_30deg", "4mm_40deg")


class Spread(NamedTuple):
    """Mean and standard deviation over seeds; the latter is 0 for one seed."""

    mean: float
    deviation: float


Group = dict[str, Spread]


@dataclasses.dataclass(frozen=True)
class Column:
    """A column of the table.

    Attributes:
        title: Its heading.
        keys: The figures in it.
        factor: What they are multiplied by.
        digits: Digits after the point.
        unit: What follows each figure.
    """

    title: str
    keys: tuple[str, ...]
    factor: float = 1.0
    digits: int = 1
    unit: str = ""

    def cell(self, group: Group) -> str:
        """Return the figures of a group as text."""
        return ", ".join(self.text(group.get(key)) for key in self.keys)

    def text(self, spread: Spread | None) -> str:
        """Return one figure as text, with its deviation unless that is 0."""
        if spread is None:
            return "–"
        mean, deviation = (f"{self.factor * x:.{self.digits}f}" for x in spread)
        return f"{mean}{self.unit}" + (
            "" if spread.deviation == 0.0 else f" ± {deviation}"
        )


def scores(part: str, kind: str = "unsigned") -> tuple[str, ...]:
    """Return the keys of F at all thresholds."""
    return tuple(f"{part}.{threshold}.{kind}.f" for threshold in THRESHOLDS)


COLUMNS = (
    Column("F at 2 mm/20°, 3 mm/30°, 4 mm/40°", scores("all"), 100.0),
    Column("signed", scores("all", "signed"), 100.0),
    Column("visible", scores("visible"), 100.0),
    Column("interior", scores("interior"), 100.0),
    Column("consistency at 3 mm", ("consistency.3mm_30deg",), 100.0),
    Column("median length", ("shape.median_length_relative",), 100.0, 1, " %"),
    Column("true strands that curl", ("curls.true_share",), 100.0, 0, " %"),
    Column("recovered ones, less these", ("curls.share_error",), 100.0, 0, " %"),
    Column(
        "radius, pitch of curls",
        ("curls.median_radius_relative", "curls.median_pitch_relative"),
        100.0,
        0,
        " %",
    ),
    Column("points deeper than 1 mm", ("head.points_deeper_than_1mm",), 1.0, 0),
    Column("fitted: angle", ("fitted.median_angle_deg",), 1.0, 1, "°"),
    Column("fitted: IoU, covered", ("fitted.hair_iou", "fitted.covered_iou"), 100.0),
    Column("held back: angle", ("held_back.median_angle_deg",), 1.0, 1, "°"),
    Column(
        "held back: IoU, covered",
        ("held_back.hair_iou", "held_back.covered_iou"),
        100.0,
    ),
    Column("seconds", ("seconds",), 1.0, 0),
    Column("memory, GB", ("memory_gb",)),
)


def spread(values: Sequence[float]) -> Spread:
    """Return mean and standard deviation of the same figure of several seeds."""
    deviation = statistics.stdev(values) if len(values) > 1 else 0.0
    return Spread(statistics.fmean(values), deviation)


def gather(runs: Sequence[Figures]) -> Group:
    """Return mean and deviation of every figure over runs that know it."""
    keys = dict.fromkeys(key for run in runs for key in run)
    return {key: spread([run[key] for run in runs if key in run]) for key in keys}


def mean_group(groups: Sequence[Group]) -> Group:
    """Return the mean of the means of captures; how these differ is no error."""
    means = gather([{key: one.mean for key, one in group.items()} for group in groups])
    return {key: Spread(one.mean, 0.0) for key, one in means.items()}


def markdown(groups: dict[str, Group], kind: Callable[[str], str]) -> str:
    """Return the table: a row a group, then the mean of each kind of groups.

    Args:
        groups: The figures of all groups by name.
        kind: Which groups are averaged together, from a group's name.
    """
    rows = [("", *(column.title for column in COLUMNS))]
    rows += [row(name, group) for name, group in groups.items()]
    for one in dict.fromkeys(map(kind, groups)):
        members = [group for name, group in groups.items() if kind(name) == one]
        if len(members) > 1:
            rows.append(row(f"mean of {len(members)}, {one}", mean_group(members)))
    lines = ["| " + " | ".join(cells) + " |" for cells in rows]
    lines.insert(1, "|---" * len(rows[0]) + "|")
    return "\n".join(lines) + "\n"


def row(name: str, group: Group) -> tuple[str, ...]:
    """Return the cells of a group."""
    return (name, *(column.cell(group) for column in COLUMNS))
