"""Forces and loads on the faces of the canopy."""

import numpy as np


class Surface:
    """Faces `[faces][4]` of a canopy with `nodes` nodes; a triangle repeats its last node."""

    def __init__(self, faces, nodes):
        self.faces, self.nodes = np.asarray(faces), nodes
        self.corners = np.where(self.faces[:, 2] == self.faces[:, 3], 3, 4)

    def centres(self, x):
        """Means of the corners of each face, `[faces][3]`, m."""
        fourth = np.where(self.corners == 4, 1.0, 0.0)[:, None] * x[self.faces[:, 3]]
        return (x[self.faces[:, :3]].sum(axis=1) + fourth) / self.corners[:, None]

    def triangles(self):
        """Node numbers of triangles that cover the faces, `[..][3]`."""
        quads = self.faces[self.corners == 4]
        return np.concatenate([self.faces[:, :3], quads[:, [0, 2, 3]]])

    def areas(self, x):
        """Area vectors of the faces, `[faces][3]`, m2."""
        a, b, c, d = (x[self.faces[:, k]] for k in range(4))
        return 0.5 * np.cross(c - a, d - b)

    def forces(self, x, load):
        """Forces of a load `[faces][4]` (pressure jump, traction; Pa) on the faces, `[faces][3]`, N."""
        area = self.areas(x)
        return load[:, :1] * area + load[:, 1:] * np.linalg.norm(area, axis=1)[:, None]

    def nodal(self, forces):
        """Forces on the nodes, `[nodes][3]`, N: each corner of a face has an equal part."""
        part, out = forces / self.corners[:, None], np.zeros((self.nodes, 3))
        for k in range(4):
            real = self.corners > k
            np.add.at(out, self.faces[real, k], part[real])
        return out

    def load(self, x, forces):
        """The load `[faces][4]`, Pa, with given forces on the faces, N."""
        area = self.areas(x)
        size = np.linalg.norm(area, axis=1)[:, None]
        jump = np.sum(forces * area, axis=1, keepdims=True) / size**2
        return np.hstack([jump, forces / size - jump * area / size])
