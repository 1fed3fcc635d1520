"""Cameras for pictures of faces, and where points fall in them."""

from __future__ import annotations

import numpy as np
from numba import njit

from blendcap.data import Camera, InputError

DISTANCE = 3.4  # of a portrait lens from the face, in heights of what it frames: no swollen noses
MARGIN = 0.06  # free border on each side, of the picture


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Pose (4, 4), world to camera, of an upright OpenCV camera at `eye` (3,) that looks at `target` (3,), mm."""
    eye = np.asarray(eye, dtype=np.float64)
    forward = np.asarray(target, dtype=np.float64) - eye
    forward /= np.linalg.norm(forward)
    up = (0.0, 1.0, 0.0)
    if np.linalg.norm(np.cross(forward, up)) < 1e-6:  # it looks along `up`: any other up will do
        up = (0.0, 0.0, 1.0)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    pose[:3, 3] = -pose[:3, :3] @ eye
    return pose


def face_camera(vertices: np.ndarray, size: tuple[int, int], yaw: float = 0.0, pitch: float = 0.0) -> Camera:
    """A portrait camera that frames `vertices` (V, 3), mm, in a picture of `size` (width, height) pixels.

    Parameters
    ----------
    yaw, pitch : float
        Where the camera stands, rad: `yaw` towards the subject's left, `pitch` upwards; (0, 0) is in front.
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    if not len(vertices):
        raise InputError("There are no vertices to frame; the camera needs at least one.")
    center = (vertices.min(0) + vertices.max(0)) / 2
    height = max(float(np.ptp(vertices, axis=0).max()), 1e-3)
    towards = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
    pose = look_at(center + DISTANCE * height * towards, center)
    seen = vertices @ pose[:3, :3].T + pose[:3, 3]
    slopes = seen[:, :2] / seen[:, 2:]
    low, high = slopes.min(0), slopes.max(0)
    focal = (1 - 2 * MARGIN) * float((np.array(size) / np.maximum(high - low, 1e-9)).min())
    principal = (np.array(size) - 1) / 2 - focal * (low + high) / 2
    return Camera(np.array([[focal, 0, principal[0]], [0, focal, principal[1]], [0, 0, 1.0]]), pose)


def project(points: np.ndarray, camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (..., 2) and depths (...) in mm of points (..., 3), mm, with OpenCV's distortion.

    A point behind the camera has a negative depth and no meaningful pixel.
    """
    homogeneous = to_homogeneous(points, camera)
    depth = homogeneous[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return homogeneous[..., :2] / depth[..., None], depth


def to_homogeneous(points: np.ndarray, camera: Camera) -> np.ndarray:
    """Pixels times depth, and depth (..., 3): linear in the points, also through the plane of the camera.

    Lens distortion is applied to the points, where they are in front of the camera; between them lines stay straight.
    """
    seen = np.asarray(points, dtype=np.float64) @ camera.pose[:3, :3].T + camera.pose[:3, 3]
    if camera.distortion.any():
        seen = np.ascontiguousarray(seen)
        _distort(seen.reshape(-1, 3), camera.distortion)
    return seen @ camera.intrinsics.T


def sight_lines(pixels: np.ndarray, camera: Camera) -> np.ndarray:
    """Unit vectors (..., 3) from the camera through pixels (..., 2), in the camera's world; NaN where a pixel is.

    The inverse of `project`, but for the depth.
    """
    import cv2

    if not pixels.size:
        return np.empty((*pixels.shape[:-1], 3))
    flat = np.nan_to_num(pixels).reshape(-1, 1, 2)
    slopes = cv2.undistortPoints(flat, camera.intrinsics, camera.distortion)[:, 0]
    ways = np.column_stack([slopes, np.ones(len(slopes))]) @ camera.pose[:3, :3]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    ways[np.isnan(pixels).any(-1).ravel()] = np.nan
    return ways.reshape(*pixels.shape[:-1], 3)


@njit(cache=True, nogil=True)
def _distort(seen, distortion):
    """Move points (P, 3) before the camera, in place, to where a straight lens would have them."""
    k1, k2, p1, p2, k3 = distortion
    for row in range(len(seen)):
        depth = seen[row, 2]
        if depth > 0:
            x, y = seen[row, 0] / depth, seen[row, 1] / depth
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
            seen[row, 0] = (x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)) * depth
            seen[row, 1] = (y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y) * depth
