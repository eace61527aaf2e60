import numpy as np
import pytest

from eval.bridge.faults.raw import KINDS, SCAN
from vuca_nav.deploy.transport.ros_types import BadMessage, decode


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_is_refused_as_a_scan(kind):
    _, make = KINDS[kind]
    rng = np.random.default_rng(0)
    for _ in range(20):
        with pytest.raises(BadMessage):
            decode(make(rng), SCAN)
