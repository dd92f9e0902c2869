"""Indoor positions from UWB ranges, by the solvers and the track of the tags of Baliza.

Lengths are metres, times seconds, powers dBm. Coordinates are right-handed; NaN is an unknown number. A position that
could not be computed is NaN with a reason. The computations run in the `f32` of a node, so they equal `baliza solve`
and `baliza track`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal, Union

import numpy as np
import numpy.typing as npt

from . import _native
from ._native import Decoder, InputError

if TYPE_CHECKING:
    import pandas

__all__ = ["METHODS", "Decoder", "Fix", "InputError", "Positions", "Recording", "Track", "decode", "read", "solve"]

METHODS: tuple[str, ...] = tuple(_native.methods())
"""The names of all methods: `robust` is the default; `nls-ccv` is an oracle that reads `los`."""

Floats = npt.NDArray[np.float64]
Side = Literal["below", "above"]
Nlos = Literal["weigh", "ignore", "alike"]
Area = tuple[float, float, float, float]
FilePath = Union[str, "os.PathLike[str]"]


@dataclass(frozen=True)
class Positions:
    """The positions of n epochs, in their order."""

    method: str
    """The method, or `track`."""
    tag: list[str | None]
    """The tags' names, tag after tag; None where the recording does not name its tag."""
    epoch: list[str]
    """The epochs' names."""
    t_s: Floats
    """(n,) times, seconds."""
    position_m: Floats
    """(n, 3) positions, metres; z is NaN in the plane."""
    sigma_m: Floats
    """(n, 3) standard deviations, metres; z is NaN in the plane."""
    covariance_m2: Floats
    """(n, 3, 3) covariances, m²; NaN in the row and column of a height that was not computed."""
    used: npt.NDArray[np.int64]
    """(n,) the number of anchors whose ranges were used."""
    reason: list[str | None]
    """Why there is no position, such as `too-few-anchors`; None where there is one."""
    flag: list[str | None]
    """`ambiguous` where ranges fit two positions, `suspect` where too few ranges agree; else None."""
    velocity_m_s: Floats
    """(n, 3) velocities of a track, metres per second; NaN for a solver."""
    alternative_apart_m: Floats
    """(n, 3) where two positions explain the ranges: the vector from the likelier to the other, metres."""
    alternative_share: Floats
    """(n,) the probability of the other position, at most a half; NaN where there is one position."""
    truth_m: Floats
    """(n, 3) true positions, metres, where they are known."""
    error_m: Floats
    """(n,) distances from the truth, metres: in space where both have a height, else horizontal."""

    def __len__(self) -> int:
        return len(self.epoch)

    def frame(self) -> "pandas.DataFrame":
        """A DataFrame with the columns of `baliza solve --out`; it needs pandas."""
        columns: dict[str, Any] = {"epoch": self.epoch, "t_s": self.t_s, "method": self.method}
        columns |= {f"{axis}_m": self.position_m[:, i] for i, axis in enumerate("xyz")}
        columns |= {f"sigma_{axis}_m": self.sigma_m[:, i] for i, axis in enumerate("xyz")}
        columns |= {"used": self.used, "reason": self.reason}
        if np.isfinite(self.truth_m).any():
            columns["error_m"] = self.error_m
        in_space = np.isfinite(self.covariance_m2[:, 0, 2]).any()
        pairs = [("xy", 0, 1), ("xz", 0, 2), ("yz", 1, 2)] if in_space else [("xy", 0, 1)]
        columns |= {f"cov_{name}_m2": self.covariance_m2[:, i, j] for name, i, j in pairs}
        if np.isfinite(self.velocity_m_s).any():
            axes = "xyz" if in_space else "xy"
            columns |= {f"v{axis}_m_s": self.velocity_m_s[:, i] for i, axis in enumerate(axes)}
        if any(flag is not None for flag in self.flag):
            columns["flag"] = self.flag
            others_m = self.position_m + self.alternative_apart_m
            columns |= {f"alt_{axis}_m": others_m[:, i] for i, axis in enumerate("xyz" if in_space else "xy")}
        if any(tag is not None for tag in self.tag):
            columns["tag"] = self.tag
        return _frame(columns)


