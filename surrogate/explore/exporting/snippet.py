"""The Python code that draws a picture of the explorer again, to take into a notebook or a script."""

from __future__ import annotations

import keyword
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from pprint import pformat
from textwrap import indent

from catalogs.vocabulary.cameras import Camera
from native.ray_casting.cuts import AXES, Cut
from surrogate.explore.color_maps import color_points
from surrogate.explore.setting import Setting
from surrogate.model import Surrogate


def snippet(
    folder: str | os.PathLike[str],
    surrogate: Surrogate,
    setting: Setting,
    camera: Camera,
    background: Sequence[float] | None,
) -> str:
    """A program that draws the very same picture, bit for bit, and writes `picture.png`.

    `folder` is that of the surrogate, and stands in the program as an absolute path.  Without a `background` (straight RGB in
    [0, 1]) the picture is transparent.  Raises ValueError where the surrogate can't show the setting's colours.
    """
    function = _function_lines(setting, surrogate) if setting.is_free else []
    arguments = ["function", *_arguments(setting.parameters)] if function else _arguments(setting.values)
    picture = f"surrogate.{'under' if function else 'at'}({', '.join(arguments)}){_cut(setting)}"
    using = setting.drawn_by(surrogate) if setting.cut else setting.using
    chosen = f'.using("{using}")' if using else ""
    behind = "" if background is None else f", background={tuple(float(part) for part in background)!r}"
    program = [
        "from pathlib import Path",
        "",
        f"from catalogs import Camera{', TransferFunction' if function else ''}",
        "from catalogs.files.images import write_image",
        "from surrogate import Surrogate",
        *(
            ["from surrogate.explore.color_maps import color_points"]
            if any("color_points(" in f for f in function)
            else []
        ),
        "",
        f"surrogate = Surrogate.load({str(Path(folder).resolve())!r}){chosen}",
        "camera = Camera.from_json(",
        indent(pformat(camera.to_json(), width=120, sort_dicts=False), "    "),
        ")",
        *function,
        *_unit_lines(setting, surrogate),
        f"picture = {picture}.render(camera{behind})  # [{camera.height}, {camera.width}, 4], premultiplied RGBA",
        'write_image(Path("picture.png"), picture)',
    ]
    return "".join(f"{line}\n" for line in program)


def _cut(setting: Setting) -> str:
    """Calls that cut a member."""
    cut = setting.cut or Cut()
    box = "" if cut.box is None else f".within({cut.box[0]!r}, {cut.box[1]!r})"
    return box + ("" if cut.plane is None else f".slice({AXES[cut.plane[0]]!r}, {cut.plane[1]!r})")


def _unit_lines(setting: Setting, surrogate: Surrogate) -> list[str]:
    """A comment that says the units of the parameters that have some."""
    spaces = surrogate.space, *(v.space for v in surrogate.variations)
    units = {p.name: p.unit for space in spaces for p in space.parameters if p.unit and p.name in setting.values}
    return [f"# {', '.join(f'{name} in {unit}' for name, unit in units.items())}"] if units else []


def _arguments(values: Mapping[str, float | str]) -> list[str]:
    """Keyword arguments of `Surrogate.at`; before them a mapping of the names that can't be one."""
    exact = {name: value if isinstance(value, str) else float(value) for name, value in values.items()}
    odd = {n: v for n, v in exact.items() if not n.isidentifier() or keyword.iskeyword(n) or n == "outside"}
    plain = [f"{name}={value!r}" for name, value in exact.items() if name not in odd]
    return [repr(odd), *plain] if odd else plain


def _function_lines(setting: Setting, surrogate: Surrogate) -> list[str]:
    """The transfer function, its colours by the name of their map where that says it all."""
    function = setting.transfer_function(surrogate)
    low, high = function.color_points[0][0], function.color_points[-1][0]
    named = bool(setting.color_map) and color_points(setting.color_map, low, high) == function.color_points
    colors = f"color_points({setting.color_map!r}, {low!r}, {high!r})" if named else repr(function.color_points)
    return [
        "function = TransferFunction(",
        f"    color_points={colors},",
        f"    opacity_points={function.opacity_points!r},",
        f"    opacity_unit_distance={function.opacity_unit_distance!r},",
        ")",
    ]
