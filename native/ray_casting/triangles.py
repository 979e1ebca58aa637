"""The triangles of an isosurface, as `render` draws them: marching cubes with normals from central differences."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.words import one_line
from native.ray_casting.fields import SampledField

# Triangles in a cell (Lorensen & Cline 1987, "Marching cubes"), cut as VTK cuts them, by which corners lie above: bit x + 2 y + 4 z
# of the place in this list.  Each hexadecimal digit is an edge: 4 times its axis, plus 1 and 2 for the sides along the others.
TABLE = (
    ",048,095,548958,41a,01a80a,5091a4,51a5a99a8,5b1,0485b1,9b1091,14818bb89,45ba4b,05b0b88ba,40949aa9b,9b8ba8,28"
    "6,204624,095862,295256654,86241a,a62a21120,9508621a4,2a69a291a951,5b1862,4624205b1,9b1910862,19b169146629,45"
    "b4ba628,5ba5a252062a,2869a09baa40,2a629a9ba,927,927048,027507,827874475,9271a4,01a0a8279,0270751a4,1751871a8"
    "278,5b1927,4805b1279,7b1712210,17b471427482,ba4b45927,27905885b8ba,7027a07baa40,7827b8ba8,986796,904947746,0"
    "86065567,547467,67969841a,9679169011a6,1a4085586567,a51a65675,986967b15,b15907704746,810871867b17,17b147467,"
    "987867b45ba4,70679060a5b0a0b,a0ba40b07860706,a7b67a,6a3,480a36,095a36,895854a36,641361,680603301,136164095,5"
    "13538589836,b1536a,5b148036a,10919b36a,36a14bb48b89,b36b65564,b365b6568580,0640b609b36b,6b368b89b,328a38,4a3"
    "430032,8a3832950,932943954a34,841812213,012213,509124132284,529512132,32838a15b,5b14a00a3032,28a2a309119b,b4"
    "9b14942a34243,84585383235b,b05b30320,24328434b094b49,b2932b,2796a3,048279a36,7507026a3,a36824427475,64161379"
    "2,927038013368,413436507702,381368185278587,927b156a3,36a5b1048279,6a37b22b1210,482427471b17a36,927b35536564"
    ",5b3536560806927,2b027b0b436b4b6,6b368b7b22b8,37939aa98,4a3043037079,08a0a70757a3,34a374754,798781713418,937"
    "903013,587508783418381,537135,5b19a798aa37,04a0a30397935b1,a78a37870b17071,34a37414bb47,5345b3438793839,b05b"
    "30907703,0847b3,b37,b73,04873b,95073b,54858973b,1a4b73,a80a01b73,0951a473b,73b51991a9a8,573153,573531480,973"
    "930031,789718731481,3a4347745,0a807a05773a,43a034073097,3973a9a89,73b286,2042463b7,50973b862,b73569546629,41"
    "a628b73,73b2162011a6,0952861a473b,95191a9a262a73b,315357286,571731420462,862970073031,694629491739193,86247a"
    "45773a,7a573a5a062a0a2,097073034a43862,3973a929669a,b923b2,23b2b9048,b50b03302,8548358233b5,b92b23a41,0181a8"
    "2b923b,41a0350233b5,3523b52581a585a,592521123,480591192123,021231,814821231,923934945a43,85a805a53925352,43a"
    "403023,382a83,63b6b88b9,04606b0b93b6,b6356b586508,b63b56546,1a4b83b98863,1601a60693b696b,50858656b3b61a4,a51"
    "a65b53356,531583598863,193159396049694,608630310,614316,839863935a43534,059a63,60863040aa03,63a,ab76a7,ab7a7"
    "6804,76a7ab509,b76b6a958854,1b7174476,801817876b71,95074b76441b,918951816b71617,a15a56657,0485615766a1,97696"
    "191016a,6176a1719481918,574476,068056576,940974764,968769,72878bb8a,72070a7aba04,0958b28abb72,b2ab72a2495242"
    "5,1b7417472428,71b721201,41b4b7478287095,71b721519912,15717818a287,0a204a2a715a7a5,07109717a287a78,97214a,87"
    "2847457,072570,872847970074,972,26a2a99ab,04826996a9ab,5ab52a5026a2,42548252b6a2b2a,1b9196164692,96b926b6180"
    "6160,4b641b6b250b2b0,51b826,26a92a9a1915,92696a9a515a048,a26a12102,a26a12824421,259265645,259265058856,24064"
    "2,268,98bb8a,4904a9ab9,0b508b8ab,4b5ab4,1841b8b98,91b019,1841b808558b,51b,5a159a98a,4904a959119a,0a18a0,4a1,"
    "584985,059,084,"
)
CASES = TABLE.split(",")
COUNTS = np.array([len(case) for case in CASES])  # [256] corners of triangles
FIRSTS = np.cumsum(COUNTS) - COUNTS  # [256]
EDGES = np.array([int(digit, 16) for case in CASES for digit in case])  # [2460]
AXES = np.arange(12) // 4  # [12] of the edges
# The first sample of each edge, (12, 3) in x, y, z.
STARTS = np.array([np.insert([edge & 1, edge >> 1 & 1], edge // 4, 0) for edge in range(12)])


@dataclass(frozen=True, eq=False)
class Triangles:
    """An isosurface of a field.

    Attributes
    ----------
    places : (V, 3) of the corners, x, y, z in samples.
    normals : (V, 3) unit gradients of the field at the corners, in world units; 0 where it is constant.
    corners : (T, 3) of the triangles, rows of the others.
    """

    places: NDArray[np.float64]  # [V, 3]
    normals: NDArray[np.float64]  # [V, 3]
    corners: NDArray[np.int32]  # [T, 3]

    __repr__ = one_line

    @classmethod
    def of(cls, field: SampledField, isovalue: float) -> Triangles:
        """The surface between samples that are less than `isovalue` and others; cells with a hole at a corner have none."""
        values, size = field.filled, field.size
        sides = list(product((0, 1), repeat=3))  # z, y, x
        codes = np.zeros(size[::-1] - 1, dtype=np.uint8)  # [Z - 1, Y - 1, X - 1]
        above, hidden = values >= isovalue, np.zeros(codes.shape, dtype=bool)
        for bit, side in enumerate(sides):
            window = tuple(slice(s, s + n) for s, n in zip(side, codes.shape, strict=True))
            codes |= above[window].astype(np.uint8) << np.uint8(bit)
            hidden |= False if field.holes is None else field.holes[window]
        codes[hidden] = 0
        strides = np.array([1, size[0], size[0] * size[1]])
        z, y, x = np.nonzero(COUNTS[codes])
        first, code = x + strides[1] * y + strides[2] * z, codes[z, y, x]  # [C]
        counts = COUNTS[code]  # [C]
        order = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts - FIRSTS[code], counts)  # [3 T]
        edges = EDGES[order]  # [3 T]
        keys = 3 * (np.repeat(first, counts) + (STARTS @ strides)[edges]) + AXES[edges]  # [3 T]
        names, corners = np.unique(keys, return_inverse=True)
        low, axis = names // 3, names % 3  # [V]
        steps = np.eye(3, dtype=np.int64)[axis]  # [V, 3]
        before = np.stack([low % size[0], low // strides[1] % size[1], low // strides[2]], axis=1)  # [V, 3]
        start, end = (values.ravel()[low + side * strides[axis]].astype(np.float64) for side in (0, 1))
        shares = ((isovalue - start) / (end - start))[:, None]  # [V, 1]
        slopes = [_gradients(field, place) for place in (before, before + steps)]
        normals = slopes[0] + shares * (slopes[1] - slopes[0])  # [V, 3]
        return cls(before + shares * steps, _unit(normals), corners.reshape(-1, 3).astype(np.int32))

    def within(self, bounds: NDArray[np.float64]) -> Triangles:
        """The surface cut to places (2, 3) in samples: triangles that reach out end there; nothing where bounds are equal."""
        if not (bounds[1] > bounds[0]).all():
            return Triangles(self.places, self.normals, self.corners[:0])
        cut = self
        for axis in range(3):
            cut = cut._beyond(axis, 1.0, bounds[0, axis])._beyond(axis, -1.0, -bounds[1, axis])
        return cut

    def _beyond(self, axis: int, sign: float, least: float) -> Triangles:
        """The surface where `sign` times the places along an axis are `least` or more."""
        depths = sign * self.places[:, axis] - least  # [V]
        within = (depths >= 0.0)[self.corners]  # [T, 3]
        counts, first = within.sum(axis=1), len(self.places)
        places, normals, corners = [self.places], [self.normals], [self.corners[counts == 3]]
        for count in (1, 2):
            chosen = counts == count
            lone = (within[chosen] == (count == 1)).argmax(axis=1)  # the corner that is alone on its side
            order = (lone[:, None] + np.arange(3)) % 3
            alone, *others = np.take_along_axis(self.corners[chosen], order, axis=1).T  # [C] each
            ends = []
            for other in others:
                start, stop = (alone, other) if count == 1 else (other, alone)  # so that neighbours agree to a bit
                share = (depths[start] / (depths[start] - depths[stop]))[:, None]
                new = self.places[start] + share * (self.places[stop] - self.places[start])
                new[:, axis] = sign * least
                places.append(new)
                normals.append(self.normals[start] + share * (self.normals[stop] - self.normals[start]))
                ends.append(first + np.arange(len(new)))
                first += len(new)
            if count == 1:
                corners.append(np.stack([alone, *ends], axis=1))
            else:
                corners += [np.stack([ends[0], *others], axis=1), np.stack([ends[0], others[1], ends[1]], axis=1)]
        return Triangles(np.concatenate(places), np.concatenate(normals), np.concatenate(corners).astype(np.int32))


def _gradients(field: SampledField, places: NDArray[np.int64]) -> NDArray[np.float64]:
    """Central differences (V, 3) at samples (V, 3), x, y, z, one-sided on the faces."""
    columns = []
    for axis, side in enumerate(np.eye(3, dtype=np.int64)):
        ahead, behind = np.minimum(places + side, field.size - 1), np.maximum(places - side, 0)
        rise = (field.filled[tuple(at.T[::-1])].astype(np.float64) for at in (ahead, behind))
        columns.append((next(rise) - next(rise)) / ((ahead - behind)[:, axis] * field.spacing[axis]))
    return np.stack(columns, axis=1)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vectors (V, 3) of length 1, but for those of length 0."""
    largest = np.abs(vectors).max(axis=1, keepdims=True, initial=0.0)  # squares would vanish or overflow
    vectors = vectors / np.where(largest > 0.0, largest, 1.0)
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)