@dataclass(frozen=True)
class Fix:
    """The position of a track after a step."""

    t_s: float
    """The time of the step, seconds."""
    position_m: Floats
    """(3,) the position, metres; z is NaN in the plane. NaN without a position."""
    sigma_m: Floats
    """(3,) standard deviations, metres."""
    covariance_m2: Floats
    """(3, 3) covariance, m²; NaN in the row and column of a height that was not computed."""
    velocity_m_s: Floats
    """(3,) velocity, metres per second."""
    used: int
    """The number of ranges of this step that were used; 0: the position is predicted."""
    reason: str | None
    """Why there is no position, such as `too-few-anchors`; None if there is one."""
    flag: str | None
    """`ambiguous` if the tag can be at two positions, `suspect` if too few ranges agree; else None."""
    alternative_apart_m: Floats | None
    """(3,) if the tag can be at two positions: the vector from the likelier to the other, metres. `position_m` is
    the likelier one."""
    alternative_share: float | None
    """The probability of the other position, at most a half."""


class Recording:
    """A recorded folder: anchors, ranges and, where known, the true positions, of one tag or several."""

    def __init__(self, folder: FilePath) -> None:
        """Reads a folder: see `read`."""
        self._native = _native.Recording(folder)
        tables = self._native.anchors()
        self.anchors: list[str] = tables["anchor"]
        """The anchors' names."""
        self.anchors_m: Floats = tables["position_m"]
        """(anchors, 3) their positions, metres."""
        self.tags: list[str | None] = self._native.tags()
        """The tags' names; None where the recording does not name its tag."""

    def ranges(self) -> dict[str, Any]:
        """The ranges as columns: `tag`, `epoch` (names), `anchor` (index in `anchors`), `t_s`, `range_m`, `los` (1, 0 or
        NaN), `rx_power_dbm`, `power_difference_db` (received power less first-path power)."""
        return self._native.ranges()

    def ranges_frame(self) -> "pandas.DataFrame":
        """The ranges as a DataFrame, with the anchors' names; it needs pandas."""
        ranges = self.ranges()
        return _frame({**ranges, "anchor": [self.anchors[index] for index in ranges["anchor"]]})

    def truth(self) -> dict[str, Any] | None:
        """The true positions as columns: `tag`, `epoch` (names), `t_s`, `position_m` (rows, 3); None without a file."""
        return self._native.truth()

    def truth_frame(self) -> "pandas.DataFrame | None":
        """The true positions as a DataFrame with `tag,epoch,t_s,x_m,y_m,z_m`; it needs pandas."""
        truth = self.truth()
        if truth is None:
            return None
        coordinates = {f"{axis}_m": truth["position_m"][:, i] for i, axis in enumerate("xyz")}
        return _frame({"tag": truth["tag"], "epoch": truth["epoch"], "t_s": truth["t_s"], **coordinates})

    def solve(
        self,
        method: str = "robust",
        *,
        dims: int | None = None,
        height_m: float | None = None,
        height_sigma_m: float | None = None,
        height_from_truth: bool = False,
        side: Side | None = None,
        area_m: Area | None = None,
        group_s: float | None = None,
        time_offset_s: float = 0.0,
    ) -> Positions:
        """Solves each epoch by itself, as `baliza solve`. Differences of arrivals have the one method `hyperbolic`.

        `dims` is 2 or 3; None takes that of `recording.toml`, or 3. With dims=2, `height_m` is the tag's height,
        known to ± `height_sigma_m`, or `height_from_truth` takes each epoch's height from the truth. With dims=3 and anchors in one plane, `side` is
        the tag's side of that plane. `area_m` bounds the positions: least x and y, greatest x and y. Single ranges are
        grouped to rounds of at most `group_s` seconds: None chooses a time, 0 keeps the epochs of the file.
        `time_offset_s` is added to the times of the truth.

        Raises ValueError for arguments that are unknown or do not fit.
        """
        within = _within(dims, height_m, height_sigma_m, height_from_truth, side, area_m)
        found = self._native.solve(method, within, {"group_s": group_s, "time_offset_s": time_offset_s})
        return Positions(method="hyperbolic" if self._native.differences else method, **found)

    def track(
        self,
        *,
        nlos: Nlos | None = None,
        smooth: bool = False,
        dims: int | None = None,
        height_m: float | None = None,
        height_sigma_m: float | None = None,
        height_from_truth: bool = False,
        side: Side | None = None,
        area_m: Area | None = None,
        group_s: float | None = None,
        time_offset_s: float = 0.0,
    ) -> Positions:
        """Follows the tag through the epochs in the order of time, as `baliza track`.

        `nlos` is the use of powers: `weigh` (as recording.toml says by default), `ignore` (leave blocked ranges out) or
        `alike` (powers are not used). With `smooth`, each position is by the measurements of the whole recording, as
        `track-smooth`. The other arguments are those of `solve`, but single ranges become rounds only where `group_s` is
        given.

        Raises ValueError for arguments that are unknown or do not fit.
        """
        within = _within(dims, height_m, height_sigma_m, height_from_truth, side, area_m)
        grouping = {"group_s": group_s, "time_offset_s": time_offset_s}
        found = self._native.track(nlos, smooth, within, grouping)
        return Positions(method="track-smooth" if smooth else "track", **found)


