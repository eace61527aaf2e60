from train.ppo.run_directory import read_log


def test_a_torn_last_line_of_the_log_is_left_out(tmp_path):
    log = tmp_path / "log.jsonl"
    log.write_text('{"iteration": 1}\n{"iteration": 2}\n{"itera')
    assert [row["iteration"] for row in read_log(log)] == [1, 2]
