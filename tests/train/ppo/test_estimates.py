import numpy as np
import pytest
import torch

from train.ppo.estimates import advantages, divergence, log_prob
from train.ppo.rollout import Rollout


def of_one(rewards, values, following, done, terminated):
    """A batch of one row."""
    rollout = Rollout.zeros(len(rewards), 1, {"observation": 1}, 1)
    for buffer, numbers in (
        (rollout.reward, rewards), (rollout.value, values), (rollout.following, following), (rollout.done, done),
        (rollout.terminated, terminated),
    ):  # fmt: skip
        buffer[:, 0, 0] = torch.tensor(numbers)
    return rollout


def test_advantages_by_hand():
    numbers = [1.0, 2.0, 3.0], [0.5, 1.0, 1.5], [1.0, 9.0, 2.0], [False, True, False]
    advantage, target = advantages(of_one(*numbers, [False, True, False]), 0.5, 0.5)
    # Errors: 1 + .5 * 1 - .5 = 1; 2 - 1 = 1 at the end of an episode; 3 + .5 * 2 - 1.5 = 2.5.
    assert advantage.flatten().tolist() == pytest.approx([1.0 + 0.25 * 1.0, 1.0, 2.5])
    assert target.flatten().tolist() == pytest.approx([1.75, 2.0, 4.0])
    # Had its time been up: 2 + .5 * 9 - 1 = 5.5, and before it 1 + .25 * 5.5; the third step is of a new episode.
    advantage, _ = advantages(of_one(*numbers, [False] * 3), 0.5, 0.5)
    assert advantage.flatten().tolist() == pytest.approx([2.375, 5.5, 2.5])


def test_log_probability_of_the_mean():
    mean, std = torch.zeros(1, 3), torch.tensor([0.5, 1.0, 2.0])
    assert float(log_prob(mean, mean, std)) == pytest.approx(-1.5 * np.log(2.0 * np.pi))


def test_divergence_of_normal_distributions_by_hand():
    one, two = torch.ones(1, 1), torch.full((1, 1), 2.0)
    assert float(divergence(one, one, one, one)) == 0.0
    # ln(2 / 1) + (1 + 1) / (2 * 4) - 1/2
    assert float(divergence(one, one, two, two)) == pytest.approx(np.log(2.0) - 0.25)
