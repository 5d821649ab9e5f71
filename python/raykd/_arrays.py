"""Arrays that people have, as the compiled module takes them, and answers as arrays."""

from __future__ import annotations

import operator
import os
import warnings
from typing import Any, Iterator, NamedTuple

import numpy as np

from . import _raykd


def on_host(array: Any) -> np.ndarray:
    """The array in this machine's memory; one on a GPU is copied, with a warning."""
    if type(array) is np.ndarray:
        return array
    if np.ma.is_masked(array):
        raise ValueError("an array has masked elements; fill them first, by filled(), or leave them out")
    where = getattr(array, "__dlpack_device__", None)
    # 1 is the CPU, 3 memory of the host that a GPU sees, too.
    on_gpu = hasattr(array, "__cuda_array_interface__") or (where is not None and where()[0] not in (1, 3))
    if not on_gpu:
        dlpack_alone = where is not None and not hasattr(array, "__array__")
        return np.from_dlpack(array) if dlpack_alone else np.asarray(array)
    for way in ("cpu", "get", "copy_to_host"):
        copy = getattr(array, way, None)
        if copy is not None:
            warnings.warn("an array on a GPU is copied to the host, and to the GPU again", stacklevel=4)
            return np.asarray(copy())
    raise ValueError("an array on a GPU has neither cpu(), get() nor copy_to_host(); copy it to the host first")


def numbers(array: Any, name: str) -> np.ndarray:
    """The array as float32 if it is that, else as float64."""
    array = on_host(array)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"{name} must be numbers, but are {array.dtype}")
    kept: np.ndarray = array if array.dtype == np.float32 else array.astype(np.float64, copy=False)
    return kept


def points(array: Any, name: str = "points") -> tuple[np.ndarray, tuple[int, ...]]:
    """Points in rows, and the shape of what they were."""
    array = numbers(array, name)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"{name} must be of shape (..., 3), but are of shape {array.shape}")
    return rows(array, array.shape[:-1], 3), array.shape[:-1]


def rows(array: np.ndarray, shape: tuple[int, ...], width: int) -> np.ndarray:
    """The array broadcast, in rows of so many numbers, without a copy where it can be."""
    return plain(np.broadcast_to(array, (*shape, width))).reshape(-1, width)


def plain(array: np.ndarray) -> np.ndarray:
    """The array as compiled code can read it: in order, and aligned, which those from a file's bytes may not be."""
    array = np.ascontiguousarray(array)
    return array if array.flags.aligned else array.copy()


def whole(number: Any, name: str, least: int, most: int) -> int:
    """The whole number, if it is in range."""
    try:
        taken: int = operator.index(number)
    except TypeError:
        raise TypeError(f"{name} must be a whole number, but is {number!r}") from None
    if not least <= taken <= most:
        raise ValueError(f"{name} must be from {least} to {most}, but is {taken}")
    return taken


def text(given: Any, name: str) -> str:
    """What is given, if it is text."""
    if not isinstance(given, str):
        raise TypeError(f"{name} must be a str, but is {given!r}")
    return given


class Rays(NamedTuple):
    """Rays as the compiled module takes them."""

    origins: np.ndarray
    directions: np.ndarray
    t_min: np.ndarray
    t_max: np.ndarray


def rays(origins: Any, directions: Any, t_min: Any, t_max: Any) -> tuple[Rays, tuple[int, ...]]:
    """The rays in rows, and their shape."""
    o, d = numbers(origins, "origins"), numbers(directions, "directions")
    for array, name in ((o, "origins"), (d, "directions")):
        if array.ndim == 0 or array.shape[-1] != 3:
            raise ValueError(f"{name} must be of shape (..., 3), but are of shape {array.shape}")
    # Numbers for all rays do not make them float64.
    limits = [on_host(t_min), on_host(t_max)]
    for limit, name in zip(limits, ("t_min", "t_max")):
        if limit.dtype.kind not in "fiu":
            raise ValueError(f"{name} must be numbers, but are {limit.dtype}")
    wide = o.dtype == np.float64 or d.dtype == np.float64
    wide = wide or any(limit.ndim > 0 and limit.dtype != np.float32 for limit in limits)
    kind = np.float64 if wide else np.float32
    try:
        shape = np.broadcast_shapes(o.shape[:-1], d.shape[:-1], *(limit.shape for limit in limits))
    except ValueError:
        shapes = [o.shape[:-1], d.shape[:-1], *(limit.shape for limit in limits)]
        raise ValueError(f"origins, directions, t_min and t_max do not go together: they are of {shapes}") from None
    # A limit beyond what float32 has, such as the largest float64, is none.
    with np.errstate(over="ignore", under="ignore"):
        limits = [limit.astype(kind) for limit in limits]
    each = [
        limit.reshape(1) if limit.ndim == 0 else rows(limit[..., None], shape, 1).reshape(-1) for limit in limits
    ]
    o, d = (rows(array.astype(kind, copy=False), shape, 3) for array in (o, d))
    return Rays(o, d, each[0], each[1]), shape


