import json

import pytest

from train.ppo.run_directory import RunDirectory, read_log
from vuca_nav.errors import BadArgument


def test_a_torn_last_line_of_the_log_is_left_out(tmp_path):
    log = tmp_path / "log.jsonl"
    log.write_text('{"iteration": 1}\n{"iteration": 2}\n{"itera')
    assert [row["iteration"] for row in read_log(log)] == [1, 2]


def test_two_trainings_do_not_share_a_directory(tmp_path):
    first = RunDirectory(tmp_path, {"seed": 0}, resume=False)
    for resume in (False, True):
        with pytest.raises(BadArgument, match="is being written by another vuca train"):
            RunDirectory(tmp_path, {"seed": 5}, resume=resume)
    assert json.loads((tmp_path / "config.json").read_text()) == {"seed": 0}
    first.release()
    RunDirectory(tmp_path, {"seed": 5}, resume=False)
