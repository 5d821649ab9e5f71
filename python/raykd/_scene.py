"""Meshes and scenes."""

from __future__ import annotations

import os
import warnings
from typing import Any, Optional, Tuple, Union

import numpy as np

from . import _raykd
from . import _arrays
from ._arrays import AllHits, Crossings, Hits, Steps, file_name, on_host, plain, rays, text, triangles, whole

_Device = Tuple[str, Optional[int]]
_Path = Union[str, bytes, "os.PathLike[str]", "os.PathLike[bytes]"]


class Mesh:
    """Triangles that have been checked: three indices each of ``vertices``.

    What cannot be used is refused (``ValueError``); what is set aside or changed is counted in ``repairs``.

    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> len(mesh), mesh.is_closed
    (1, False)
    """

    __slots__ = ("__weakref__", "_closed", "_mesh")

    def __init__(self, vertices: Any, faces: Any) -> None:
        vertices, _ = _arrays.points(vertices, "vertices")
        faces = on_host(faces)
        if faces.ndim != 2 or faces.shape[1] != 3:
            raise ValueError(f"faces must be of shape (n, 3), but are of shape {faces.shape}")
        if faces.dtype.kind not in "iu" and faces.size:
            raise ValueError(f"faces must be integers, but are {faces.dtype}")
        if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
            raise ValueError(f"faces name vertices from {faces.min()} to {faces.max()}, but there are {len(vertices)}")
        self._become(_raykd.Mesh(vertices, plain(faces.astype(np.uint32, copy=False))))

    def _become(self, mesh: _raykd.Mesh) -> Mesh:
        self._mesh = mesh
        self._closed: bool | None = None
        return self

    @classmethod
    def _of(cls, mesh: _raykd.Mesh) -> Mesh:
        return cls.__new__(cls)._become(mesh)

    @classmethod
    def load(cls, path: _Path, *, max_bytes: int | None = None) -> Mesh:
        """Reads an OBJ, PLY, STL or glTF file, each of them also gzipped.

        If it has more than ``max_bytes``, packed or unpacked, that is an error. Left out, the memory there is sets the
        limit, and a gzipped file may have a hundred times its size, or 256 MiB if that is more.
        """
        most = None if max_bytes is None else whole(max_bytes, "max_bytes", 0, 2**64 - 1)
        return cls._of(_raykd.Mesh.load(file_name(path), most))

    @classmethod
    def scene(cls, name: str) -> Mesh:
        """A scene by the name that the program has for it, or a file: ``teapot:8``, ``dragon``, ``sponza``."""
        return cls._of(_raykd.Mesh.scene(text(name, "name")))

    @classmethod
    def teapot(cls, level: int = 8) -> Mesh:
        """The Utah teapot, each of its 32 patches cut into ``level`` by ``level`` quads (1 to 1000)."""
        return cls.scene(f"teapot:{whole(level, 'level', 1, 1000)}")

    @property
    def vertices(self) -> np.ndarray:
        """Vertices as they are traced, in the mesh's own coordinates, as float64; but what ``repairs`` counts as
        ``flushed`` is traced as 0. It is a copy, as that of ``faces`` is: a mesh does not change."""
        return self._mesh.vertices()

    @property
    def faces(self) -> np.ndarray:
        """Three indices of vertices each."""
        return self._mesh.faces()

    @property
    def bounds(self) -> np.ndarray:
        """Lower and upper corner of the box around what is traced."""
        return np.array(self._mesh.bounds)

    @property
    def repairs(self) -> dict[str, float]:
        """How many triangles have no area (``zero_area``), so that no ray hits them, and how many of those lost it by
        rounding (``collapsed``); how many are ``duplicates``, which are hit all the same; how many coordinates were
        ``rounded``, and the ``largest_change``; how many coordinates are so small that they are traced as 0
        (``flushed``). A mesh from a pickle or a scene's file has been rounded before."""
        return self._mesh.repairs()

    @property
    def is_closed(self) -> bool:
        """Whether at every edge as many triangles go one way as the other, so that points are inside or outside."""
        if self._closed is None:
            self._closed = self._mesh.is_closed()
        return self._closed

    def __len__(self) -> int:
        return len(self._mesh)

    def __reduce__(self) -> tuple[Any, ...]:
        # Not the vertices: where rounding took the last digits, a mesh of them might be moved elsewhere, or not at all.
        return _moved, (self._mesh.positions(), self.faces, self._mesh.translation)

    def __repr__(self) -> str:
        return f"Mesh({len(self)} triangles)"


