import pytest

from robots.bodies.tiago import Tiago
from robots.noise import NoiseConfig
from robots.simulation import Simulation
from tests.robots.halls import hall


@pytest.fixture(scope="session")
def tiago() -> Tiago:
    return Tiago()


@pytest.fixture
def simulation(tiago) -> Simulation:
    simulation = Simulation(hall(), tiago, 0, noise=NoiseConfig.none())
    simulation.reset()
    return simulation
