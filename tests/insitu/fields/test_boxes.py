"""World boxes: where members lie in that of their ensemble."""

from __future__ import annotations

import numpy as np
import pytest

from insitu.fields.boxes import box_around, box_of, check_inside, is_smaller
from render import to_grid

BOX = ((0.0, 0.0, 0.0), (1.0, 2.0, 3.0))


def test_boxes_are_judged_by_their_size() -> None:
    box = box_of(to_grid(np.zeros((4, 3, 2)), spacing=(1.0, 1.0, 1.0)))
    assert box_around([box]) == BOX
    check_inside(box, BOX)
    check_inside(box, ((0, 0, 0), (1, 2, 3 - 1e-7)))
    with pytest.raises(ValueError, match=r"\(1, 2, 3\)"):
        check_inside(box, ((0, 0, 0), (1, 2, 2.9)))
    assert not is_smaller(box, ((0, 0, 0), (1, 2, 3.01)))
    assert is_smaller(box, ((0, 0, 0), (1, 2, 3.1)))
