"""Deployable bundles made of the robots and methods of the testbed: ``vuca export``."""
