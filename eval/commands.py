"""The commands of this package: arguments in, an exit code out. Heavy modules are imported when needed."""

from __future__ import annotations

import json
import shlex
import sys
from dataclasses import asdict, fields
from functools import partial
from typing import TYPE_CHECKING, Any

from eval.arguments import (
    BenchArguments,
    CompareArguments,
    DriverArguments,
    EpisodeArguments,
    EvalArguments,
    ExplainArguments,
    HeatmapArguments,
    ListArguments,
    MonitorArguments,
    OptionArguments,
    ReportArguments,
    RunArguments,
    SceneArguments,
)
from vuca_nav.cli import parse, show
from vuca_nav.data_files import shown
from vuca_nav.errors import BadArgument, UnknownName
from vuca_nav.files import prepare_file
from vuca_nav.provenance import commit, machine

if TYPE_CHECKING:
    from eval.episode import EpisodeConfig
    from eval.methods import MethodOptions


def run(argv: list[str]) -> int:
    """Run one episode: a robot, a world it has no map of, a goal."""
    arguments = parse(RunArguments, "run", argv)
    arguments.check_view()
    from eval.episode import Episode
    from eval.methods import BEST, title_of
    from eval.progress import ProgressLine, result_table
    from vuca_nav.mapping.map_file import prepare_map, write_map

    config = _episode(arguments, BEST)
    episode = Episode(config, wants_map=arguments.save_map is not None)
    map_path = None if arguments.save_map is None else prepare_map(arguments.save_map)
    method = title_of(config.method, config.options.given())
    made_by = {"commit": commit(), "machine": machine()}
    telemetry = arguments.open_view(f"{config.world}, {config.robot}, {method}, seed {config.seed}")
    try:
        if telemetry is not None:
            telemetry.made_by(made_by)
        with ProgressLine(sys.stderr) as progress:
            result = episode.run(telemetry, progress)
        row = result.row()
        show(result_table(row))
        _print_json({**row, "made_by": made_by}, arguments.json)
        if map_path is not None and episode.map is not None:
            write_map(episode.map, map_path)
            print(f"map: {map_path}", file=sys.stderr)
        if telemetry is not None:
            telemetry.wait()
    finally:
        if telemetry is not None:
            telemetry.close()
    return 0


def list_(argv: list[str]) -> int:
    """List the worlds, robots, methods or suites there are."""
    arguments = parse(ListArguments, "list", argv)
    names = _names(arguments.what)
    width = max(map(len, names))
    show("\n".join(f"{name:{width}}  {description}" for name, description in names.items()))
    _print_json(names, arguments.json)
    return 0


def eval_(argv: list[str]) -> int:
    """Run a suite of episodes on all cores; run it again, and it goes on where it was."""
    arguments = parse(EvalArguments, "eval", argv)
    if arguments.workers is not None and arguments.workers < 1:
        raise BadArgument(f"--workers must be 1 or more, got {arguments.workers}")
    if (arguments.suite is None) == (arguments.tasks is None):
        raise BadArgument("give the name of a suite (see vuca list suites), or --tasks FILE, and not both")
    from eval.analysis.summary import by_driver, table
    from eval.evaluate import evaluate
    from eval.methods import identity_of, resolve
    from eval.recordings import record_failures
    from eval.suites import choose, episodes_of, find_suite, parse_seeds, turn_dials
    from eval.tasks.job import files_of, job_of, note, suite_of
    from eval.tasks.reading import read_tasks

    methods, robots = _listed("--method", arguments.method), _listed("--robot", arguments.robot)
    for method in methods or ():
        _check_trust(method, arguments)
    for robot in robots or ():
        _check_robot_trust(robot, arguments)
    if arguments.tasks is None:
        tasks, suite, title = None, find_suite(arguments.suite or ""), arguments.suite
    else:
        tasks = read_tasks(arguments.tasks)
        suite, title = suite_of(arguments.tasks, tasks), f"tasks of {arguments.tasks.name}"
    suite = choose(turn_dials(suite, **arguments.dials()), methods, robots, options_of(arguments))
    seeds = suite.seeds if arguments.seeds is None else parse_seeds(arguments.seeds)
    configs = episodes_of(suite, seeds=seeds, limit=arguments.episodes, trust=arguments.trust)
    identity = {
        "suite": title,
        "robots": list(suite.robots),
        "methods": [str(driver) for driver in suite.drivers],
        "configurations": {str(driver): identity_of(resolve(*driver)) for driver in suite.drivers},
        "seeds": [seeds.start, seeds.stop],
        "episodes": len(configs),
        "tasks": [asdict(task) for task in suite.tasks] if tasks is None else note(tasks),
        **({} if tasks is None else {"files": files_of(tasks)}),
    }
    runner = None
    if arguments.backend == "ray":
        import ray  # noqa: F401  # pyright: ignore[reportMissingImports]  (missed before anything is written)

        from eval.ray_runner import run_on_ray as runner
    command = shlex.join(["vuca", "eval", *argv])
    run_all = evaluate if tasks is None else partial(evaluate, job=job_of(tasks))
    evaluation = run_all(identity, configs, arguments.out, workers=arguments.workers, command=command, run=runner)
    show(table(evaluation.groups if tasks is None else by_driver(evaluation.rows, str(title)), evaluation.total))
    print(f"rows and summary: {arguments.out}", file=sys.stderr)
    crashes = list(evaluation.crashes)
    if arguments.record:
        crashes += record_failures(evaluation.rows, configs, arguments.out / "recordings", arguments.workers)
    for crash in crashes:
        print(f"vuca eval: crashed: {crash.error} in {crash.config}", file=sys.stderr)
    _print_json(json.loads((arguments.out / "summary.json").read_text()), arguments.json)
    return 1 if crashes else 0


