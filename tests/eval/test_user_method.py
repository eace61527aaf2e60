"""Methods of the user's own: what is built, and what is refused, in one line."""

import hashlib
import json
import sys

import pytest

from eval.commands import eval_, heatmap, run
from eval.episode import Episode, EpisodeConfig
from eval.methods import MethodOptions, build, identity_of, resolve
from eval.suites import SUITES, choose
from tests.vuca_nav.rooms import LIDAR, disc_body
from vuca_nav.errors import BadArgument
from vuca_nav.navigator import Navigator
from vuca_nav.policy.dynamic_window import DynamicWindow

POLICY = """
from vuca_nav.policy.dynamic_window import DynamicWindow

def build(request):
    return DynamicWindow(request.body, request.lidar)
"""
NAVIGATOR = POLICY.replace(
    "return DynamicWindow(request.body, request.lidar)",
    """from vuca_nav.navigator import Navigator, NavigatorConfig
    policy = DynamicWindow(request.body, request.lidar)
    return Navigator(request.body, request.lidar, policy, NavigatorConfig(planning_rate=2.0))""",
)


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Writes a module of the working directory; tests of one name must not find each other's."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])

    def write(source: str, name: str = "my_planner") -> str:
        monkeypatch.delitem(sys.modules, name, raising=False)
        (tmp_path / f"{name}.py").write_text(source)
        return f"{name}:build"

    yield write
    sys.modules.pop("my_planner", None)


def test_a_policy_drives_under_the_projects_exploration(module):
    stack = build(resolve(module(POLICY)), disc_body(), LIDAR, "odometry")
    assert isinstance(stack, Navigator)
    assert isinstance(stack.policy, DynamicWindow)
    assert stack.config.slam.localisation == "odometry"


def test_a_navigator_is_taken_as_it_is(module):
    stack = build(resolve(module(NAVIGATOR)), disc_body(), LIDAR)
    assert isinstance(stack, Navigator)
    assert stack.config.planning_rate == 2.0


def test_an_episode_of_ones_own_policy_is_that_of_the_same_method(module):
    rows = []
    for method in (module(POLICY), "dwa-dh"):
        episode = Episode(EpisodeConfig(world="static", method=method, without="V"))
        episode.timeout = 2.0
        rows.append(episode.run().row())
    assert rows[0]["method"] == "my_planner:build"
    assert rows[0]["path_length"] == rows[1]["path_length"] > 0.5


def test_an_evaluation_is_of_the_modules_source(module, tmp_path, monkeypatch):
    monkeypatch.setattr("eval.evaluate.run_episodes", lambda *_: iter(()))
    name = module(POLICY)
    assert identity_of(resolve(name)) == {
        "module": name, "source_sha256": hashlib.sha256(POLICY.encode()).hexdigest(),
    }  # fmt: skip
    arguments = ["smoke", "--out", str(tmp_path / "out"), "--method", name, "--trust"]
    assert eval_(arguments) == 0
    config = json.loads((tmp_path / "out" / "config.json").read_text())["config"]
    assert (config["methods"], config["configurations"][name]["module"]) == ([name], name)
    module(NAVIGATOR)
    with pytest.raises(BadArgument, match=r"was begun with configurations.*source_sha256"):
        eval_(arguments)


def test_it_is_loaded_only_under_trust(module, tmp_path):
    name = module("raise AssertionError('it was loaded')")
    for command, arguments in (
        (run, []),
        (eval_, ["smoke", "--out", str(tmp_path / "out")]),
        (heatmap, ["--out", str(tmp_path / "h.png")]),
    ):
        with pytest.raises(BadArgument, match=r"method my_planner:build runs Python code .*; add --trust"):
            command([*arguments, "--method", name])


@pytest.mark.parametrize(
    ("name", "source", "message"),
    [
        ("nowhere:build", POLICY, "there is no module 'nowhere' in "),
        ("my_planner.deeper:build", POLICY, "there is no module 'my_planner.deeper' in "),
        ("my_planner.py:build", POLICY, "there is no module 'my_planner.py' in "),
        ("my_planner:make", POLICY, "the module 'my_planner' has no 'make'"),
        ("my_planner:x", "x = 3", "has, but not as a function, 'x'"),
        ("my_planner:", POLICY, "as in my_planner:build"),
        (":build", POLICY, "as in my_planner:build"),
        ("my_planner:build", "import no_such_package", r"No module named 'no_such_package' \(.*my_planner.py:1\)"),
        ("my_planner:build", "def build(request:", "SyntaxError"),
        ("my_planner:build", "1 / 0", r"ZeroDivisionError: division by zero \(.*my_planner.py:1\)"),
    ],
)
def test_a_module_that_cannot_be_used_is_refused_before_the_run(module, name, source, message):
    module(source)
    with pytest.raises(BadArgument, match=f"^--method {name}: .*{message}"):
        choose(SUITES["smoke"], [name])


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("def build(request): return 3", "it returned int; a Navigator or a LocalPolicy would be right"),
        ("def build(request): return None", "it returned NoneType"),
        ("def build(): return 3", "TypeError: build"),
        ("def build(request):\n    return request.lidars", r"AttributeError: .*'lidars' \(.*my_planner.py:2\)"),
    ],
)
def test_a_factory_that_fails_is_refused(module, source, message):
    method = resolve(module(source))
    with pytest.raises(BadArgument, match=f"^--method my_planner:build: .*{message}"):
        build(method, disc_body(), LIDAR)


def test_options_do_not_go_with_it(module):
    with pytest.raises(BadArgument, match=r"'my_planner:build' has no shield; --no-shield goes with: ours, ours-dh$"):
        resolve(module(POLICY), MethodOptions(no_shield=True))
