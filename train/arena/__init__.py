"""The training arena: hundreds of robots in worlds of their own, stepped together by compiled kernels."""
