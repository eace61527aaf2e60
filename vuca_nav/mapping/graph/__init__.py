"""The back end of SLAM: loop closures, and the graph of submaps that they correct."""