class Scene:
    """A mesh and its tree on a device, ready for rays.

    ``vertices`` and ``faces`` are arrays; or the first is a ``Mesh``, or any object that has ``vertices`` and
    ``faces``, such as a ``trimesh.Trimesh``. ``device`` is ``auto`` (a real GPU if there is one, else the CPU),
    ``cpu``, ``gpu``, ``gpu:1`` (by its number, see ``raykd.devices()``) or a part of an adapter's name; ``threads`` are
    those of the CPU. ``builder`` is one of ``raykd.BUILDERS`` (left out: binned), ``traversal`` of
    ``raykd.TRAVERSALS`` (left out: stack) and ``test`` of ``raykd.TESTS``; ``build`` takes what the Rust library calls
    ``BuildOptions``: ``cost_step``, ``cost_test``, ``price``, ``long``, ``budget``, ``empty``, ``max_depth``, ``clip``.

    With ``quality="auto"`` builder, traversal and build options are those that take the least time for this mesh and
    so many ``rays`` (left out: a million); with ``device="auto"`` the device, too. A tree is always built, as a scene
    answers all queries. ``plan`` tells what was chosen. That needs what trees cost on the device: ``costs`` names a
    file that ``raykd calibrate -o`` wrote. Left out, they are taken from the cache that the program has, too, or
    measured once, with a warning, and kept there.

    Closest hits do not depend on device, threads, builder and traversal. Scenes may be used by several threads at once;
    the interpreter's lock is released while rays are traced.

    >>> scene = Scene([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], device="cpu")
    >>> scene.closest([[0.25, 0.25, 1], [2, 2, 1]], [0, 0, -1]).t.tolist()
    [1.0, inf]
    """

    __slots__ = ("__weakref__", "_device", "_file", "_mesh", "_scene")

    def __init__(
        self,
        vertices: Any,
        faces: Any = None,
        *,
        device: str = "auto",
        threads: int | None = None,
        builder: str | None = None,
        traversal: str | None = None,
        test: str = "strict",
        quality: str = "usual",
        rays: int | None = None,
        costs: _Path | None = None,
        **build: float | bool,
    ) -> None:
        if faces is not None:
            mesh = Mesh(vertices, faces)
        elif isinstance(vertices, Mesh):
            mesh = vertices
        elif hasattr(vertices, "vertices") and hasattr(vertices, "faces"):
            mesh = Mesh(vertices.vertices, vertices.faces)
        else:
            raise TypeError(
                f"a scene is of vertices and faces, or of what has both, but {type(vertices).__name__} alone is given;"
                " files are read by raykd.Mesh.load, and by raykd.load if Scene.save wrote them"
            )
        self._device = _on(device, threads)
        self._mesh: Mesh | None = mesh
        self._file: str | None = None
        test = text(test, "test")
        given = build if builder is None else {"builder": builder, **build}
        if quality == "usual":
            if rays is not None or costs is not None:
                raise ValueError('rays and costs are for quality="auto"')
            ways = ("stack" if traversal is None else text(traversal, "traversal"), test)
            self._scene = _raykd.Scene(mesh._mesh, self._device, ways, None, given)
        elif quality == "auto":
            if given or traversal is not None:
                raise ValueError('quality="auto" chooses builder, traversal and build options: leave them out')
            count = whole(1_000_000 if rays is None else rays, "rays", 1, 2**64 - 1)
            file = None if costs is None else file_name(costs)
            self._scene = _raykd.Scene.planned(mesh._mesh, self._device, test, count, file)
            if self._scene.device[0] == "cpu":
                # What is unpickled stays there.
                self._device = ("cpu", threads)
        else:
            raise ValueError(f"quality {quality!r} is none of usual, auto")

    @classmethod
    def _of(cls, scene: _raykd.Scene, device: _Device, file: str | None = None, mesh: Mesh | None = None) -> Scene:
        made = cls.__new__(cls)
        made._scene, made._device, made._file, made._mesh = scene, device, file, mesh
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        ways = (self._scene.traversal, self._scene.test)
        if self._file is not None:
            return _from_file, (self._file, self._device, ways)
        return _with_tree, (self.mesh, self._scene.tree(), self._device, ways)

    def save(self, path: _Path) -> None:
        """Writes mesh and tree to one file, for ``raykd.load``. It appears whole or not at all."""
        self._scene.save(file_name(path))

    def using(self, *, traversal: str | None = None, test: str | None = None) -> Scene:
        """The same scene with another traversal or triangle test; both share all memory."""
        ways = (
            self._scene.traversal if traversal is None else text(traversal, "traversal"),
            self._scene.test if test is None else text(test, "test"),
        )
        return Scene._of(self._scene.using(*ways), self._device, self._file, self._mesh)

    def closest(
        self, origins: Any, directions: Any, t_min: Any = 0.0, t_max: Any = np.inf, *, exclude: Any = None
    ) -> Hits:
        """The closest hit of every ray; of hits as far away, that of the triangle with the lowest number.

        ``exclude`` leaves out a triangle for each ray, by number: the one that it starts on.
        """
        return self._trace(False, origins, directions, t_min, t_max, exclude)

    def any(
        self, origins: Any, directions: Any, t_min: Any = 0.0, t_max: Any = np.inf, *, exclude: Any = None
    ) -> np.ndarray:
        """Whether each ray hits something: faster than ``closest``, and enough for shadows."""
        return self._trace(True, origins, directions, t_min, t_max, exclude).is_hit

    def _trace(self, any_hit: bool, origins: Any, directions: Any, t_min: Any, t_max: Any, exclude: Any) -> Hits:
        some, shape = rays(origins, directions, t_min, t_max)
        left_out = None if exclude is None else triangles(exclude, shape)
        words, invalid = self._scene.trace(any_hit, some, left_out)
        return Hits._of(words, shape, invalid)

    def all(
        self, origins: Any, directions: Any, t_min: Any = 0.0, t_max: Any = np.inf, *, limit: int | None = None
    ) -> AllHits:
        """All hits of every ray by rising ``t``, each triangle once; at most ``limit`` of a ray.

        >>> scene = Scene(Mesh.teapot(2), device="cpu")
        >>> every = scene.all([0, 0, 50], [0, 0, -1])
        >>> bool((np.diff(every.hits.t) >= 0).all()), bool(scene.count([0, 0, 50], [0, 0, -1]) == len(every.hits))
        (True, True)
        """
        some, _ = rays(origins, directions, t_min, t_max)
        if limit is not None:
            limit = whole(limit, "limit", 0, 2**32 - 1)
        begin, words, invalid = self._scene.all(some, limit)
        begin = begin.astype(np.int64)
        ray = np.repeat(np.arange(len(begin) - 1), np.diff(begin))
        return AllHits(ray, Hits._of(words, (-1,), invalid), begin)

    def count(self, origins: Any, directions: Any, t_min: Any = 0.0, t_max: Any = np.inf) -> np.ndarray:
        """How many triangles each ray hits. At an edge it may be two: ``crossings`` counts a surface once."""
        some, shape = rays(origins, directions, t_min, t_max)
        return self._scene.count(some)[0].reshape(shape)

    def crossings(self, origins: Any, directions: Any, t_min: Any = 0.0, t_max: Any = np.inf) -> Crossings:
        """How often each ray leaves and enters through the surface, exactly, each crossing once, also at an edge or a
        vertex."""
        some, shape = rays(origins, directions, t_min, t_max)
        leaving, entering, invalid = self._scene.crossings(some)
        return Crossings(leaving.reshape(shape), entering.reshape(shape), invalid)

    def winding(self, points: Any) -> np.ndarray:
        """How often the surface goes round each point: 0 outside, 1 inside, if triangles are counterclockwise seen from
        outside. Points on the surface are on one side of it, always the same. Only of closed meshes is this certain.
        Points with NaN or an infinite number are outside.
        """
        where, shape = _arrays.points(points)
        return self._scene.winding(where)[0].reshape(shape)

    def inside(self, points: Any) -> np.ndarray:
        """Which points are inside: those whose winding number is not 0. Warns if the mesh is not closed.

        >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
        >>> scene = Scene(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], device="cpu")
        >>> scene.inside([[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]]).tolist()
        [True, False]
        """
        if not self.mesh.is_closed:
            warnings.warn("the mesh is not closed, so inside is not certain", stacklevel=2)
        inside: np.ndarray = self.winding(points) != 0
        return inside

    def steps(self, origins: Any, directions: Any, t_min: Any = 0.0, t_max: Any = np.inf) -> Steps:
        """What the closest hit of each ray takes: inner nodes, leaves and triangle tests."""
        some, shape = rays(origins, directions, t_min, t_max)
        return Steps(*(count.reshape(shape) for count in self._scene.steps(some)))

    @property
    def mesh(self) -> Mesh:
        """The mesh of which the scene was built."""
        # Kept, as it knows whether it is closed once it has been asked.
        if self._mesh is None:
            self._mesh = Mesh._of(self._scene.mesh)
        return self._mesh

    @property
    def device(self) -> str:
        """The name of the device."""
        return self._scene.device[1]

    @property
    def plan(self) -> dict[str, Any] | None:
        """What ``quality="auto"`` chose, for how many rays, and the seconds it predicted: to build, and in all."""
        return self._scene.plan()

    @property
    def tree(self) -> dict[str, Any]:
        """The tree's digest, nodes, references and bytes, and how long the build took."""
        return self._scene.about()

    def __repr__(self) -> str:
        return f"Scene({self.mesh!r}, {self.device!r})"


