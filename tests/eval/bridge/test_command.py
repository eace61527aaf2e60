import pytest

from eval.bridge.command import bridge
from vuca_nav.errors import VucaError


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        ("--seeds 0:2 --episodes 2", "--episodes and --seeds exclude each other"),
        ("--episodes 0", "--episodes must be 1 or more"),
        ("--lockstep --real-time-factor 2", "leave out --real-time-factor"),
        ("--lockstep --cmd-vel plain", "leave out --cmd-vel plain"),
        ("--real-time-factor 0", "factor must be"),
        ("--warm-up -1", "--warm-up must be 0 to 3600 s"),
        ("--as a:b", "--as must be a name"),
        ("--robot gp2", "unknown robot 'gp2'"),
        ("--ros-args -r scan", "left:=right"),
    ],
)
def test_arguments_that_do_not_go_together_are_refused_before_anything_is_published(arguments, complaint):
    with pytest.raises(VucaError, match=complaint):
        bridge(arguments.split())
