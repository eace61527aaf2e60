"""Upper bounds: planners that know the true map, and one of them the movers' future.

They use the ground truth by definition. It comes by ``Truth``, which no other method is given.
"""
