import csv
import io

from eval.analysis.report.tables import Column, Share, Table, as_csv, markdown
from eval.analysis.statistics import Estimate

TABLE = Table(
    "t",
    "A table",
    "What it is.",
    (Column("world"), Column("success"), Column("time", 1), Column("gain", 0, True)),
    [
        ["factory | 4", Share(8, 10), Estimate(1.25, -0.01, 2.5), Estimate(4.6, -0.2, 9.0)],
        ["square", Share(0, 0), None, None],
    ],
)


def test_as_it_is_read():
    assert markdown(TABLE) == [
        "## A table",
        "",
        "What it is.",
        "",
        "| world | success | time | gain |",
        "|---|---|---|---|",
        "| factory \\| 4 | 8 [49, 94%] | 1.2 [0.0, 2.5] | +5 [+0, +9] |",  # Wilson's interval of 8 in 10
        "| square | 0 [0, 100%] | - | - |",
    ]


def test_as_csv():
    header, first, second = csv.reader(io.StringIO(as_csv(TABLE)))
    assert header == [
        "world", "success", "success: of", "success: low", "success: high", "time", "time: low", "time: high",
        "gain", "gain: low", "gain: high",
    ]  # fmt: skip
    row = dict(zip(header, first))
    assert row["world"] == "factory | 4"
    assert (row["success"], row["success: of"], row["success: low"][:6]) == ("8", "10", "0.4901")
    assert (row["time"], row["time: low"]) == ("1.25", "-0.01")
    assert second == ["square", "0", "0", "0.0", "1.0", *[""] * 6]