def read(folder: FilePath) -> Recording:
    """Reads a recorded folder: `anchors.csv`, `ranges.csv` or `differences.csv` and, where they exist, `truth.csv`
    and `recording.toml`.

    Raises InputError, with `file` and `line`, where a file is wrong.
    """
    return Recording(folder)


def solve(
    anchors_m: npt.ArrayLike,
    ranges_m: npt.ArrayLike,
    method: str = "robust",
    *,
    dims: int = 3,
    height_m: float | None = None,
    height_sigma_m: float | None = None,
    side: Side | None = None,
    area_m: Area | None = None,
    los: npt.ArrayLike | None = None,
    rx_power_dbm: npt.ArrayLike | None = None,
    fp_power_dbm: npt.ArrayLike | None = None,
) -> Positions:
    """Solves each row of ranges by itself.

    `anchors_m` has the shape (anchors, 3), or (anchors, 2) for dims=2 without `height_m`; `ranges_m` has the shape
    (epochs, anchors), or (anchors,) for one epoch, metres; NaN: no range. `los` (1 or 0, for the oracle `nls-ccv`) and
    the powers, dBm, have the shape of `ranges_m`. Of an epoch, the sixteen shortest ranges are used.

    Raises ValueError for wrong shapes, numbers that are not finite, and unknown methods.
    """
    ranges = {
        "range_m": _rows("ranges_m", ranges_m),
        "los": None if los is None else _rows("los", los),
        "rx_power_dbm": None if rx_power_dbm is None else _rows("rx_power_dbm", rx_power_dbm),
        "fp_power_dbm": None if fp_power_dbm is None else _rows("fp_power_dbm", fp_power_dbm),
    }
    within = _within(dims, height_m, height_sigma_m, False, side, area_m)
    return Positions(method=method, **_native.solve(_matrix("anchors_m", anchors_m), ranges, method, within))


