"""The compiled part of `baliza`."""

import os
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

class InputError(ValueError):
    """A file is wrong."""

    file: str | None
    """The file's path."""
    line: int | None
    """The line's number, from 1; None where the whole file is wrong."""

class Recording:
    differences: bool
    def __init__(self, folder: str | os.PathLike[str]) -> None: ...
    def tags(self) -> list[str | None]: ...
    def anchors(self) -> dict[str, Any]: ...
    def ranges(self) -> dict[str, Any]: ...
    def truth(self) -> dict[str, Any] | None: ...
    def solve(self, method_name: str, within: dict[str, Any], grouping: dict[str, Any]) -> dict[str, Any]: ...
    def track(
        self, nlos: str | None, smooth: bool, within: dict[str, Any], grouping: dict[str, Any]
    ) -> dict[str, Any]: ...

class Track:
    def __init__(self, anchors_m: Floats, nlos: str, within: dict[str, Any]) -> None: ...
    def step(self, t_s: float, ranges: list[tuple[int, float, float, float]]) -> dict[str, Any]: ...

class Decoder:
    """Decodes a stream of telemetry that arrives in pieces."""

    def __init__(self) -> None: ...
    def feed(self, bytes: bytes) -> list[dict[str, Any]]:
        """The messages that these bytes complete, with the keys of `baliza decode`."""
    def summary(self) -> dict[str, Any]:
        """What was received so far and what was lost, with the keys of `baliza decode --json`."""

def methods() -> list[str]: ...
def solve(
    anchors_m: Floats, ranges: dict[str, Any], method_name: str, within: dict[str, Any]
) -> dict[str, Any]: ...
