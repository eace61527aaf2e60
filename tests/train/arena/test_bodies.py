import numpy as np

from train.arena.bodies import go2, identified_response, tiago


def test_the_bodies_answer_as_they_were_identified():
    """Gain, lag, delay and noise of v_x, v_y and w_z: what the shipped policies were trained with."""
    expected = {
        "tiago": [(1.005, 0.022, 0.0, 0.011), (1.0, 0.022, 0.0, 0.0), (1.013, 0.023, 0.0, 0.017)],
        "go2": [(1.092, 0.002, 0.088, 0.084), (1.163, 0.034, 0.124, 0.054), (1.035, 0.002, 0.023, 0.054)],
    }
    for body in (tiago(), go2()):
        assert np.array_equal(body.response, expected[body.spec.name])
        assert np.array_equal(body.response, identified_response(body.spec.name))
