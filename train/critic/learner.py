"""Monte Carlo regression of the critic of V^h, a round of episodes an iteration."""

import numpy as np
import torch

from train.arena.arena import Arena
from train.critic.config import CriticConfig
from train.critic.samples import Samples, cross_entropy, judge, play
from train.navigation.mirror import observation_mirror
from train.navigation.networks import FusedActor, NetworkConfig, make_critic
from train.ppo.loop import Report
from train.ppo.rollout import Mirror
from vuca_nav.policy.observation import ObservationConfig


class CriticLearner:
    """The critic, its optimiser and its episodes; no round depends on another's episodes.

    Args:
        config: Settings of the training.
        seed: Seed of weights, episodes and minibatches.
        actor: The policy that drives.
        observation: The observation that the policy, and so the critic, reads.
        arena: An arena each of whose rows runs one episode a round.
    """

    def __init__(
        self, config: CriticConfig, seed: int, actor: FusedActor, observation: ObservationConfig, arena: Arena
    ):
        self._config, self._seed, self._actor, self._arena = config, seed, actor, arena
        self._mirror = Mirror(*observation_mirror(observation))
        generator = torch.Generator().manual_seed(seed)
        self.network = make_critic(observation.size, NetworkConfig(critic=config.hidden), generator)
        self._optimiser = torch.optim.Adam(self.network.parameters(), config.rate)
        self.iteration = 0

    def restart(self) -> None:
        """Do nothing: every round has episodes of its own."""

    def iterate(self, progress: float) -> Report:
        """Make one round: play, judge the critic's predictions, learn.

        Args:
            progress: Share of the training done, 0-1.
        """
        words = np.random.SeedSequence((self._seed, self.iteration)).generate_state(2)
        samples = play(self._arena, self._actor, self._config, int(words[0]))
        report = judge(self.network, samples)
        self.learn(samples, torch.Generator().manual_seed(int(words[1])))
        self.iteration += 1
        return report

    def learn(self, samples: Samples, generator: torch.Generator) -> None:
        """Learn in all passes over one round, with left and right exchanged in half of each minibatch.

        Args:
            samples: Samples of the round.
            generator: Source of the minibatches.
        """
        config = self._config
        for group in self._optimiser.param_groups:
            group["lr"] = config.rate * (1.0 - 0.99 * self.iteration / config.rounds)
        x, y = torch.from_numpy(samples.observations), torch.from_numpy(samples.safety)
        for _ in range(config.passes):
            for part in torch.randperm(len(x), generator=generator).split(config.minibatch):
                batch, half = x[part], len(part) // 2
                batch[:half] = self._mirror(batch[:half])
                loss = cross_entropy(self.network(batch), y[part])
                self._optimiser.zero_grad(set_to_none=True)
                loss.backward()
                self._optimiser.step()

    def state(self) -> dict:
        """State for a checkpoint."""
        return {
            "network": self.network.state_dict(), "optimiser": self._optimiser.state_dict(),
            "iteration": self.iteration,
        }  # fmt: skip

    def load(self, state: dict) -> None:
        """Restore the state of a checkpoint."""
        self.network.load_state_dict(state["network"])
        self._optimiser.load_state_dict(state["optimiser"])
        self.iteration = int(state["iteration"])