def load(path: _Path, *, device: str = "auto", threads: int | None = None) -> Scene:
    """A scene that ``Scene.save`` wrote. Nothing is built again.

    On the CPU the file is mapped into memory: processes that load it share that memory. Do not change the file while
    it is in use; to save another scene to its place is safe. A pickle of the scene holds the file's path alone.

    >>> import tempfile
    >>> path = os.path.join(tempfile.mkdtemp(), "teapot.scene")
    >>> Scene(Mesh.teapot(2), device="cpu").save(path)
    >>> bool(load(path, device="cpu").any([0, 0, 50], [0, 0, -1]))
    True
    """
    file, on = os.path.abspath(file_name(path)), _on(device, threads)
    return Scene._of(_raykd.Scene.load(file, on), on, file)


def _on(device: str, threads: int | None) -> _Device:
    """The device, with as many threads as the program takes, too: of more most only look for work."""
    most = min(64 * (os.cpu_count() or 1), 4096)
    return text(device, "device"), None if threads is None else whole(threads, "threads", 1, most)


def _moved(positions: np.ndarray, faces: np.ndarray, translation: list[float]) -> Mesh:
    """A pickled mesh."""
    return Mesh._of(_raykd.Mesh.moved(positions, faces, translation))


def _from_file(file: str, device: _Device, ways: tuple[str, str]) -> Scene:
    """A pickled scene that lies in a file."""
    return Scene._of(_raykd.Scene.load(file, device).using(*ways), device, file)


def _with_tree(mesh: Mesh, tree: bytes, device: _Device, ways: tuple[str, str]) -> Scene:
    """A pickled scene, whose tree is not built again."""
    return Scene._of(_raykd.Scene(mesh._mesh, device, ways, tree, {}), device, None, mesh)
