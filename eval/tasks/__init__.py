"""Tasks apart from worlds: files of start, goal, tolerance and time limit, and the scores of their sources."""