def compare(argv: list[str]) -> int:
    """Compare methods in the episodes that they share: paired differences of each outcome."""
    arguments = parse(CompareArguments, "compare", argv)
    from eval.analysis.compare import compare, read_methods, table
    from eval.suites import parse_seeds

    seeds = None if arguments.seeds is None else parse_seeds(arguments.seeds)
    episodes = read_methods(arguments.folders, seeds)
    if len(episodes) < 2:
        raise BadArgument(f"give evaluations of two or more methods to compare, got {', '.join(episodes) or 'none'}")
    against = arguments.against or next(iter(episodes))
    if against not in episodes:
        raise UnknownName("method to compare with", against, episodes)
    found = {name: compare(episodes[against], rows) for name, rows in episodes.items() if name != against}
    for name, differences in found.items():
        show(f"{table(name, against, differences)}\n")
    rows = {name: {task: row._asdict() for task, row in tasks.items()} for name, tasks in found.items()}
    _print_json({"against": against, "differences": rows}, arguments.json)
    return 0


def report(argv: list[str]) -> int:
    """Write a report of evaluations: one HTML page, Markdown, tables as CSV, figures, the paper's claims answered."""
    arguments = parse(ReportArguments, "report", argv)
    from eval.analysis.measurements.files import is_measurement, keep_measurements
    from eval.analysis.report.pages import write_reports
    from eval.kept import keep_rows

    if not arguments.folders:
        raise BadArgument("give one or more directories of vuca eval")
    written = write_reports(arguments.folders, arguments.out)
    show(f"{len(written)} files: {written[0]}, {written[1]}")
    if arguments.rows:
        measured = [source for source in arguments.folders if is_measurement(source)]
        kept = keep_rows([source for source in arguments.folders if source not in measured], arguments.out / "rows")
        kept += keep_measurements(measured, arguments.out / "rows")
        show(f"{len(kept)} files of rows: {arguments.out / 'rows'}")
        written += kept
    _print_json({"files": [str(path) for path in written]}, arguments.json)
    return 0


def explain(argv: list[str]) -> int:
    """Say why an episode failed: its contact, the last moment at which it was avoidable, a recording, a picture."""
    arguments = parse(ExplainArguments, "explain", argv)
    from eval.explain import explain_row, find_row, find_rows

    beside = arguments.source if arguments.source.is_dir() else arguments.source.parent
    out = arguments.out or beside / "explained"
    if arguments.all:
        from eval.analysis.measurements.moments import FILE, find_moments
        from eval.analysis.report.moments import moments_table
        from eval.analysis.report.tables import markdown

        if arguments.seed is not None:
            raise BadArgument("--all explains the collisions of all seeds; leave SEED out")
        rows = find_rows(arguments.source, arguments.filters())
        for row in rows:
            _check_trust(row["method"], arguments)
            _check_robot_trust(row["robot"], arguments)
        command = shlex.join(["vuca", "explain", *argv])
        moments, crashes = find_moments(rows, out / FILE, command, trust=arguments.trust)
        show("\n".join(markdown(moments_table(moments))))
        _print_json({"moments": moments}, arguments.json)
        return 1 if crashes else 0
    row = find_row(arguments.source, arguments.seed, arguments.filters())
    _check_trust(row["method"], arguments)
    _check_robot_trust(row["robot"], arguments)
    explained = explain_row(row, out, trust=arguments.trust)
    show(explained.text)
    _print_json(explained.row, arguments.json)
    return 0


