"""Batches of a gait's control steps, over a course that gets harder as the training goes on."""

import json
from dataclasses import replace

import numpy as np
import torch

from robots.locomotion.config import QuadrupedConfig
from robots.locomotion.kernels import ACTION_SIZE, OBSERVATION_SIZE
from train.locomotion.config import Stage, TrainingConfig
from train.locomotion.environment import LocomotionEnvironment
from train.locomotion.kernels import CRITIC_SIZE
from train.locomotion.policy import ActorNetwork, Normaliser, Perceptron, observation_mirror, privileged_mirror
from train.ppo.estimates import log_prob
from train.ppo.rollout import Rollout, Rollouts

_NEW_FLOORS = 0.02
"""Share of the robots that get a new body and floor after each iteration."""


class Course:
    """The environments of a training, one after another, and the difficulty of the present one.

    Args:
        robot: The robot that learns.
        config: Stages, commands and environment.
        threads: Processor cores for the physics.
    """

    def __init__(self, robot: QuadrupedConfig, config: TrainingConfig, threads: int):
        self._robot, self._config, self._threads = robot, config, threads
        self.rng = np.random.default_rng(np.random.SeedSequence(config.seed))
        self.stage = 0
        self.environment = self._make(config.stages[0])

    def stage_at(self, progress: float) -> int:
        """Index of the stage after this share of the training."""
        return max(k for k, stage in enumerate(self._config.stages) if stage.start <= progress)

    def enter(self, stage: int) -> bool:
        """Make the environment of the stage, if it is a new one; returns whether it is."""
        if stage == self.stage:
            return False
        self.stage = stage
        self.environment = self._make(self._config.stages[stage])
        return True

    def set_difficulty(self, progress: float) -> None:
        """Open the range of commands and roughen the floors."""
        config = self._config
        self.environment.difficulty = min(
            config.first_commands + (1.0 - config.first_commands) * progress / config.opened, 1.0
        )
        self.environment.roughness = self._roughness(progress)

    def _roughness(self, progress: float) -> float:
        """Roughness, which rises over the first half of a stage from the last one's to its own."""
        stages, k = self._config.stages, self.stage
        end = stages[k + 1].start if k + 1 < len(stages) else 1.0
        before = stages[k - 1].roughness if k > 0 else 0.0
        share = (progress - stages[k].start) / (end - stages[k].start)
        return before + (stages[k].roughness - before) * min(max(2.0 * share, 0.0), 1.0)

    def _make(self, stage: Stage) -> LocomotionEnvironment:
        config = replace(self._config.environment, physics=stage.physics, num_sills=stage.num_sills)
        return LocomotionEnvironment(self._robot, config, self.rng, self._threads)


