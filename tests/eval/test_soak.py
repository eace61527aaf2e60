"""A day of work, shortened: many missions in one process leave no memory and no file handle behind."""

import gc
import os
import resource
from pathlib import Path

import pytest

from eval.episode import EpisodeConfig, run_episode

MISSIONS = 200
SETTLED = 40
"""Missions after which caches, pools and compiled kernels have their size."""
MOST_GROWTH = 24.0
"""Greatest growth of the memory over the missions after that [MB]: 0.15 MB a mission, less than its map."""
WORLDS = ("square", "static", "dynamic", "double_branch")


def resident() -> float:
    """Memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def handles() -> int:
    return len(os.listdir("/proc/self/fd"))


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads /proc")
def test_missions_leave_nothing_behind(capsys):
    memory, files = [], []
    for k in range(MISSIONS):
        robot, method = ("tiago", "go2")[k % 2], ("ours-dh", "ours", "dwa-dh")[k % 3]
        run_episode(EpisodeConfig(WORLDS[k % len(WORLDS)], robot=robot, method=method, seed=3000 + k))
        gc.collect()
        memory.append(resident())
        files.append(handles())
    with capsys.disabled():
        told = ", ".join(f"{k}: {memory[k - 1]:.0f}" for k in (1, SETTLED, MISSIONS // 2, MISSIONS))
        print(f"\nmemory [MB] after mission {told}; file handles {files[0]} to {files[-1]}")
    assert max(memory[-20:]) - max(memory[SETTLED - 20 : SETTLED]) < MOST_GROWTH
    assert files[-1] <= files[SETTLED]
