"""Pictures of scenes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._scene import Scene


def camera_rays(
    scene: Scene,
    width: int = 512,
    height: int = 512,
    *,
    eye: Any = None,
    target: Any = None,
    up: Any = (0.0, 1.0, 0.0),
    fov: float = 40.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Origin and directions of the rays through the pixels of a picture, row by row from the top left.

    Without ``eye`` the camera sees the whole scene from the front, the right and a little above.
    """
    low, high = scene.mesh.bounds
    target = np.asarray((low + high) / 2 if target is None else target, dtype=np.float64)
    if eye is None:
        # As far away as the ball around the scene fits the picture.
        radius = max(np.linalg.norm(high - low) / 2, 1e-30)
        narrow = min(1.0, width / height) * np.tan(np.radians(fov) / 2)
        eye = target + np.array([0.32, 0.23, 0.92]) * (radius * np.sqrt(1 + narrow**-2))
    eye = np.asarray(eye, dtype=np.float64)
    forward = _unit(target - eye)
    right = np.cross(forward, np.asarray(up, dtype=np.float64))
    if np.linalg.norm(right) < 1e-9:
        right = np.cross(forward, [0.0, 0.0, 1.0] if abs(forward[2]) < 0.9 else [1.0, 0.0, 0.0])
    right = _unit(right)
    above = np.cross(right, forward)
    tall = np.tan(np.radians(fov) / 2)
    across = ((np.arange(width) + 0.5) / width * 2 - 1) * tall * width / height
    down = (1 - (np.arange(height) + 0.5) / height * 2) * tall
    directions = forward + across[None, :, None] * right + down[:, None, None] * above
    return eye, directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def render(scene: Scene, width: int = 512, height: int = 512, **camera: Any) -> np.ndarray:
    """A picture of the scene, lit from the camera, as an array of shape ``(height, width, 3)`` of ``uint8``.

    ``camera`` is what ``camera_rays`` takes: ``eye``, ``target``, ``up``, ``fov``.

    >>> from raykd import Mesh
    >>> render(Scene(Mesh.teapot(4), device="cpu"), 32, 24).shape
    (24, 32, 3)
    """
    origin, directions = camera_rays(scene, width, height, **camera)
    hits = scene.closest(origin, directions)
    mesh, hit = scene.mesh, hits.is_hit
    corners = mesh.vertices[mesh.faces[hits.triangle[hit]]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    light = np.abs(np.einsum("ij,ij->i", normals, directions[hit]))
    picture = np.full((height, width, 3), 255, dtype=np.uint8)
    picture[hit] = (np.array([214, 196, 160]) * (0.15 + 0.85 * light[:, None])).astype(np.uint8)
    return picture


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)