class GaitRollouts(Rollouts):
    """Robots that walk on from batch to batch, observed through running normalisers.

    Args:
        course: The environments.
        actor: Network of the gait.
        critic: Network that reads the privileged observation.
        horizon: Number of control steps of a batch.
        normaliser_until: Share of the training after which the normalisers are frozen.
    """

    def __init__(self, course: Course, actor: ActorNetwork, critic: Perceptron, horizon: int, normaliser_until: float):
        self.course, self._actor, self._critic = course, actor, critic
        self._horizon, self._normaliser_until = horizon, normaliser_until
        self.see = Normaliser(OBSERVATION_SIZE, observation_mirror())
        self.see_all = Normaliser(CRITIC_SIZE, privileged_mirror())
        seen = {"observation": OBSERVATION_SIZE, "privileged": CRITIC_SIZE}
        self._rollout = Rollout.zeros(horizon, course.environment.config.num_robots, seen, ACTION_SIZE)
        self._look_around()

    def _look_around(self) -> None:
        """Observe for the first time in a new environment."""
        environment = self.course.environment
        first = environment.step(np.zeros((environment.config.num_robots, ACTION_SIZE), np.float32))
        self._now = torch.tensor(first.observation), torch.tensor(first.privileged)

    def collect(self, progress: float, generator: torch.Generator) -> tuple[Rollout, dict[str, float]]:
        """Walk on for a horizon, then give some robots new bodies and floors."""
        course, horizon, batch = self.course, self._horizon, self._rollout
        if course.enter(course.stage_at(progress)):
            self._look_around()
        course.set_difficulty(progress)
        environment = course.environment
        std = self._actor.std()
        observation, privileged = self._now
        truncated = torch.zeros_like(batch.done)
        falls, reward, terms, errors = 0, 0.0, {}, []
        for t in range(horizon):
            if progress < self._normaliser_until:
                self.see.update(observation)
                self.see_all.update(privileged)
            x, y = self.see(observation), self.see_all(privileged)
            mean = self._actor.layers(x)
            action = mean + std * torch.randn(mean.shape, generator=generator)
            batch.seen["observation"][t], batch.seen["privileged"][t] = x, y
            batch.mean[t], batch.action[t], batch.log_prob[t] = mean, action, log_prob(action, mean, std)
            batch.value[t] = self._critic(y)
            step = environment.step(action.numpy())
            batch.reward[t, :, 0] = torch.from_numpy(step.reward)
            truncated[t, :, 0] = torch.from_numpy(step.truncated)
            batch.terminated[t, :, 0] = torch.from_numpy(step.terminated)
            falls += int(step.terminated.sum())
            reward += float(step.reward.mean()) / horizon
            for key, value in environment.reward_terms().items():
                terms[f"reward/{key}"] = terms.get(f"reward/{key}", 0.0) + value / horizon
            errors.append(np.abs(environment.batch.slow_error).mean(axis=0))
            observation, privileged = torch.from_numpy(step.observation), torch.from_numpy(step.privileged)
        self._now = observation.clone(), privileged.clone()
        batch.done[:] = batch.terminated | truncated
        batch.following[:] = following_values(batch.value, self._critic(self.see_all(privileged)), truncated)
        environment.new_floors(_NEW_FLOORS)
        v_x, v_y, w_z = np.mean(errors, axis=0).tolist()
        minutes = batch.reward.numel() / environment.config.control / 60.0
        return batch, {
            "reward/total": reward * environment.config.control,
            "falls_per_minute": falls / minutes,
            "slow_error/v_x": v_x, "slow_error/v_y": v_y, "slow_error/w_z": w_z,
            "std": float(std.mean()), **terms,
            "roughness": environment.roughness, "difficulty": environment.difficulty,
        }  # fmt: skip

    def state(self) -> dict:
        """State of robots, floors, normalisers, and the random numbers of the physics."""
        environment = {key: torch.from_numpy(array) for key, array in self.course.environment.state().items()}
        return {
            "see": self.see.state_dict(), "see_all": self.see_all.state_dict(), "observation": self._now[0],
            "privileged": self._now[1], "environment": environment, "stage": self.course.stage,
            "generator": json.dumps(self.course.rng.bit_generator.state),
        }  # fmt: skip

    def load(self, state: dict) -> None:
        """Restore such a state."""
        self.course.enter(int(state["stage"]))
        self.course.environment.load({key: tensor.numpy() for key, tensor in state["environment"].items()})
        self.see.load_state_dict(state["see"])
        self.see_all.load_state_dict(state["see_all"])
        self._now = state["observation"], state["privileged"]
        self.course.rng.bit_generator.state = json.loads(state["generator"])


def following_values(values: torch.Tensor, last: torch.Tensor, truncated: torch.Tensor) -> torch.Tensor:
    """Values of the observations after each step of a batch whose episodes begin anew within it.

    The batched simulation has begun anew by the time that it reports an end: the last observation of an episode whose
    time was up is not known, and the value of the one before it stands in.

    Args:
        values: (h, n, 1) values of the observations before each step.
        last: (n, 1) values of the observations after the last one.
        truncated: (h, n, 1) whether the episode's time was up.
    """
    return torch.where(truncated, values, torch.cat((values[1:], last[None])))
