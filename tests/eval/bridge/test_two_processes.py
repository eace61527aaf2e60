"""vuca deploy in a process of its own drives the simulator in this one, over DDS on loopback."""

import signal
from dataclasses import replace

import pytest

from eval.bridge.faults.__main__ import FaultArguments
from eval.bridge.faults.__main__ import run as make_faults
from eval.bridge.faults.kept import read_campaign
from eval.bridge.processes import SIMULATED_CLOCK, Deployment, StackEnded, own_domain
from eval.bridge.remote_stack import Lockstep, RealTime, RemoteStack
from eval.bridge.robot_wire import RobotWire, WireConfig
from eval.bridge.session import BridgedEpisode, wait_for_stack
from eval.bridge.trials import MONITORED, bundle_of, differences
from eval.episode import Episode, EpisodeConfig
from robots.registry import make_body
from tests.eval.bridge.test_session import SCENE
from vuca_nav.deploy.transport.dds import DdsTransport
from vuca_nav.deploy.transport.network import NetworkConfig

pytestmark = pytest.mark.slow
PATIENCE = 300.0


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return bundle_of("tiago", "dwa-dh", tmp_path_factory.mktemp("bundles"))


@pytest.fixture
def config(tmp_path):
    scene = tmp_path / "hall.yaml"
    scene.write_text(SCENE)
    return EpisodeConfig(world=str(scene), method="dwa-dh")


@pytest.fixture
def transport():
    with DdsTransport(NetworkConfig(own_domain())) as transport:
        yield transport


def deployed(bundle, tmp_path, *options):
    return Deployment(bundle, options, own_domain(), tmp_path / "deploy.log")


@pytest.mark.parametrize("action", [False, True])
def test_missions_one_after_the_other_are_those_of_a_single_process(bundle, config, transport, tmp_path, action):
    with deployed(bundle, tmp_path, "--lockstep") as process:
        wire = RobotWire(transport, make_body("tiago"), WireConfig(action=action))
        wait_for_stack(wire, PATIENCE, process.check)
        stack = RemoteStack(wire, Lockstep(PATIENCE))
        for seed in (1, 2):
            mission = replace(config, seed=seed)
            wire_row = BridgedEpisode(mission, stack).run().row()
            alone = Episode(replace(mission, options=MONITORED)).run().row()
            assert alone["outcome"] == "success"
            assert differences(wire_row, alone) == []


def test_a_killed_stack_leaves_the_robot_standing(bundle, config, transport, tmp_path):
    with deployed(bundle, tmp_path, *SIMULATED_CLOCK) as process:
        wire = RobotWire(transport, make_body("tiago"))
        wait_for_stack(wire, PATIENCE, process.check)
        pace = RealTime()

        def kill_on_the_way(_time, to_goal):
            if to_goal < 2.5:
                process.send(signal.SIGKILL)

        mission = replace(config, goal=(6.5, 4.5), without="V", time_limit=15.0)
        episode = BridgedEpisode(mission, RemoteStack(wire, pace))
        row = episode.run(progress=kill_on_the_way).row()
        assert row["outcome"] == "timeout"
        assert pace.stale > 30
        assert pace.is_stale
        with pytest.raises(StackEnded, match="exit code -9"):
            process.check()


def test_faults_are_made_and_survived_and_the_table_is_written(tmp_path, capsys):
    names = "lidar_silent,lidar_malformed,lidar_beside,second_publisher,process_paused,process_killed"
    arguments = FaultArguments(
        out=tmp_path, robot="tiago", region=1, method="dwa-dh", faults=names, number=1, timeout=PATIENCE
    )
    make_faults(arguments)
    trials = {trial.fault: trial for trial in read_campaign(tmp_path).trials}
    assert set(trials) == set(names.split(","))
    assert read_campaign(tmp_path).crashes == []
    assert all(trial.zero is not None for name, trial in trials.items() if name != "lidar_beside")
    assert (tmp_path / "faults.md").read_text().strip() == capsys.readouterr().out.strip()
    make_faults(arguments)  # nothing is left to do
    assert len(read_campaign(tmp_path).trials) == len(trials)
