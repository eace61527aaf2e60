"""``python -m train.analysis.gate FILE... --out DIR``: see ``train.analysis.gate.watch``."""

from train.analysis.gate.watch import GateArguments, main
from vuca_nav.cli import run_module

if __name__ == "__main__":
    run_module("gate", main, GateArguments)
