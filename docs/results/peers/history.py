"""History for a renderer without one: frames before this one, reprojected by their own positions and averaged.

What a renderer can do with its own images alone: light is divided by albedo, so that textures stay sharp, found again by
bilinear taps on the same surface in the frame before, and averaged over at most `LONGEST` frames. Only the camera may
move.
"""

import numpy as np

LONGEST = 16

# Least albedo that light is divided by.
LEAST_ALBEDO = 0.01
# A tap shows the same surface if its distance from the pixel's plane, by that of the eye, the angle between normals and
# the difference of albedos are small. Albedo tells lamps from walls.
NEAR, ALIGNED, ALIKE = 0.005, 0.9, 0.1


class Camera:
    """A pinhole camera that looks from `position` to `target`, with square pixels."""

    def __init__(self, position, target, up, yfov_deg):
        self.position = np.asarray(position)
        self.ahead = normalized(np.asarray(target) - position)
        self.right = normalized(np.cross(self.ahead, up))
        self.up = np.cross(self.right, self.ahead)
        self.half = np.tan(np.radians(yfov_deg) / 2)

    def pixels(self, points, width, height):
        """Column and row of points, 0 at the centre of the first pixel, and their depths."""
        seen = points - self.position
        depth = seen @ self.ahead
        scale = height / 2 / (self.half * np.maximum(depth, 1e-9))
        return seen @ self.right * scale + width / 2 - 0.5, height / 2 - 0.5 - seen @ self.up * scale, depth


def normalized(v):
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-30)


class History:
    """The history of one eye."""

    def __init__(self):
        self.last = None

    def add(self, camera, color, albedo, normal, position):
        """The mean of this frame's colour and that of frames before it. Images are (height, width, 3), in world space."""
        height, width = color.shape[:2]
        divisor = np.maximum(albedo, LEAST_ALBEDO)
        light, count = color / divisor, np.ones((height, width), np.float32)
        if self.last:
            past, frames, found = self.past(camera, albedo, normal, position)
            count += np.where(found, np.minimum(frames, LONGEST - 1), 0)
            light = np.where(found[..., None], past + (light - past) / count[..., None], light)
        self.last = camera, light, count, albedo, normal, position
        return light * divisor

    def past(self, camera, albedo, normal, position):
        """Light and number of frames of each pixel's surface in the frame before, and whether that frame shows it."""
        before, lights, counts, albedos, normals, positions = self.last
        height, width = counts.shape
        x, y, depth = before.pixels(position, width, height)
        # Points that the frame before does not show fail here, and those without a surface below.
        inside = (depth > 0) & (x > -1) & (x < width) & (y > -1) & (y < height)
        x, y = np.where(inside, x, 0), np.where(inside, y, 0)
        left, top = np.floor(x).astype(int), np.floor(y).astype(int)
        tolerance = NEAR * np.linalg.norm(position - camera.position, axis=-1)
        light, frames, weights = np.zeros_like(lights), np.zeros_like(counts), np.zeros_like(counts)
        for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
            column, row = left + dx, top + dy
            exists = inside & (column >= 0) & (column < width) & (row >= 0) & (row < height)
            tap = np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)
            off = np.abs(((positions[tap] - position) * normal).sum(axis=-1))
            same = exists & (off < tolerance) & ((normals[tap] * normal).sum(axis=-1) > ALIGNED)
            same &= np.abs(albedos[tap] - albedo).max(axis=-1) < ALIKE
            weight = np.where(same, (1 - np.abs(x - column)) * (1 - np.abs(y - row)), 0).astype(np.float32)
            light += weight[..., None] * lights[tap]
            frames += weight * counts[tap]
            weights += weight
        found = weights > 0.01
        scale = 1 / np.where(found, weights, 1)
        return light * scale[..., None], frames * scale, found
