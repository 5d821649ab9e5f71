"""Ray queries for trimesh, exact: in place of ``trimesh.ray.ray_pyembree.RayMeshIntersector``.

    >>> import trimesh, raykd.trimesh
    >>> mesh = trimesh.creation.box()
    >>> mesh.ray = raykd.trimesh.RayMeshIntersector(mesh)
    >>> mesh.ray.intersects_any([[0, 0, 5]], [[0, 0, -1]]).tolist(), mesh.contains([[0, 0, 0]]).tolist()
    ([True], [True])
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ._scene import Mesh, Scene


class RayMeshIntersector:
    """Answers what trimesh asks of rays, by the same arguments, in arrays of the same shapes and order.

    Hits are exact. So a ray through an edge or a vertex hits there once, and a ray that starts on the surface hits
    where it starts. Of triangles hit at one ``t`` the one with the lowest number counts. As ``t`` is ``float32``, one
    of two layers is left out where they are nearer to each other than it can tell.

    ``scale_to_box`` is taken for the sake of trimesh; there is nothing to scale. ``options`` are those of
    ``raykd.Scene``.
    """

    def __init__(self, mesh: Any, scale_to_box: bool = True, **options: Any) -> None:
        self.mesh = mesh
        self._options = {"test": "exact", **options}
        self._built: tuple[Any, Scene] | None = None

    @property
    def scene(self) -> Scene:
        """The scene of the mesh as it is now."""
        state = hash(self.mesh)
        if self._built is None or self._built[0] != state:
            self._built = (state, Scene(Mesh(self.mesh.vertices, self.mesh.faces), **self._options))
        return self._built[1]

    def intersects_id(
        self,
        ray_origins: Any,
        ray_directions: Any,
        multiple_hits: bool = True,
        max_hits: int = 100,
        return_locations: bool = False,
    ) -> tuple[np.ndarray, ...]:
        """Numbers of the triangles hit and of their rays, all first hits before all second ones, and so on; and if
        asked for where, as float64."""
        origins, directions = _rays(ray_origins, ray_directions)
        if multiple_hits:
            found = self.scene.all(origins, directions)
            first = np.ones(len(found.ray), dtype=bool)
            first[1:] = (np.diff(found.ray) != 0) | (np.diff(found.hits.t) != 0)
            ray, triangle = found.ray[first], found.hits.triangle[first].astype(np.int64)
            # The how manieth hit of its ray each is.
            depth = np.arange(len(ray)) - np.searchsorted(ray, ray)
            order = np.argsort(depth, kind="stable")
            order = order[depth[order] < max_hits]
            ray, triangle = ray[order], triangle[order]
        else:
            first_hits = self.intersects_first(origins, directions)
            ray = np.flatnonzero(first_hits != -1)
            triangle = first_hits[ray]
        if return_locations:
            return triangle, ray, self._locations(triangle, origins[ray], directions[ray])
        return triangle, ray

    def intersects_location(
        self, ray_origins: Any, ray_directions: Any, multiple_hits: bool = True
    ) -> tuple[np.ndarray, ...]:
        """Where rays hit, as float64, and the numbers of the rays and of the triangles."""
        triangle, ray, locations = self.intersects_id(
            ray_origins, ray_directions, multiple_hits=multiple_hits, return_locations=True
        )
        return locations, ray, triangle

    def intersects_first(self, ray_origins: Any, ray_directions: Any) -> np.ndarray:
        """The number of the first triangle that each ray hits, or -1."""
        hits = self.scene.closest(*_rays(ray_origins, ray_directions))
        return np.where(hits.is_hit, hits.triangle.astype(np.int64), -1)

    def intersects_any(self, ray_origins: Any, ray_directions: Any) -> np.ndarray:
        """Whether each ray hits something."""
        return self.scene.any(*_rays(ray_origins, ray_directions))

    def contains_points(self, points: Any) -> np.ndarray:
        """Which points are inside.

        Of a closed mesh, those that the surface goes round; of another, those whose rays up and down both cross it an
        odd number of times.
        """
        points = np.asarray(points, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ValueError(f"points must be of shape (n, 3), but are of shape {points.shape}")
        if self.scene.mesh.is_closed:
            inside: np.ndarray = self.scene.winding(points) != 0
            return inside
        odd = []
        for direction in ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]):
            crossed = self.scene.crossings(points, direction)
            odd.append((crossed.leaving + crossed.entering) % 2 == 1)
        both: np.ndarray = odd[0] & odd[1]
        return both

    def _locations(self, triangle: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Where lines meet the planes of triangles, to the digits of float64."""
        corners = np.asarray(self.mesh.vertices, dtype=np.float64)[self.mesh.faces[triangle]]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        along = np.einsum("ij,ij->i", normals, directions)
        t = np.einsum("ij,ij->i", normals, corners[:, 0] - origins) / along
        locations: np.ndarray = origins + t[:, None] * directions
        return locations

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_built": None}

    def __copy__(self) -> RayMeshIntersector:
        return RayMeshIntersector(self.mesh, **self._options)

    def __deepcopy__(self, memo: Any) -> RayMeshIntersector:
        return self.__copy__()


def _rays(origins: Any, directions: Any) -> tuple[np.ndarray, np.ndarray]:
    origins, directions = np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
    if origins.shape != directions.shape or origins.ndim != 2 or origins.shape[1] != 3:
        raise ValueError(
            f"origins and directions must both be of shape (n, 3), but are of {origins.shape} and {directions.shape}"
        )
    return origins, directions