def heatmap(argv: list[str]) -> int:
    """Draw what the critic makes of every place around the robot as a goal."""
    arguments = parse(HeatmapArguments, "heatmap", argv)
    from eval.analysis.heatmap import draw, view_at
    from eval.methods import BEST_WITH_CRITIC
    from eval.progress import ProgressLine

    prepare_file(arguments.out)
    config = _episode(arguments, BEST_WITH_CRITIC)
    with ProgressLine(sys.stderr) as progress:
        view = view_at(config, arguments.at, arguments.half_side, arguments.resolution, progress)
    draw(view, arguments.out)
    show(f"V^h from {view.least:.3f} to {view.greatest:.3f} at {view.time:.2f} s: {arguments.out}")
    _print_json(view.row() | {"out": str(arguments.out)}, arguments.json)
    return 0


def bench(argv: list[str]) -> int:
    """Measure speed: ratios against named references, real-time factor, time of each stage."""
    arguments = parse(BenchArguments, "bench", argv)
    from eval.bench.loop import run_benchmarks

    results = run_benchmarks(sys.stderr)
    for result in results:
        show(f"{result['name']:28} {result['value']:10.3f} {result['unit']:6}  {result['meaning']}")
    _print_json({result.pop("name"): result for result in results}, arguments.json)
    return 0


def _episode(arguments: EpisodeArguments, default: str) -> EpisodeConfig:
    """The episode that is asked for.

    Args:
        arguments: Arguments of the command.
        default: Method that runs where none is named.
    """
    from eval.episode import EpisodeConfig

    scene = {field.name: getattr(arguments, field.name) for field in fields(SceneArguments)}
    method = driver_of(arguments, default)
    options = options_of(arguments)
    return EpisodeConfig(**scene, robot=arguments.robot, method=method, options=options, trust=arguments.trust)


def driver_of(arguments: DriverArguments, default: str) -> str:
    """The method that is asked for; refuses method and robot of the user's own without --trust.

    Args:
        arguments: Arguments of the command.
        default: Method that runs where none is named.
    """
    method = arguments.method or default
    _check_trust(method, arguments)
    _check_robot_trust(arguments.robot, arguments)
    return method


def _check_trust(method: str, arguments: OptionArguments | ExplainArguments) -> None:
    """Refuse a method of the user's own without --trust, since it runs any Python."""
    from eval.methods import is_users_own

    if is_users_own(method) and not arguments.trust:
        raise BadArgument(f"method {shown(method)} runs Python code of your own; add --trust if you trust it")


def _check_robot_trust(robot: str, arguments: OptionArguments | ExplainArguments) -> None:
    """Refuse a robot whose drive is an interface of the user's own without --trust, since it runs any Python."""
    from robots.registry import runs_user_code

    if not arguments.trust and runs_user_code(robot):
        raise BadArgument(f"robot {shown(robot)} runs Python code of your own; add --trust if you trust it")


def _listed(flag: str, text: str | None) -> list[str] | None:
    """Names with commas between them."""
    names = None if text is None else text.split(",")
    if names is not None and not all(names):
        raise BadArgument(f"{flag} {text}: names with commas between them would be right, as in A,B")
    return names


def options_of(arguments: OptionArguments) -> MethodOptions:
    """The changes to the method that the arguments ask for."""
    from eval.methods import MethodOptions

    return MethodOptions(
        policy=None if arguments.policy is None else str(arguments.policy),
        gate=arguments.gate,
        without_expert=arguments.without_expert,
        no_shield=arguments.no_shield,
        critic=None if arguments.critic is None else str(arguments.critic),
        gamma=arguments.gamma,
        monitor=isinstance(arguments, MonitorArguments) and arguments.monitor,
    )


def _names(what: str) -> dict[str, str]:
    if what == "worlds":
        from worlds.registry import WORLDS

        return {name: str(kind) for name, kind in WORLDS.items()}
    if what == "robots":
        from robots.registry import ROBOTS

        return {name: _first_line(maker) for name, maker in ROBOTS.items()}
    if what == "methods":
        from eval.methods import BEST, METHODS

        return {
            name: method.description + (" (the default)" if name == BEST else "") for name, method in METHODS.items()
        }
    from eval.suites import SUITES

    return {name: suite.description for name, suite in SUITES.items()}


def _first_line(described: Any) -> str:
    return described if isinstance(described, str) else (described.__doc__ or "").strip().partition("\n")[0]


def _print_json(content: dict[str, Any], wanted: bool) -> None:
    if wanted:
        show(json.dumps(content, allow_nan=False))