def file_name(path: Any) -> str:
    """The path as text, from which the compiled module makes the same bytes again."""
    return os.fsdecode(os.fsencode(path))


def triangles(array: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Triangle numbers, one a ray."""
    array = on_host(array)
    # A list of none is float64.
    if array.size and (array.dtype.kind not in "iu" or array.min() < 0 or array.max() > _raykd.MISS):
        raise ValueError("exclude must be triangle numbers, raykd.MISS for none")
    try:
        wide = np.broadcast_to(array, shape)
    except ValueError:
        raise ValueError(f"exclude and the rays do not go together: they are of {[array.shape, shape]}") from None
    return plain(wide.astype(np.uint32, copy=False)).reshape(-1)


class Hits:
    """What rays hit: of each the triangle, where on the ray, and where on the triangle.

    ``records``, which ``np.asarray(hits)`` gives, is a structured array, of type ``RECORD``: ``triangle``, ``t``, ``u``
    and ``v``, which are also attributes. Of a miss the triangle is ``raykd.MISS``, which no array of triangles has a
    place for, and ``t`` is infinite. The point hit is ``(1 - u - v) * a + u * b + v * c`` for the triangle's corners.
    ``invalid`` counts invalid rays; of a part of hits, such as ``hits[:5]``, it is not known, and 0.
    """

    RECORD = np.dtype([("triangle", "<u4"), ("t", "<f4"), ("u", "<f4"), ("v", "<f4")])

    __slots__ = ("invalid", "records")

    def __init__(self, records: np.ndarray, invalid: int = 0) -> None:
        if records.dtype != self.RECORD:
            raise TypeError(
                f"hits are records of type Hits.RECORD, but {records.dtype} is given; their fields are attributes, such"
                " as hits.t"
            )
        self.records = records
        self.invalid = invalid

    @classmethod
    def _of(cls, words: np.ndarray, shape: tuple[int, ...], invalid: int) -> Hits:
        return cls(words.view(cls.RECORD).reshape(shape), invalid)

    @property
    def triangle(self) -> np.ndarray:
        """Numbers of triangles."""
        return self.records["triangle"]

    @property
    def t(self) -> np.ndarray:
        """Distances in lengths of the direction."""
        return self.records["t"]

    @property
    def u(self) -> np.ndarray:
        """Weights of the triangles' second corners."""
        return self.records["u"]

    @property
    def v(self) -> np.ndarray:
        """Weights of the triangles' third corners."""
        return self.records["v"]

    @property
    def is_hit(self) -> np.ndarray:
        """Which rays hit something."""
        hit: np.ndarray = self.triangle != _raykd.MISS
        return hit

    def digest(self) -> str:
        """SHA-256 of the hits, the same on every machine, as the program ``raykd`` prints it."""
        return _raykd.digest(plain(np.ascontiguousarray(self.records).reshape(-1).view(np.uint32)))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.records, dtype=dtype) if copy else np.asarray(self.records, dtype=dtype)

    def __len__(self) -> int:
        return len(self.records)

    def __iter__(self) -> Iterator[Hits]:
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, index: Any) -> Hits:
        return Hits(self.records[index])

    def __repr__(self) -> str:
        return f"Hits(shape={self.records.shape}, hit={int(self.is_hit.sum())}, invalid={self.invalid})"


class AllHits(NamedTuple):
    """All hits of rays, ray by ray, of each by rising ``t``: ``ray[i]`` is the ray of hit ``i``, counted as in a flat
    array; ray ``r`` has the hits from ``begin[r]`` to ``begin[r + 1]``."""

    ray: np.ndarray
    hits: Hits
    begin: np.ndarray


class Crossings(NamedTuple):
    """How often rays leave through the surface, how often they enter, and how many were invalid."""

    leaving: np.ndarray
    entering: np.ndarray
    invalid: int


class Steps(NamedTuple):
    """What the closest hits of rays took: inner nodes, leaves and triangle tests."""

    inner: np.ndarray
    leaves: np.ndarray
    tests: np.ndarray
