"""The networks of a bundle as ONNX graphs, run by ONNX Runtime on the processor."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vuca_nav.data_files import parse_json, read_bytes, shown
from vuca_nav.deploy.bundle import Bundle
from vuca_nav.deploy.manifest import MOST_BYTES
from vuca_nav.errors import BadBundle

INPUT = "observation"


class Graph:
    """A graph, ready to run, with one thread as beside a robot's other work.

    Args:
        bundle: The bundle that it is of.
        name: Name of its file.
        outputs: Names that its outputs must have.

    Raises:
        BadBundle: If the bundle has none of that name, or ONNX Runtime cannot run it.
    """

    def __init__(self, bundle: Bundle, name: str, outputs: tuple[str, ...]):
        import onnxruntime
        from onnxruntime.capi import onnxruntime_pybind11_state as states  # pyright: ignore[reportAttributeAccessIssue]

        self._path, self._outputs = bundle.directory / name, outputs
        if name not in bundle.manifest.files:
            raise BadBundle(f"{bundle.directory} has no {name}, which its stack needs; export the bundle again")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4
        content = read_bytes(self._path, MOST_BYTES[name], BadBundle)
        self._wrong: tuple[type[Exception], ...] = (
            states.Fail, states.InvalidArgument, states.InvalidGraph, states.InvalidProtobuf, states.NotImplemented,
            states.RuntimeException,
        )  # fmt: skip
        try:
            self._session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except self._wrong as error:
            raise BadBundle(f"{self._path} is no graph that ONNX Runtime runs: {shown(error, 200)}") from error
        inputs = self._session.get_inputs()
        found = [end.name for end in self._session.get_outputs()]
        if [end.name for end in inputs] != [INPUT] or found != list(outputs):
            raise BadBundle(f"{self._path} gives {shown(', '.join(found))}, expected {', '.join(outputs)} of {INPUT}")
        self._columns = inputs[0].shape[-1]

    @property
    def contract(self) -> Any:
        """The contract in the graph's metadata; None if there is none."""
        text = self._session.get_modelmeta().custom_metadata_map.get("vuca.contract")
        return None if text is None else parse_json(text, str(self._path), BadBundle)

    def check_columns(self, observations: NDArray[np.float32]) -> None:
        """Raise BadBundle if recorded observations are not of this network."""
        if observations.shape[1] != self._columns and len(observations):
            raise BadBundle(
                f"{self._path} takes {self._columns} numbers, the recorded steps have {observations.shape[1]}"
            )

    def run_each(self, observations: NDArray[np.float32]) -> tuple[list[NDArray[np.float32]], list[int]]:
        """Run observations one by one, as a robot would.

        Args:
            observations: (n, x).

        Returns:
            Each output, (n, columns), and the time of each run [ns].

        Raises:
            BadBundle: If ONNX Runtime fails.
        """
        rows: list[list[NDArray[np.float32]]] = []
        times = []
        for k in range(len(observations)):
            batch = np.ascontiguousarray(observations[k : k + 1], np.float32)
            began = time.perf_counter_ns()
            try:
                rows.append(self._session.run(None, {INPUT: batch}))  # type: ignore[arg-type]
            except self._wrong as error:
                raise BadBundle(f"{self._path} does not run: {shown(error, 200)}") from error
            times.append(time.perf_counter_ns() - began)
        columns = [end.shape[-1] for end in self._session.get_outputs()]
        if not rows:
            return [np.zeros((0, size), np.float32) for size in columns], times
        return [np.concatenate(parts) for parts in zip(*rows)], times
