"""What a campaign of faults found, as a table, and whether the deployed stack's memory stayed flat."""

from collections.abc import Iterable, Sequence
from statistics import median
from typing import NamedTuple

from eval.analysis.report.tables import Column, Share, Table, Value
from eval.bridge.faults.campaign import Trial
from vuca_nav.deploy.safety.faults import FAULTS

NOTE = (
    "Faults on the wire while the robot drives, vuca deploy and the simulator as two processes in real time. Zero: "
    "from the fault to the zero command, or to the time-out of the base, within 0.2 s. Rest: from the fault until the "
    "body rests, within 0.2 s and its speed over its greatest deceleration. Again: from the end of the fault to the "
    "next command that moves, where the robot should go on by itself. Counts in time with Wilson's 95% intervals."
)
COLUMNS = (
    Column("fault"),
    Column("trials"),
    Column("stopped by"),
    Column("zero, median [s]", 3),
    Column("zero, most [s]", 3),
    Column("zero in time"),
    Column("rest, median [s]", 3),
    Column("rest, most [s]", 3),
    Column("beyond its bound, most [s]", 3, signed=True),
    Column("rest in time"),
    Column("again, median [s]", 2),
    Column("went on"),
    Column("crashes"),
)
ALL = "all that must stop"
"""Name of the last line."""
_GROWTH, _GROWTH_BYTES = 0.05, 20 << 20
"""Growth of the memory from which on it is not flat: a share, and a size [bytes], both of them."""
_WARM = 0.25
"""Share of a run after which memory is looked at: maps, caches and queues have their sizes."""


def table_of(trials: Sequence[Trial], crashes: Sequence[str]) -> Table:
    """The table.

    Args:
        trials: What became of each fault.
        crashes: Faults in which the deployed stack ended by itself.
    """
    names = [name for name in FAULTS if any(trial.fault == name for trial in trials) or name in crashes]
    rows = [_line(name, [t for t in trials if t.fault == name], crashes.count(name)) for name in names]
    if len(rows) > 1:
        rows.append(_line(ALL, [t for t in trials if FAULTS[t.fault].stopped_by != "nobody"], len(crashes)))
    return Table("faults", "Faults on the wire", NOTE, COLUMNS, rows)


def _line(name: str, trials: Sequence[Trial], crashes: int) -> list[Value]:
    zero, rest = _known(t.zero for t in trials), _known(t.rest for t in trials)
    beyond = _known(None if t.rest is None else t.rest - t.rest_within for t in trials)
    again = _known(t.resumed for t in trials)
    fault = FAULTS.get(name)
    stops = fault is None or fault.stopped_by != "nobody"
    return [
        name,
        len(trials),
        None if fault is None else fault.stopped_by,
        *((_median(zero), max(zero, default=None)) if stops else (None, None)),
        Share(sum(t.stopped_in_time for t in trials), len(trials)),
        *((_median(rest), max(rest, default=None), max(beyond, default=None)) if stops else (None, None, None)),
        Share(sum(t.rested_in_time for t in trials), len(trials)),
        _median(again) if fault is None or fault.resumes else None,
        sum(t.went_on for t in trials),
        crashes,
    ]


class Memory(NamedTuple):
    """The deployed stack's memory over a run."""

    early: float
    """Median after the first quarter, over the second [bytes]."""
    late: float
    """Median over the last quarter [bytes]."""

    @property
    def is_flat(self) -> bool:
        """Whether it did not grow."""
        growth = self.late - self.early
        return growth <= _GROWTH * self.early or growth <= _GROWTH_BYTES


def memory_of(samples: Sequence[tuple[float, int]]) -> Memory | None:
    """The memory's course from samples of time [s] and size [bytes]; None for fewer than eight."""
    if len(samples) < 8:
        return None
    sizes = [size for _, size in samples]
    quarter = round(_WARM * len(sizes))
    return Memory(median(sizes[quarter : 2 * quarter]), median(sizes[-quarter:]))


def memory_in_words(samples: Sequence[tuple[float, int]]) -> str:
    """The verdict on the memory, from samples as ``memory_of`` takes them."""
    memory = memory_of(samples)
    if memory is None:
        return "Memory of vuca deploy: too few samples to tell."
    verdict = "flat" if memory.is_flat else "not flat"
    figures = f"{memory.early / 2**20:.1f} MB in the second quarter, {memory.late / 2**20:.1f} MB in the last"
    return f"Memory of vuca deploy over {samples[-1][0] - samples[0][0]:.0f} s: {verdict} ({figures})."


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _median(values: Sequence[float]) -> float | None:
    return median(values) if values else None
