"""The explorer's exports on the command line: `surrogate export` and `surrogate sweep`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from catalogs.progress import ProgressLine

if TYPE_CHECKING:
    from catalogs.cameras import Camera
    from surrogate.explore.exporting.sweep import Axis
    from surrogate.explore.run import Run
    from surrogate.explore.setting import Setting
    from surrogate.model import Surrogate

EXPORTS = (".png", ".exr", ".ply")
SHEETS, FILMS = (".png",), (".gif", ".mp4")
SHEET_STEPS, ROW_STEPS, FILM_STEPS = 8, 5, 48
SIDE = 512  # of pictures where no catalog says another
MOST_SIDE = 8192

RUN = click.argument("run", type=click.Path(exists=True, file_okay=False, path_type=Path))
PARAMETERS = click.option(
    "-p",
    "--parameters",
    multiple=True,
    metavar="NAME=VALUE",
    help="Of the simulation or how it is shown, e.g. -p Re=1800 -p isovalue=12; those of the simulation that are left out stand "
    "in the middle of their bounds.",
)
COLOR_MAP = click.option(
    "--color-map", default="", metavar="NAME", help="Such as viridis, instead of the base's colours."
)
VIEW = click.option("--view", default=0, show_default=True, help="Number of a viewpoint of the catalog.")
SIZE = click.option("--size", default="", metavar="WxH", help="Pixels of a picture.  [default: the catalog's]")


@click.command()
@RUN
@PARAMETERS
@COLOR_MAP
@VIEW
@SIZE
@click.option("--background", default="", metavar="R,G,B", help="Colour in [0, 1] behind it; else transparent.")
@click.option(
    "--like",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="A PNG or EXR of the explorer: shows what it shows, as far as nothing else is asked for.",
)
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="FILE.png, .exr or .ply")
def export(run: Path, like: Path | None, output: Path, **options: Any) -> None:
    """Write what the surrogate in RUN (such as runs/tgv-dvr) shows: a picture, or its Gaussians as PLY for other viewers.

    PNG has 8 bits and straight alpha, EXR 32 and premultiplied alpha; both keep how they were made.
    """

    def work() -> str:
        from catalogs import durable
        from surrogate.explore.exporting.pictures import record_for, record_of
        from surrogate.explore.run import Run

        suffix = _suffix(output, EXPORTS)
        opened = Run.open(run)
        record = None if like is None else record_of(like)
        setting = _setting(opened.surrogate, options["parameters"], options["color_map"], record)
        gaussians = setting.gaussians(opened.surrogate)
        _warn(opened.surrogate, setting)
        if suffix == ".ply":
            from surrogate.explore.exporting.ply import ply_bytes

            durable.replace(output, ply_bytes(gaussians))
            return f"{output}: {len(gaussians):,} Gaussians, {_said(setting)}"
        from surrogate.explore.exporting.pictures import encode

        camera = _camera(opened, options["view"], options["size"], record)
        behind = _background(opened.surrogate, options["background"], record)
        picture = gaussians.render(camera, background=behind)
        made = record_for(opened.surrogate, setting, camera, behind)
        durable.replace(output, encode(picture, "png" if suffix == ".png" else "exr", record=made))
        return f"{output}: {camera.width}x{camera.height}, {_said(setting)}"

    _do(work)


@click.command()
@RUN
@click.option("--over", required=True, metavar="NAME", help="The parameter that varies, such as Re or isovalue.")
@click.option("--from", "low", type=float, help="Its first value.  [default: its lower bound]")
@click.option("--to", "high", type=float, help="Its last value.  [default: its upper bound]")
@click.option(
    "--steps",
    type=int,
    help=f"How many pictures.  [default: {SHEET_STEPS}, {ROW_STEPS} of a grid, {FILM_STEPS} of a film]",
)
@click.option("--rows", "down", default="", metavar="NAME", help="A second parameter, which makes a PNG a grid.")
@click.option("--rows-from", type=float, help="Its first value.  [default: its lower bound]")
@click.option("--rows-to", type=float, help="Its last value.  [default: its upper bound]")
@click.option("--rows-steps", default=ROW_STEPS, show_default=True, help="How many rows.")
@PARAMETERS
@COLOR_MAP
@VIEW
@SIZE
@click.option("--background", default="", metavar="R,G,B", help="Colour in [0, 1] behind it.  [default: white]")
@click.option("--fps", default=12.0, show_default=True, help="Pictures a second of a film.")
@click.option("--there-and-back", is_flag=True, help="Let a film run backwards to where it began.")
@click.option("--caption/--no-caption", default=True, show_default=True, help="Whether a film shows the value.")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="FILE.png, .gif or .mp4")
def sweep(run: Path, output: Path, **options: Any) -> None:
    """Draw what the surrogate in RUN shows over one parameter: a labelled strip, a grid over two, or a film."""

    def work() -> str:
        from catalogs import durable
        from surrogate.explore.exporting.films import gif, mp4
        from surrogate.explore.exporting.pictures import record_for
        from surrogate.explore.exporting.sheets import captioned, strip
        from surrogate.explore.exporting.sweep import Sweep, parameter, pictures
        from surrogate.explore.run import Run

        suffix = _suffix(output, SHEETS + FILMS)
        if suffix in FILMS and options["down"]:
            raise ValueError("a film goes over one parameter: leave out --rows, or make a PNG")
        opened = Run.open(run)
        surrogate = opened.surrogate
        setting = _setting(surrogate, options["parameters"], options["color_map"], None)
        columns, rows = _axes(surrogate, options, film=suffix in FILMS)
        swept = Sweep(setting, columns, rows)
        axes = [axis for axis in (columns, rows) if axis is not None]
        _warn(surrogate, setting, {axis.name: (axis.low, axis.high) for axis in axes})
        camera = _camera(opened, options["view"], options["size"], None)
        behind = _background(surrogate, options["background"], None) or (1.0, 1.0, 1.0)
        on_paper: dict[str, Any] = {
            "background": behind,
            "units": {axis.name: parameter(surrogate, axis.name).unit for axis in axes},
        }
        with ProgressLine() as line:
            drawn: Any = pictures(swept, surrogate, camera, behind, progress=partial(line.count, "drawing"))
            if suffix in FILMS:
                framed = captioned(drawn, swept, **on_paper) if options["caption"] else drawn
                motion: dict[str, Any] = {
                    "frames_per_second": options["fps"],
                    "there_and_back": options["there_and_back"],
                }
                made = gif(framed, **motion) if suffix == ".gif" else mp4(framed, **motion)
            else:
                made = strip(swept, drawn, **on_paper, record=record_for(surrogate, setting, camera, behind))
        durable.replace(output, made)
        over = " and ".join(f"{axis.name} {axis.low:g}..{axis.high:g}" for axis in axes)
        left = {name: value for name, value in _values(setting).items() if name not in {axis.name for axis in axes}}
        return f"{output}: {len(swept)} pictures over {over}" + (f", {_listed(left)}" if left else "")

    _do(work)


def _do(work: Callable[[], str]) -> None:
    """Do the work and say what was done; what the user can mend is told in one line."""
    try:
        click.echo(work())
    except ModuleNotFoundError as error:
        raise click.ClickException(
            f"this needs the package {error.name}: pip install 'gs-surrogate[explore]'"
        ) from error
    except (ValueError, OSError) as error:  # a CatalogError is a ValueError
        raise click.ClickException(str(error)) from error


def _suffix(output: Path, known: Sequence[str]) -> str:
    if output.suffix.lower() not in known:
        raise ValueError(f"the file must end with one of {', '.join(known)}, got {output.name}")
    if not output.parent.is_dir():
        raise ValueError(f"{output.parent} is no folder: make it first")
    return output.suffix.lower()


def _setting(surrogate: Surrogate, given: Sequence[str], color_map: str, record: Mapping[str, Any] | None) -> Setting:
    """What the options ask for, over what the record of a picture shows, over the middle of all bounds."""
    from surrogate.explore.setting import Setting

    values = dict(map(_assignment, given))
    simulated = {n: float(value) for n, value in values.items() if n in surrogate.space.names}
    shown = {name: value for name, value in values.items() if name not in simulated}
    middle = {p.name: (p.low + p.high) / 2.0 for p in surrogate.space.parameters}
    if record is None:
        return Setting(middle | simulated, shown, color_map)
    try:
        seen = {name: float(value) for name, value in record["parameters"].items()}
        visualization, colors = dict(record["visualization"]), str(record["color_map"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise ValueError(f"the picture keeps no setting that is understood: {error!r}") from error
    return Setting(middle | seen | simulated, shown or visualization, color_map or colors)


def _camera(run: Run, view: int, size: str, record: Mapping[str, Any] | None) -> Camera:
    from catalogs.cameras import Camera

    if record is not None and "camera" in record:
        try:
            camera = Camera.from_json(record["camera"])
        except (KeyError, TypeError) as error:
            raise ValueError(f"the picture keeps no camera that is understood: {error!r}") from error
    else:
        cameras = _cameras(run)
        if not 0 <= view < len(cameras):
            raise ValueError(f"view must lie in 0..{len(cameras) - 1}, got {view}")
        camera = cameras[view]
    return camera.resized(*_pixels(size)) if size else camera


def _cameras(run: Run) -> Sequence[Camera]:
    """Those of the catalog; where there is none, the 252 around a sphere that holds the volume."""
    from catalogs.cameras import orbit

    if run.catalog is not None:
        return run.catalog.plan.cameras or run.catalog.members[0].cameras
    placed = run.surrogate.normalization
    return orbit(placed.center, 3.0**0.5 * placed.extent, width=SIDE, height=SIDE)


def _background(
    surrogate: Surrogate, given: str, record: Mapping[str, Any] | None
) -> tuple[float, float, float] | None:
    if not given:
        kept = None if record is None else record.get("background")
        return surrogate.background if kept is None else _color(kept)
    return _color(given.split(","))


def _color(parts: Any) -> tuple[float, float, float]:
    try:
        red, green, blue = (float(part) for part in parts)
    except (TypeError, ValueError):
        raise ValueError(f"a background is given as R,G,B, got {parts!r}") from None
    if not all(0.0 <= part <= 1.0 for part in (red, green, blue)):
        raise ValueError(f"a background lies in [0, 1], got {red:g},{green:g},{blue:g}")
    return red, green, blue


def _pixels(size: str) -> tuple[int, int]:
    """Width and height of "640x480", or of "512"."""
    width, _, height = size.lower().partition("x")
    try:
        sides = int(width), int(height or width)
    except ValueError:
        raise ValueError(f"a size is given as WIDTHxHEIGHT, got {size!r}") from None
    if not all(1 <= side <= MOST_SIDE for side in sides):
        raise ValueError(f"a side has 1 to {MOST_SIDE} pixels, got {size}")
    return sides


def _axes(surrogate: Surrogate, options: Mapping[str, Any], *, film: bool) -> tuple[Axis, Axis | None]:
    down = options["down"]
    steps = options["steps"] or (FILM_STEPS if film else ROW_STEPS if down else SHEET_STEPS)
    columns = _axis(surrogate, options["over"], options["low"], options["high"], steps)
    if not down:
        return columns, None
    return columns, _axis(surrogate, down, options["rows_from"], options["rows_to"], options["rows_steps"])


def _axis(surrogate: Surrogate, name: str, low: float | None, high: float | None, steps: int) -> Axis:
    from surrogate.explore.exporting.sweep import Axis, parameter

    bounds = parameter(surrogate, name)
    return Axis(name, bounds.low if low is None else low, bounds.high if high is None else high, steps)


def _assignment(text: str) -> tuple[str, float | str]:
    from catalogs.variations import APPEARANCE

    name, sign, value = (part.strip() for part in text.partition("="))
    try:
        if not sign:
            raise ValueError
        return name, value if name == APPEARANCE else float(value)
    except ValueError:
        raise ValueError(f"parameters are given as NAME=VALUE, got {text!r}") from None


def _warn(surrogate: Surrogate, setting: Setting, swept: Mapping[str, tuple[float, float]] | None = None) -> None:
    """Say on the terminal what lies out of bounds, where a surrogate can only guess."""
    from surrogate.explore.exporting.sweep import parameter

    reached = {name: (value, value) for name, value in _values(setting).items() if not isinstance(value, str)}
    for name, (low, high) in (reached | dict(swept or {})).items():
        bounds = parameter(surrogate, name)
        if low < bounds.low or high > bounds.high:
            far = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            click.echo(f"{name} = {far} lies outside its bounds [{bounds.low:g}, {bounds.high:g}]: a guess", err=True)


def _values(setting: Setting) -> dict[str, float | str]:
    return {**setting.parameters, **setting.visualization}


def _said(setting: Setting) -> str:
    colors = f", {setting.color_map}" if setting.color_map else ""
    return _listed(_values(setting)) + colors


def _listed(values: Mapping[str, float | str]) -> str:
    return ", ".join(
        f"{name}={value if isinstance(value, str) else format(value, 'g')}" for name, value in values.items()
    )
