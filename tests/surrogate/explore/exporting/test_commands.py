from __future__ import annotations

import io
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from catalogs.files.images import read_image, to_bytes
from catalogs.store.catalog import Catalog
from catalogs.vocabulary.cameras import Camera
from surrogate import Surrogate
from surrogate.answers.doubt import Doubt
from surrogate.explore.exporting.commands import export, sweep
from surrogate.explore.exporting.ply import ply_bytes
from surrogate.explore.exporting.splats import Splats
from surrogate.explore.exporting.sweep import Axis, Sweep, settings
from surrogate.explore.run import Run
from surrogate.explore.setting import Setting
from surrogate.storage.picture_records import record_of
from tests.support import families
from tests.support.field_blobs import BLOBS, FUNCTION, FUNCTIONS, ISOVALUE
from tests.support.models import following, plain


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with a surrogate and a catalog of five views."""
    folder = tmp_path_factory.mktemp("runs") / "blobs"
    following().save(folder / "surrogate")
    families.family_catalog(
        folder / "catalog.cdb",
        BLOBS,
        FUNCTION,
        (ISOVALUE, FUNCTIONS),
        {"member-0": ("train", 0.0, ["dvr"])},
        lambda p, shown: following().at(p=p).render,
        view_splits=("train",) * 5,
    )
    return folder


def invoke(command: click.Command, *arguments: Any) -> Result:
    return CliRunner().invoke(command, [str(argument) for argument in arguments])


def done(command: click.Command, *arguments: Any) -> Result:
    result = invoke(command, *arguments)
    assert result.exit_code == 0, result.output
    return result


def camera(run: Path, view: int) -> Camera:
    return Catalog.open(run / "catalog.cdb").plan.cameras[view]


def test_a_png_shows_what_was_asked_for_and_says_so(run: Path, tmp_path: Path) -> None:
    output = tmp_path / "a.png"
    result = done(export, run, "-p", "p=0.3", "-p", "isovalue=0.4", "--view", 2, "-o", output)
    drawn = to_bytes(following().at(p=0.3, isovalue=0.4).render(camera(run, 2)))
    np.testing.assert_array_equal(read_image(output), np.minimum(drawn, drawn[..., 3:]))
    assert result.stdout == f"{output}: 24x24, p = 0.3, isovalue = 0.4\n"
    record = record_of(output)
    assert (record["parameters"], record["visualization"], record["background"]) == (
        {"p": 0.3},
        {"isovalue": 0.4},
        None,
    )


def test_an_exr_keeps_every_bit_at_any_size_on_any_background(run: Path, tmp_path: Path) -> None:
    output = tmp_path / "a.exr"
    done(export, run, "-p", "p=0.3", "--color-map", "turbo", "--size", "40x30", "--background", "0.2,1,0", "-o", output)
    setting = Setting({"p": 0.3}, {}, "turbo")
    expected = setting.member(following()).render(camera(run, 0).resized(40, 30), background=(0.2, 1.0, 0.0))
    np.testing.assert_array_equal(read_image(output, dtype="float32"), expected)


def test_a_ply_holds_the_gaussians_and_needs_no_catalog(tmp_path: Path) -> None:
    plain().save(tmp_path / "surrogate")
    result = done(export, tmp_path, "--refit", 0, "-o", tmp_path / "a.ply")
    assert (tmp_path / "a.ply").read_bytes() == ply_bytes(Splats.of(plain().at(p=0.5)))  # the middle of the bounds
    assert result.stdout == f"{tmp_path / 'a.ply'}: 12 Gaussians, p = 0.5\n"


def test_without_a_catalog_the_whole_volume_is_seen(tmp_path: Path) -> None:
    plain().save(tmp_path / "surrogate")
    for view in (0, 251):
        done(export, tmp_path, "--view", view, "--size", "64", "-o", tmp_path / "a.png")
        alpha = read_image(tmp_path / "a.png")[..., 3]
        assert alpha.max() > 100
        assert not alpha[[0, -1]].any()
        assert not alpha[:, [0, -1]].any()


def test_a_picture_can_be_made_like_another(run: Path, tmp_path: Path) -> None:
    first, again, other = (tmp_path / name for name in ("first.png", "again.exr", "other.png"))
    options = ("-p", "p=0.3", "-p", "c1_value=1.25", "--color-map", "viridis", "--view", 3, "--background", "1,0,0")
    done(export, run, *options, "-o", first)
    done(export, run, "--like", first, "-o", again)
    setting, seen = Setting({"p": 0.3}, {"c1_value": 0.25}, "viridis"), camera(run, 3)
    expected = setting.member(following()).render(seen, background=(1.0, 0.0, 0.0))
    np.testing.assert_array_equal(read_image(again, dtype="float32"), expected)
    done(export, run, "--like", again, "-p", "p=0.8", "--size", "48", "-o", other)
    record = record_of(other)
    assert (record["parameters"], record["visualization"]) == ({"p": 0.8}, {"c1_value": 0.25})
    assert (record["camera"]["width"], record["color_map"]) == (48, "viridis")


def test_a_strip_and_a_grid(run: Path, tmp_path: Path) -> None:
    result = done(sweep, run, "--over", "isovalue", "--steps", 3, "-p", "p=0.2", "-o", tmp_path / "a.png")
    assert result.stdout == f"{tmp_path / 'a.png'}: 3 pictures over isovalue 0.1..0.8, p = 0.2\n"
    strip = np.asarray(Image.open(tmp_path / "a.png"))
    places = sorted(
        found(strip, setting, camera(run, 0))
        for setting in settings(Sweep(Setting({"p": 0.2}), Axis("isovalue", 0.1, 0.8, 3)))
    )
    assert len(places) == 3
    assert record_of(tmp_path / "a.png")["parameters"] == {"p": 0.2}
    grid = ("--over", "p", "--steps", 2, "--rows", "c1_value", "--rows-steps", 3, "--rows-from", 0.9, "--rows-to", 1.1)
    done(sweep, run, *grid, "--background", "0,0,0", "-o", tmp_path / "grid.png")
    assert np.asarray(Image.open(tmp_path / "grid.png")).shape[0] > 3 * 24


def found(sheet: np.ndarray, setting: Setting, seen_by: Camera) -> tuple[int, int]:
    """The place of a setting's image on white in a sheet."""
    picture = to_bytes(setting.member(following()).render(seen_by, background=(1, 1, 1))[..., :3])
    height, width = picture.shape[:2]
    windows = np.lib.stride_tricks.sliding_window_view(sheet, (height, width, 3))[:, :, 0]
    (place,) = np.argwhere((windows == picture).all(axis=(2, 3, 4)))
    return int(place[1]), int(place[0])


