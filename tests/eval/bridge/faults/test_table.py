from typing import Any

from eval.bridge.faults.campaign import Trial
from eval.bridge.faults.table import memory_of, table_of

MB = 1 << 20


def trial(**changes):
    good = Trial("lidar_silent", "", 0.6, 0.15, False, True, 0.7, 0.8, 1.2, 0.1)
    return good._replace(**changes)


def cells(trials, crashes=()) -> dict[Any, dict[str, Any]]:
    table = table_of(trials, crashes)
    return {row[0]: dict(zip(table.header, row, strict=True)) for row in table.rows}


def test_a_line_a_fault_with_its_worst_times():
    trials = [trial(), trial(zero=0.19, rest=0.9), trial(zero=0.21), trial(held=False), trial(resumed=None)]
    line = cells(trials)["lidar_silent"]
    assert (line["trials"], line["zero in time"], line["rest in time"], line["went on"]) == (5, (3, 5), (4, 5), 4)
    assert (line["zero, median [s]"], line["zero, most [s]"]) == (0.15, 0.21)
    assert line["rest, most [s]"] == 0.9
    assert round(line["beyond its bound, most [s]"], 9) == 0.1


def test_what_never_stopped_is_not_in_time():
    line = cells([trial(zero=None, rest=None)])["lidar_silent"]
    assert (line["zero in time"], line["rest in time"], line["zero, most [s]"]) == ((0, 1), (0, 1), None)


def test_crashes_are_told_even_without_a_trial():
    assert cells([], ["lidar_beside"])["lidar_beside"]["crashes"] == 1


def test_faults_that_need_no_stop_show_no_times():
    line = cells([trial(fault="lidar_beside", zero=None, rest=None)])["lidar_beside"]
    assert (line["zero, median [s]"], line["zero in time"], line["rest in time"]) == (None, (1, 1), (1, 1))


def test_memory_is_flat_unless_it_grows():
    steady = [(float(k), 300 * MB + (k % 3) * MB) for k in range(100)]
    growing = [(float(k), 300 * MB + k * MB) for k in range(100)]
    warming = [(float(k), 300 * MB + min(k, 20) * 10 * MB) for k in range(100)]
    courses: list[Any] = [memory_of(samples) for samples in (steady, growing, warming)]
    assert [course.is_flat for course in courses] == [True, False, True]
    assert memory_of(steady[:7]) is None