class Track:
    """Follows a tag from step to step: the tag's own engine."""

    def __init__(
        self,
        anchors_m: Mapping[Any, Sequence[float]] | npt.ArrayLike,
        *,
        dims: int = 3,
        height_m: float | None = None,
        height_sigma_m: float | None = None,
        side: Side | None = None,
        area_m: Area | None = None,
        nlos: Nlos = "weigh",
    ) -> None:
        """`anchors_m` names anchors, {name: (x, y, z)}, or is an array (anchors, 3) whose rows are their names, metres.
        The other arguments are those of `Recording.track`.

        Raises ValueError for wrong shapes and numbers that are not finite.
        """
        if isinstance(anchors_m, Mapping):
            names, positions = list(anchors_m), np.array(list(anchors_m.values()), dtype=np.float64)
        else:
            positions = _matrix("anchors_m", anchors_m)
            names = list(range(len(positions)))
        self._index = {name: index for index, name in enumerate(names)}
        within = _within(dims, height_m, height_sigma_m, False, side, area_m)
        self._native = _native.Track(_matrix("anchors_m", positions), nlos, within)

    def step(
        self,
        t_s: float,
        ranges: Mapping[Any, float],
        powers_dbm: Mapping[Any, tuple[float, float]] | None = None,
    ) -> Fix:
        """Takes the ranges of one time, {anchor: metres}: a round, or a single range. Returns the position after them.

        `t_s` is the time, seconds, on any clock that does not go back. Until a track has begun, single ranges of the
        last second are used too. `powers_dbm` has the received power and the first-path power of anchors, dBm.

        Raises KeyError for an unknown anchor, ValueError for a number that is not finite.
        """
        powers = {} if powers_dbm is None else powers_dbm
        unknown = (float("nan"), float("nan"))
        rows = [(self._index[name], float(range_m), *powers.get(name, unknown)) for name, range_m in ranges.items()]
        found = self._native.step(float(t_s), rows)
        share = float(found["alternative_share"][0])
        return Fix(
            t_s=float(t_s),
            position_m=found["position_m"][0],
            sigma_m=found["sigma_m"][0],
            covariance_m2=found["covariance_m2"][0],
            velocity_m_s=found["velocity_m_s"][0],
            used=int(found["used"][0]),
            reason=found["reason"][0],
            flag=found["flag"][0],
            alternative_apart_m=None if np.isnan(share) else found["alternative_apart_m"][0],
            alternative_share=None if np.isnan(share) else share,
        )


def decode(stream: bytes | bytearray | FilePath | BinaryIO) -> Iterator[dict[str, Any]]:
    """The messages of a node's telemetry, one dictionary each, with the keys of `baliza decode`.

    `stream` is the bytes, a path (of a file, or of a folder with `telemetry.bin`) or an open binary file. Damaged bytes
    are left out; `Decoder.summary` counts them.
    """
    decoder = Decoder()
    if isinstance(stream, (bytes, bytearray)):
        yield from decoder.feed(bytes(stream))
        return
    if hasattr(stream, "read"):
        yield from _messages(decoder, stream)
        return
    path = Path(stream)
    with open(path / "telemetry.bin" if path.is_dir() else path, "rb") as file:
        yield from _messages(decoder, file)


def _messages(decoder: Decoder, file: BinaryIO) -> Iterator[dict[str, Any]]:
    while chunk := file.read(1 << 16):
        yield from decoder.feed(chunk)


def _within(
    dims: int | None,
    height_m: float | None,
    height_sigma_m: float | None,
    height_from_truth: bool,
    side: str | None,
    area_m: Area | None,
) -> dict[str, Any]:
    return {
        "dims": dims,
        "height_m": height_m,
        "height_sigma_m": height_sigma_m,
        "height_from_truth": height_from_truth,
        "side": side,
        "area_m": area_m,
    }


def _matrix(name: str, values: npt.ArrayLike) -> Floats:
    matrix = np.ascontiguousarray(np.asarray(values, dtype=np.float64))
    if matrix.ndim != 2:
        raise ValueError(f"{name}: {matrix.ndim} dimensions where 2 are expected")
    return matrix


def _rows(name: str, values: npt.ArrayLike) -> Floats:
    """A matrix; a vector is one row."""
    return _matrix(name, np.atleast_2d(np.asarray(values, dtype=np.float64)))


def _frame(columns: dict[str, Any]) -> "pandas.DataFrame":
    import pandas

    return pandas.DataFrame(columns)