def test_a_folder_gets_a_file_of_its_own_name(run: Path, tmp_path: Path) -> None:
    for values in ("p=0.3", "p=0.4"):
        result = done(export, run, "-p", values, "-o", tmp_path)
        assert Path(result.stdout.split(": ")[0]).is_file()
    assert sorted(path.name[:11] for path in tmp_path.iterdir()) == ["blobs-p-0.3", "blobs-p-0.4"]


@pytest.mark.slow
def test_two_settings_are_compared(run: Path, tmp_path: Path) -> None:
    output = tmp_path / "a.png"
    result = done(export, run, "-p", "p=0.3", "--compare", "c2_opacity=0.7", "--size", "2x", "-o", output)
    assert result.stdout == f"{output}: p = 0.3 beside p = 0.3, c2_opacity = 0.7\n"
    sheet, seen = np.asarray(Image.open(output)), camera(run, 0).resized(48, 48)
    shown = [Setting({"p": 0.3}), Setting({"p": 0.3}, {"c2_opacity": 0.2})]
    places = [found(sheet, setting, seen) for setting in shown]
    assert places[0] < places[1]
    assert record_of(output)["other"]["visualization"] == pytest.approx({"c2_opacity": 0.2})


def test_a_stored_picture_is_compared(run: Path, tmp_path: Path) -> None:
    output = tmp_path / "a.png"
    result = done(export, run, "-p", "p=0", "--compare", "stored", "--view", 3, "-o", output)
    assert result.stdout == f"{output}: p = 0 beside its stored picture\n"
    wrong = invoke(export, run, "-p", "p=0", "--compare", "stored", "--size", "48", "-o", output)
    assert "the stored picture has 24x24 pixels: compare at this size" in wrong.stderr


