"""The HTML page: what it shows, that it needs nothing else, and that a browser reads it without an error."""

import base64
import re
import shlex
import shutil
import subprocess
from html.parser import HTMLParser

import pytest
from PIL import Image

from eval.analysis.report.cells import cells_of, read_evaluation
from eval.analysis.report.failed import failed_episodes
from eval.analysis.report.pages import write_reports
from eval.commands import report
from eval.kept import keep_rows
from tests.eval.analysis.report.measured import write_each
from tests.eval.analysis.report.synthetic import CONTACT, FAILURE, episodes, write_evaluation
from vuca_nav.errors import BadArgument

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


class Page(HTMLParser):
    """What a page holds."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.ids, self.links = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href", "srcset", "action", "data"):
                self.links.append(value)


@pytest.fixture
def folder(tmp_path):
    """Dials, difficulties, two robots, contacts with a name that is markup, and the picture of one failure."""
    rows = []
    for robot in ("tiago", "go2"):
        for method in ("ours-dh", "paper-dh"):
            for task in ({}, {"tolerance": 0.5}, {"without": "V"}, {"movers": 8}, {"start": (1.25, 2.0, 0.0)}):
                outcomes = ["success", "collision", "timeout"]
                rows += episodes({"world": "square", "robot": robot, "method": method, **task}, outcomes)
    for row in rows:
        if row["outcome"] == "collision":
            row["contact"] = CONTACT | {"with": "<script>alert(1)</script>"}
    outcomes = ["collision"] + ["timeout"] * 14
    rows += episodes({"world": "factory", "region": 4, "robot": "tiago", "method": "drl"}, outcomes)
    rows[-1]["failure"] = FAILURE | {"class": "out_of_time"}
    made = write_evaluation(tmp_path / "made", rows)
    (made / "explained").mkdir()
    Image.new("RGB", (40, 30), (200, 30, 30)).save(made / "explained" / "factory-4-tiago-drl-2013.png")
    # A name that several episodes share, of one tolerance and of another, tells no one's picture.
    Image.new("RGB", (40, 30)).save(made / "explained" / "square-tiago-ours-dh-2001.png")
    return made


@pytest.fixture
def page(folder, tmp_path):
    write_reports([folder, *write_each(tmp_path)], tmp_path / "out")
    return tmp_path / "out" / "report.html"


def test_it_needs_nothing_else(page):
    text = page.read_text()
    found = Page(text)
    assert all(link.startswith(("#", "data:")) for link in found.links)
    assert "script" not in found.tags
    assert not re.search(r"@import|url\((?!#)", text)
    assert len(found.ids) == len(set(found.ids))
    assert {link[1:] for link in found.links if link.startswith("#")} <= set(found.ids)
    assert {"nav", "h1", "h2", "h3"} <= set(found.tags)
    # Evaluations, answers, claims, outcomes, measures, tests, contacts, failures, bodies, moments, and what was run.
    assert found.tags.count("table") == 10 + 5
    # Of each robot the metrics, the contacts, the dials and the difficulties; heatmap, courses, gate and its course.
    assert found.tags.count("svg") == 8 + 4
    assert "&lt;script&gt;alert(1)" in text


def test_a_failed_episode_has_its_picture_and_its_commands(page):
    text = page.read_text()
    pictures = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    assert len(pictures) == 1
    assert base64.b64decode(pictures[0]).startswith(b"\x89PNG")
    assert "15 failed, of which 10 are shown" in text
    shown = text[text.index("15 failed") :]
    # The one with a picture comes first.
    assert re.findall(r"<summary>seed (\d+)", shown)[:3] == ["2013", "2000", "2001"]
    assert (
        "vuca explain runs/made 2013 --world factory --region 4 --robot tiago --method drl\n"
        "vuca run --world factory --region 4 --seed 2013 --robot tiago --method drl "
        "--record factory-4-tiago-drl-2013.rrd</pre>"
    ) in shown
    assert "vuca run --world square --seed 2001 --start 1.25 2.0 0.0 --robot go2" in text


def test_the_commands_are_commands(page, folder):
    from eval.arguments import ExplainArguments, RunArguments
    from vuca_nav.cli import parse

    commands = re.findall(r"<pre>(.*?)</pre>", page.read_text(), re.S)
    assert commands
    for command in "\n".join(commands).splitlines():
        name, *words = shlex.split(command)[1:]
        parse({"explain": ExplainArguments, "run": RunArguments}[name], name, words)


def test_a_task_is_run_again_as_it_was_and_is_not_its_worlds_own(tmp_path):
    task = {"world": "square", "tolerance": 0.5, "time_limit": 20.0, "obstacles": "tracks:people.csv"}
    rows = episodes({**task, "robot": "tiago", "method": "ours-dh"}, ["timeout"])
    made = write_evaluation(tmp_path / "tasks", [row | {"task": "over the square"} for row in rows])
    (cell,) = cells_of([read_evaluation(made)])
    assert not cell.is_plain
    assert cell.place == "over the square"
    (failed,) = failed_episodes([cell])
    assert "--tolerance 0.5 --time-limit 20.0 --obstacles tracks:people.csv" in failed.record
    assert failed.explain is not None
    assert failed.explain.endswith("--task 'over the square'")


def test_kept_rows_are_recorded_but_not_explained(folder, tmp_path):
    kept = keep_rows([folder], tmp_path / "rows")
    write_reports(kept, tmp_path / "out")
    text = (tmp_path / "out" / "report.html").read_text()
    assert "vuca run --world factory" in text
    assert "vuca explain runs" not in text


def test_a_picture_that_is_none_is_refused(folder, tmp_path):
    (folder / "explained" / "factory-4-tiago-drl-2013.png").write_text("no picture")
    with pytest.raises(BadArgument, match=r"2013\.png is no PNG; remove it"):
        write_reports([folder], tmp_path / "out")


def test_what_cannot_be_reported_ends_in_one_line(folder, tmp_path, run_command):
    other = tmp_path / "other"
    shutil.copytree(folder, other)
    rows = (other / "episodes.jsonl").read_text().replace('"outcome": "timeout"', '"outcome": "fall"')
    (other / "episodes.jsonl").write_text(rows)
    empty = tmp_path / "empty"
    empty.mkdir()
    for folders, words in (([folder, other], "same episode of one hash with different outcome"), ([empty], "config")):
        code, error = run_command(["report", *map(str, folders), "--out", str(tmp_path / "out")])
        assert code == 2
        assert words in error
        assert len(error.splitlines()) == 1


@pytest.fixture
def run_command(capsys):
    from vuca_nav.cli import main

    def run(words):
        try:
            code = main(words)
        except SystemExit as end:
            code = end.code
        return code, capsys.readouterr().err.strip()

    return run


def open_in(browser, path, width, profile):
    """The DOM of a page as the browser has it, and what it says in its console."""
    command = [
        browser, "--headless=new", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile}",
        f"--window-size={width},900", "--enable-logging=stderr", "--virtual-time-budget=2000", "--dump-dom",
        path.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=180, check=True)
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


@pytest.mark.slow
def test_a_browser_reads_it(page, tmp_path):
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        pytest.skip("no Chromium is installed: apt-get install chromium")
    wrong = tmp_path / "wrong.html"
    wrong.write_text('<script>console.error("seen")</script>')
    assert len(open_in(browser, wrong, 800, tmp_path / "profile")[1]) == 1  # the console is heard
    dom, console = open_in(browser, page, 800, tmp_path / "profile")
    assert console == []
    tags = Page(dom).tags
    assert (tags.count("table"), tags.count("svg"), tags.count("img")) == (15, 12, 1)
    # On a phone tables and figures scroll in their frames, and the page itself is no wider than the screen.
    probe = tmp_path / "probe.html"
    measure = "<script>document.title = `${document.documentElement.scrollWidth} of ${innerWidth}`</script></body>"
    probe.write_text(page.read_text().replace("</body>", measure))
    dom, _ = open_in(browser, probe, 500, tmp_path / "profile")
    ((wide, screen),) = re.findall(r"<title>(\d+) of (\d+)</title>", dom)
    assert int(wide) <= int(screen)


def test_the_command_names_the_page(folder, tmp_path, capsys):
    assert report([str(folder), "--out", str(tmp_path / "out")]) == 0
    assert "out/report.html" in capsys.readouterr().out
