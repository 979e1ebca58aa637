"""Predictors of images: the protocol that the surrogate and its baselines follow."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.cameras import Camera
from surrogate.evaluation.cases import VALIDATION, Case
from surrogate.model import MemberModel
from surrogate.model.mean_member import MeanMember

Draw = Callable[[Case], Iterable[NDArray[Any]]]


class Predictor(Protocol):
    """Predicts images for simulation parameters, visualization parameters and a camera.

    A predictor may combine several that share work, such as rules that mix the same stored images. It then has as many
    `names`, and predicts as many images of each case.
    """

    @property
    def names(self) -> Sequence[str]:
        """The name of each image that `batches` predicts of a case."""

    def batches(self, cases: Sequence[Case]) -> Iterator[tuple[Sequence[Case], Draw]]:
        """Cases that are cheap to predict together, and a function that predicts one of them.

        The function returns a premultiplied RGBA image (H, W, 4), uint8 or float32, for each name; two threads call it.
        Cases that can't be predicted are left out.
        """


def one_picture(
    member: MemberModel, camera: Camera, background: Sequence[float] | None = None
) -> list[NDArray[np.float32]]:
    """The picture that the member shows."""
    return [member.render(camera, background=background)]


def pictures_of_all(
    member: MemberModel, camera: Camera, background: Sequence[float] | None = None
) -> list[NDArray[np.float32]]:
    """A picture for each representation of a surrogate, of a member that is drawn by the last of these.

    The mean of two takes no further drawing.
    """
    return (
        member.pictures(camera, background)
        if isinstance(member, MeanMember)
        else one_picture(member, camera, background)
    )


@dataclass(frozen=True, eq=False)
class SurrogatePredictor:
    """A surrogate, deformed once for all views of the same parameters.

    Attributes
    ----------
    at : `Surrogate.at`, or another function from parameters by name to a member.
    background : the colour behind opaque images; None for images with alpha.
    parameters_of : returns the parameters at which a case is rendered, by default its own.
    at_validation : like `at`, for validation members, where the surrogate has learnt from them; see `surrogate.model.judged`.
    pictures : of a member through a camera on the background, one for each of the `names`.
    """

    at: Callable[..., MemberModel]
    background: Sequence[float] | None
    parameters_of: Callable[[Case], Mapping[str, float | str]] = lambda case: case.parameters
    names: Sequence[str] = ("the surrogate",)
    at_validation: Callable[..., MemberModel] | None = None
    pictures: Callable[[MemberModel, Camera, Sequence[float] | None], list[NDArray[np.float32]]] = one_picture

    def batches(self, cases: Sequence[Case]) -> Iterator[tuple[Sequence[Case], Draw]]:
        """See `Predictor`."""
        batches: dict[tuple[bool, tuple[tuple[str, float | str], ...]], list[Case]] = {}
        for case in cases:
            is_validation = case.member.split == VALIDATION
            batches.setdefault((is_validation, tuple(self.parameters_of(case).items())), []).append(case)
        for (is_validation, parameters), batch in batches.items():
            at = self.at_validation if is_validation and self.at_validation else self.at
            member = at(dict(parameters))
            through: dict[int, list[Case]] = {}
            for case in batch:
                through.setdefault(id(case.camera), []).append(case)
            if len(through) == len(batch):
                yield batch, partial(self._render, member)
                continue
            for same in through.values():  # one picture for all
                yield same, partial(_itself, self._render(member, same[0]))

    def _render(self, member: MemberModel, case: Case) -> list[NDArray[np.float32]]:
        return self.pictures(member, case.camera, self.background)


def _itself(pictures: list[NDArray[np.float32]], _: Case) -> list[NDArray[np.float32]]:
    return pictures
