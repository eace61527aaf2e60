"""Walking: from a velocity command to the joints of a quadruped, with what its own sensors say."""
