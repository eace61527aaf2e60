"""Tables of a gate's shares and commands in Markdown, for the terminal and for pages."""

from train.analysis.gate.summary import MOTIONS
from train.analysis.situations import DEFINITIONS, PRECEDENCE, SITUATIONS
from train.navigation.skills import SKILLS

LEAST = 0.01
"""Least share of the decisions that an expert leads, for its command there to be in a table."""


def tables(result: dict) -> str:
    """Write the tables of one policy. Experts are numbered from 1.

    Args:
        result: Result of ``summary.summarise``, with ``knock_outs`` or without.
    """
    rows = {name: row for name, row in result["situations"].items() if row["decisions"]}
    names = [f"expert {n + 1}" for n in range(len(result["situations"]["all"]["experts"]))]
    parts = [
        *(f"- {name}: {what}" for name, what in DEFINITIONS.items()),
        f"- where several fit, the first of {', '.join(SITUATIONS[k] for k in PRECEDENCE[:-2])}", "",
        "Mean shares of the experts in %, and the gate's entropy [nat]; 95% intervals draw whole episodes again:", "",
        *_table(
            ["situation", "decisions", "episodes", "entropy", *names],
            [
                [name, f"{row['decisions']:,}", f"{row['episodes']:,}", _number(row["entropy"])]
                + [_percent(expert["share"]) for expert in row["experts"]]
                for name, row in rows.items()
            ],
        ),
        "Decisions that each expert leads, in %:", "",
        *_table(
            ["situation", *names],
            [[name] + [_percent(expert["leads"]) for expert in row["experts"]] for name, row in rows.items()],
        ),
        "Mean command where an expert leads, v_x and |w_z| as shares of the body's limits (a dash: it leads less than "
        "1%):", "",
        *_table(
            ["situation", *names],
            [[name] + [_led(e) for e in row["experts"]] for name, row in rows.items()],
        ),
        "Mean command that each expert alone would give for the same observations, and what it does most of, in % of "
        f"the decisions ({', '.join(MOTIONS)}):", "",
        *_table(
            ["situation", *names],
            [
                [name] + [f"{_command(e['command_alone'])}: {_motions(e['motion_alone'])}" for e in row["experts"]]
                for name, row in rows.items()
            ],
        ),
        "Decisions that each expert leads, in %, by the skill that the observation calls for (what a taught gate was "
        "taught first, expert by expert in this order):", "",
        *_table(
            ["skill", "decisions", *names],
            [
                [skill, f"{row['decisions']:,}", *(_percent(share) for share in row["leads"])]
                for skill, row in ((skill, result["skills"][skill]) for skill in SKILLS)
            ],
        ),
        "Decisions in each kind of world:", "",
        *_table(
            ["world", *SITUATIONS],
            [[world] + [f"{count:,}" for count in counts.values()] for world, counts in result["worlds"].items()],
        ),
    ]  # fmt: skip
    if "knock_outs" in result:
        by_situation = [[row for row in result["knock_outs"] if row["situation"] == name] for name in SITUATIONS]
        tried = sum(row["difference"] is not None for row in result["knock_outs"])
        parts += [
            "Without an expert in one situation: difference of success in points, paired, in the episodes in which the "
            f"situation came up. Of {tried} such differences one in twenty would look sure by chance. A dash: not "
            "tried, the expert's share there is below 1%:", "",
            *_table(
                ["situation", "episodes", "success %", *names],
                [_knocked_out(rows) for rows in by_situation if rows[0]["episodes"]],
            ),
        ]  # fmt: skip
    return "\n".join(parts)


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    lines = [head, ["---"] * len(head), *rows]
    return [f"| {' | '.join(line)} |" for line in lines] + [""]


def _knocked_out(rows: list[dict]) -> list[str]:
    known = [row["with"] for row in rows if row["with"] is not None]
    cells = [
        "-"
        if row["difference"] is None
        else "{:+.1f} ({:+.1f} to {:+.1f})".format(*(100 * x for x in row["difference"]))
        for row in rows
    ]
    return [rows[0]["situation"], f"{rows[0]['episodes']:,}", f"{100 * known[0]:.1f}" if known else "-", *cells]


def _percent(triple: list[float] | None) -> str:
    return "-" if triple is None else "{:.1f} ({:.1f}-{:.1f})".format(*(100 * x for x in triple))


def _number(triple: list[float] | None) -> str:
    return "-" if triple is None else "{:.2f} ({:.2f}-{:.2f})".format(*triple)


def _led(expert: dict) -> str:
    return _command(expert["command_where_it_leads"]) if expert["leads"][0] >= LEAST else "-"


def _command(command: dict[str, list[float] | None]) -> str:
    v_x, turn = command["v_x"], command["turn"]
    return "-" if v_x is None or turn is None else f"{v_x[0]:+.2f}, {turn[0]:.2f}"


def _motions(shares: dict[str, list[float] | None]) -> str:
    return " ".join("-" if share is None else f"{100 * share[0]:.0f}" for share in shares.values())
