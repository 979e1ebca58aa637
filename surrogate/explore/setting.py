"""Settings: what an image of the explorer shows, whatever its camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from catalogs.vocabulary.appearance import TransferFunction, VolumeRendering
from catalogs.vocabulary.numbers import text
from catalogs.vocabulary.variations import POINT_PARAMETERS, displaced
from native.ray_casting import Cut
from surrogate.answers.doubt import NEVER, Doubt, MemberDoubt
from surrogate.appearance.field_gaussians import FieldGaussians
from surrogate.deformation.values import ValuesDeformation
from surrogate.explore.color_maps import color_points
from surrogate.model import MemberModel, Surrogate
from surrogate.model.emulated_member import EmulatedMember
from surrogate.model.representation import DRAWN, FIELD


@dataclass(frozen=True)
class Setting:
    """Simulation parameters, and how the field is shown there.

    Attributes
    ----------
    parameters : all simulation parameters by name, in their units.
    visualization : those of one variation as `Surrogate.at` takes them: an `isovalue`, an `appearance`, or displacements of the
        base transfer function's inner control points; empty for the base appearance.
    color_map : one of `surrogate.explore.color_maps.NAMES` instead of the base's colours; "" for those.
    using : the one of `Surrogate.representations` that draws it; "" for what did best on validation images.
    function : any transfer function instead of the base and its displacements; None for those.
    cut : what of the field is drawn, a clip box or a slice; None for all.
    """

    parameters: Mapping[str, float]
    visualization: Mapping[str, float | str] = field(default_factory=dict)
    color_map: str = ""
    using: str = ""
    function: TransferFunction | None = None
    cut: Cut | None = None

    def __hash__(self) -> int:
        return hash((frozenset(self.values.items()), self.color_map, self.using, self.function, self.cut))

    @property
    def is_free(self) -> bool:
        """True where a transfer function of its own shows the field, in its points or its colours."""
        return bool(self.color_map) or self.function is not None

    @property
    def values(self) -> dict[str, float | str]:
        """All parameters by name."""
        return {**self.parameters, **self.visualization}

    def __str__(self) -> str:
        return self.described()

    def described(self, origins: Mapping[str, float] | None = None) -> str:
        """In words, control points by their places where their `origins` are given, see `origins_of`."""
        return self.shown_as(listed(self.values, origins))

    def shown_as(self, words: str) -> str:
        """The same of other words on its values."""
        function = "" if self.function is None else f"function of {len(self.function.opacity_points)} points"
        cut = "" if self.cut is None else str(self.cut)
        return ", ".join(filter(None, [words, function, self.color_map, cut, self.using and DRAWN[self.using]]))

    def member(self, surrogate: Surrogate) -> MemberModel:
        """The surrogate at this setting; raises ValueError as `Surrogate.at` and `Surrogate.under` do.

        Values out of bounds are shown without a warning: the page says so itself.
        """
        if self.cut is not None:
            return self.cut_from(self.whole(surrogate).member(surrogate))
        if self.using:
            surrogate = surrogate.using(self.using)
        if not self.is_free:
            return surrogate.at(self.values, outside="allow")
        return surrogate.under(self.transfer_function(surrogate), self.parameters, outside="allow")

    def whole(self, surrogate: Surrogate) -> Setting:
        """The setting without its cut, drawn from the emulated field, which alone can be cut exactly.

        Raises ValueError where the surrogate has none, or where another representation was chosen.
        """
        if FIELD not in surrogate.representations:
            raise ValueError("only an emulated field can be cut or sliced, and this surrogate has none")
        if self.using not in ("", FIELD):
            raise ValueError(
                f"a picture drawn {DRAWN[self.using]} can't be cut or sliced, only one from the emulated field: choose that"
            )
        return replace(self, cut=None, using=FIELD)

    def cut_from(self, whole: MemberModel) -> MemberModel:
        """The member of `whole` cut; raises ValueError for a slice of an isosurface."""
        assert isinstance(whole, EmulatedMember)
        assert self.cut is not None
        return whole.cut_to(self.cut)

    def doubted(self, doubt: Doubt) -> MemberDoubt:
        """The doubt of what is shown at this setting; raises ValueError as `member` does."""
        if self.cut is not None:
            return replace(
                self.whole(doubt.surrogate).doubted(doubt), words=NEVER, why="no stored image is cut or sliced"
            )
        if not self.is_free:
            return doubt.at(self.values, using=self.using)
        return doubt.at(self.parameters, self.transfer_function(doubt.surrogate), using=self.using)

    def drawn_by(self, surrogate: Surrogate) -> str:
        """The one of `surrogate.representations` that draws it."""
        if self.using or self.cut is not None:
            return self.using or FIELD
        return surrogate.drawn_by(self.visualization, under=self.is_free)

    def transfer_function(self, surrogate: Surrogate) -> TransferFunction:
        """The one that is shown; raises ValueError where the surrogate follows none, or where control points cross."""
        base = base_function(surrogate)
        if base is None:
            raise ValueError("this surrogate follows no transfer functions, so its colours can't be changed")
        if self.function is not None and self.visualization:
            named = ", ".join(self.visualization)
            raise ValueError(f"a transfer function of its own has no {named}, which belong to the base: leave one out")
        function = self.function or base
        if self.function is None and self.visualization:
            function = displaced(base, [float(self.visualization.get(name, 0.0)) for name in POINT_PARAMETERS])
        if not self.color_map:
            return function
        low, high = base.color_points[0][0], base.color_points[-1][0]
        return replace(function, color_points=color_points(self.color_map, low, high))


def listed(values: Mapping[str, float | str], origins: Mapping[str, float] | None = None) -> str:
    """Such as "Re = 1800, appearance = speed"; values with an origin are given from zero on, as in `with_origins`."""
    return ", ".join(f"{name} = {_word(value)}" for name, value in with_origins(values, origins).items())


def with_origins(
    values: Mapping[str, float | str], origins: Mapping[str, float] | None = None
) -> dict[str, float | str]:
    """Values as people read them: of a control point its place, not its displacement from the `origins` of `origins_of`."""
    from_zero = origins or {}
    return {n: v if isinstance(v, str) else v + from_zero.get(n, 0.0) for n, v in values.items()}


def _word(value: float | str) -> str:
    return value if isinstance(value, str) else text(value)


def base_function(surrogate: Surrogate) -> TransferFunction | None:
    """The transfer function around which the surrogate follows others; None where it follows none in any colours."""
    if surrogate.field is not None and isinstance(base := surrogate.field.appearances[0], VolumeRendering):
        return base.transfer_function
    if isinstance(surrogate.gaussians, FieldGaussians):
        return surrogate.gaussians.field.base
    deformations = (visualization.deformation for visualization in surrogate.visualizations)
    return next((d.base for d in deformations if isinstance(d, ValuesDeformation)), None)