def test_what_error_to_expect_is_kept_once_it_is_measured(run_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "blobs"
    shutil.copytree(run_folder, folder, ignore=shutil.ignore_patterns("answers"))
    done(export, folder, "-p", "p=0.3", "-o", tmp_path / "a.png")
    assert record_of(tmp_path / "a.png")["expected"] is None
    run = Run.open(folder)
    assert run.catalog is not None
    Doubt.of(run.surrogate, run.catalog, run.folder)
    result = done(export, folder, "-p", "p=0.3", "-o", tmp_path / "a.png")
    expected = record_of(tmp_path / "a.png")["expected"]
    assert expected["psnr"] > 40
    assert result.stdout.splitlines()[1] == expected["said"]
    result = done(export, folder, "-p", "p=1.3", "-o", tmp_path / "b.exr")
    expected = record_of(tmp_path / "b.exr")["expected"]
    assert (expected["psnr"], expected["low"]) == (None, None)
    assert expected["said"].startswith("never shown in training: parameter p = 1.3")


@pytest.mark.parametrize("ending", ["gif", "mp4"])
def test_films(run: Path, tmp_path: Path, ending: str) -> None:
    if ending == "mp4":
        pytest.importorskip("av")
    output = tmp_path / f"a.{ending}"
    done(sweep, run, "--over", "p", "--steps", 4, "--there-and-back", "--fps", 10, "--no-caption", "-o", output)
    content = output.read_bytes()
    if ending == "gif":
        image: Any = Image.open(io.BytesIO(content))
        assert (image.n_frames, image.size, image.info["duration"]) == (6, (24, 24), 100)
    else:
        import av

        with av.open(io.BytesIO(content)) as container:
            assert len([*container.decode(video=0)]) == 6
    done(sweep, run, "--over", "p", "--steps", 4, "-o", output)
    assert len(output.read_bytes()) != len(content)  # with captions


def test_extrapolation_is_reported(run: Path, tmp_path: Path) -> None:
    result = done(export, run, "-p", "p=1.5", "--refit", 0, "-o", tmp_path / "a.ply")
    assert result.stderr == "p = 1.5 lies outside its bounds [0, 1]: extrapolating beyond the training range\n"
    result = done(sweep, run, "--over", "p", "--to", 2, "--steps", 2, "-o", tmp_path / "a.png")
    assert "p = 0 to 2 lies outside its bounds [0, 1]: extrapolating beyond the training range\n" in result.stderr


@pytest.mark.parametrize(
    ("command", "arguments", "complaint"),
    [
        (export, ("-o", "a.tiff"), "must end with one of .png, .exr, .html, .site, .ply, .glb, .spz, .vti, got a.tiff"),
        (export, ("-o", "a.vti"), "this surrogate knows no field values: its catalog keeps no coarse fields"),
        (export, ("-a", "dvr", "-o", "a.png"), "-a names fields of a .vti file, got a.png"),
        (export, ("-o", "absent/a.png"), "absent is not a folder: make it first"),
        (
            export,
            ("-p", "q=1", "-o", "a.png"),
            "unknown parameter q: this surrogate has p, c1_value, c1_opacity, c2_value, c2_opacity, isovalue",
        ),
        (export, ("-p", "p", "-o", "a.png"), "given as NAME=VALUE, got 'p'"),
        (export, ("-p", "p=a", "-o", "a.png"), "given as NAME=VALUE, got 'p=a'"),
        (export, ("-p", "p=nan", "-o", "a.png"), "p must be finite"),
        (export, ("--view", "5", "-o", "a.png"), "view must lie in 0..4, got 5"),
        (export, ("--size", "big", "-o", "a.png"), "WIDTHxHEIGHT, or as 2x, got 'big'"),
        (export, ("--size", "0x4", "-o", "a.png"), "a side has 1 to 8192 pixels, got 0x4"),
        (export, ("--background", "1,1", "-o", "a.png"), "given as R,G,B"),
        (export, ("--background", "1,1,2", "-o", "a.png"), "lies in [0, 1], got 1,1,2"),
        (export, ("--color-map", "jet", "-o", "a.png"), "color_map must be one of viridis"),
        (export, ("--like", __file__, "-o", "a.png"), "no record can be read from"),
        (sweep, ("--over", "p", "-o", "a.exr"), "must end with one of .png, .gif, .mp4, got a.exr"),
        (sweep, ("--over", "q", "-o", "a.png"), "unknown parameter 'q': this surrogate has "),
        (sweep, ("--over", "p", "--steps", "500", "-o", "a.png"), "2 to 200 steps, got 500"),
        (sweep, ("--over", "p", "--from", "2", "-o", "a.png"), "to a larger one, got 2 to 1"),
        (sweep, ("--over", "p", "--rows", "p", "-o", "a.png"), "two different parameters, got p twice"),
        (sweep, ("--over", "p", "--rows", "isovalue", "-o", "a.gif"), "a film goes over one parameter"),
        (
            export,
            ("-p", "p=99", "-o", "a.png"),
            "p = 99 lies too far outside its bounds [0, 1]: it can be drawn from -1 to 2",
        ),
        (export, ("-p", "isovalue=100", "-o", "a.png"), "isovalue = 100 lies too far outside its bounds [0.1, 0.8]"),
        (export, ("-p", "c1_value=9", "-o", "a.png"), "c1_value = 9 lies too far outside its bounds [0.6, 1.4]"),
        (export, ("-p", "c1_opacity=1.04", "-o", "a.png"), "opacity_points must"),
        (export, ("--compare", "p=99", "-o", "a.png"), "p = 99 lies too far outside"),
        (export, ("--compare", "p=0.2", "-o", "a.exr"), "a comparison is a PNG, got a.exr"),
        (export, ("--compare", "stored", "-o", "a.png"), "the catalog has no picture of this"),
        (sweep, ("--over", "isovalue", "--to", "100", "-o", "a.png"), "isovalue = 100 lies too far outside"),
        (
            sweep,
            ("--over", "c1_value", "--to", "9", "-o", "a.png"),
            "c1_value = 9 lies too far outside its bounds [0.6, 1.4]",
        ),
        (sweep, ("--over", "c1_value", "--to", "2.1", "-o", "a.png"), "can't be shown at c1_value = 2.1"),
    ],
)
def test_mistakes_are_named_in_one_line_and_nothing_is_written(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: click.Command, arguments: Any, complaint: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = invoke(command, run, *arguments)
    assert result.exit_code == 1
    assert complaint in result.stderr
    assert result.stderr.splitlines()[-1].startswith("Error: ")
    assert list(tmp_path.iterdir()) == []


def test_the_commands_load_nothing_heavy() -> None:
    program = (
        "import sys, surrogate.explore.exporting.commands\n"
        "print([n for n in ('torch', 'numpy', 'matplotlib', 'PIL', 'av', 'aiohttp') if n in sys.modules])"
    )
    project = Path(__file__).resolve().parents[4]
    result = subprocess.run([sys.executable, "-c", program], cwd=project, capture_output=True, text=True, timeout=60)
    assert result.stdout.strip() == "[]", result.stdout + result.stderr


def test_a_model_that_is_not_there_is_named(tmp_path: Path) -> None:
    result = invoke(export, tmp_path, "-o", tmp_path / "a.png")
    assert result.exit_code == 1
    assert "there is no trained surrogate in" in result.stderr
    assert not Surrogate.exists(tmp_path)


def test_a_new_folder_is_made(run: Path, tmp_path: Path) -> None:
    """Also by a comparison, which has no ending that says it."""
    for number, more in enumerate(((), ("--compare", "p=0.5"))):
        done(export, run, "--size", "8x8", *more, "-o", tmp_path / f"new{number}")
        (picture,) = (tmp_path / f"new{number}").iterdir()
        assert picture.suffix == ".png"
    refused = invoke(export, run, "--compare", "p=0.5", "--size", "8x8", "-o", tmp_path / "absent" / "new")
    assert "absent is not a folder: make it first" in refused.stderr
