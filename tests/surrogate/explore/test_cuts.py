"""Settings that are cut: from messages, records and options, drawn by the emulated field alone, and never promised an error."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from catalogs.vocabulary.cameras import Camera
from native.ray_casting import Cut
from surrogate.answers.doubt import NEVER, Doubt
from surrogate.emulation import FieldEmulator
from surrogate.explore.cuts import cut_in, cut_of, record_of_cut
from surrogate.explore.exporting.exports import GaussiansRequest, PictureRequest
from surrogate.explore.exporting.naming import file_name
from surrogate.explore.exporting.options import from_options
from surrogate.explore.exporting.pictures import record_for
from surrogate.explore.exporting.snippet import snippet
from surrogate.explore.request import MessageError, setting_of
from surrogate.explore.run import Run
from surrogate.explore.server.frames import Frames
from surrogate.explore.setting import Setting
from tests.support.drawn_models import carrying
from tests.support.emulated_models import BOX, SPAN, both, cameras, surfaces

LOW, HIGH = (tuple(map(float, BOX[0] + SPAN * share)) for share in (0.2, 0.7))
PLANE = (2, float(BOX[0][2] + 0.4 * SPAN[2]))
RECORDS: dict[str, dict[str, Any]] = {
    "box": {"clip": [*LOW, *HIGH]},
    "slice": {"slice": ["z", PLANE[1]]},
    "both": {"clip": [*LOW, *HIGH], "slice": ["z", PLANE[1]]},
}


def setting(name: str, **more: Any) -> Setting:
    return Setting(both().space.middle, cut=cut_of(RECORDS[name]), **more)


@pytest.mark.parametrize("name", RECORDS)
def test_records_hold_cuts_and_settings_draw_them(name: str) -> None:
    surrogate, camera, own = both(), cameras()[0], setting(name)
    message = {"parameters": surrogate.space.middle, **RECORDS[name]}
    assert setting_of(json.loads(json.dumps(message)), surrogate) == own
    assert record_of_cut(own.cut) == RECORDS[name]
    assert RECORDS[name].items() <= record_for(surrogate, own, camera, None).items()
    member = surrogate.using("field").at(surrogate.space.middle)
    if "clip" in RECORDS[name]:
        member = member.within(LOW, HIGH)  # type: ignore[union-attr]
    if "slice" in RECORDS[name]:
        member = member.slice("z", PLANE[1])  # type: ignore[union-attr]
    expected = member.render(camera)
    assert (
        0.0
        < expected[..., 3].mean()
        < surrogate.using("field").at(surrogate.space.middle).render(camera)[..., 3].mean()
    )
    np.testing.assert_array_equal(own.member(surrogate).render(camera), expected)
    np.testing.assert_array_equal(Frames(surrogate).member(own).render(camera), expected)
    assert own.drawn_by(surrogate) == "field"
    assert str(own.cut) in str(own)


def test_a_box_that_moves_computes_no_field_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    frames, parameters, computed = Frames(both()), both().space.middle, []
    at = FieldEmulator.at
    monkeypatch.setattr(FieldEmulator, "at", lambda self, point: computed.append(point) or at(self, point))
    for share in (0.3, 0.5, 0.7):
        place = float(BOX[0][2] + share * SPAN[2])
        for cut in (Cut((LOW, (*HIGH[:2], place))), Cut(None, (2, place))):
            assert frames.member(Setting(parameters, cut=cut)).render(cameras()[0]).any()
    assert len(computed) == 1


@pytest.mark.parametrize("using", ["gaussians", "both"])
def test_gaussians_are_not_cut(using: str) -> None:
    surrogate, own = both(), setting("both", using=using)
    with pytest.raises(ValueError, match="can't be cut or sliced, only one from the emulated field"):
        own.member(surrogate)
    with pytest.raises(MessageError, match="can't be cut or sliced, only one from the emulated field"):
        setting_of({"parameters": own.parameters, "using": using, **RECORDS["box"]}, surrogate)
    member = surrogate.using(using).at(own.parameters)
    for call in (lambda: member.within(LOW, HIGH), lambda: member.slice("x", 0.0)):
        with pytest.raises(ValueError, match=r'Gaussians can\'t be cut exactly.*surrogate.using\("field"\)'):
            call()
    with pytest.raises(ValueError, match=r"a \.ply holds whole Gaussians: reset the clip box and the slice"):
        GaussiansRequest(setting("box")).content(Run("a run", surrogate), lambda *_: None)


def test_a_surrogate_without_a_field_says_so() -> None:
    with pytest.raises(ValueError, match="only an emulated field can be cut or sliced, and this surrogate has none"):
        Setting(carrying().space.middle, cut=Cut(None, PLANE)).member(carrying())


def test_surfaces_are_cut_but_have_no_slice() -> None:
    surrogate = surfaces()
    member = surrogate.at(surrogate.space.middle, isovalue=0.1)
    assert 0 < member.within(LOW, HIGH).render(cameras()[0])[..., 3].sum() < member.render(cameras()[0])[..., 3].sum()  # type: ignore[union-attr]
    with pytest.raises(ValueError, match="an isosurface has none: show the volume"):
        member.slice("x", 0.0)  # type: ignore[union-attr]
    with pytest.raises(ValueError, match="an isosurface has none: show the volume"):
        Setting(surrogate.space.middle, {"isovalue": 0.1}, cut=Cut(None, PLANE)).member(surrogate)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda m: m.within((0, 0), (1, 1, 1)), "low"),
        (lambda m: m.within((0, 0, 0), (1, 1, float("nan"))), "high"),
        (lambda m: m.within((0, 2, 0), (1, 1, 1)), "got y 2 to 1"),
        (lambda m: m.within("abc", (1, 1, 1)), "low"),
        (lambda m: m.slice("w", 0.0), "perpendicular to x, y or z, got 'w'"),
        (lambda m: m.slice(["x"], 0.0), "perpendicular to x, y or z"),
        (lambda m: m.slice("x", float("inf")), "at"),
        (lambda m: m.slice("x", "0.5"), "at"),
    ],
)
def test_wrong_cuts_are_refused_in_python(call: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        call(both().using("field").at(both().space.middle))


def test_no_error_is_promised_of_what_is_cut() -> None:
    surrogate = both()
    processes: Any = SimpleNamespace(open_share=lambda _: 0.5, usual_shares=(0.4, 0.8))
    doubt = Doubt(surrogate, {}, processes, None, None, None, None)
    interval = setting("box").doubted(doubt).interval(cameras()[0])
    assert (interval.words, interval.psnr) == (NEVER, None)
    assert interval.short == f"{NEVER}: no stored image is cut or sliced"


@pytest.mark.parametrize("name", RECORDS)
def test_the_code_draws_the_same_picture(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    surrogate, camera, own = both(), cameras()[0].resized(24, 20), setting(name)
    surrogate.save(tmp_path / "surrogate")
    monkeypatch.chdir(tmp_path)
    space: dict[str, Any] = {}
    exec(snippet(tmp_path / "surrogate", surrogate, own, camera, None), space)
    np.testing.assert_array_equal(space["picture"], own.member(surrogate).render(camera))


OPTIONS = {"parameters": (), "color_map": "", "using": "", "size": "", "background": "", "view": 0}


@pytest.mark.parametrize("name", RECORDS)
def test_a_picture_like_another_is_cut_alike(name: str, tmp_path: Path) -> None:
    run, camera = Run("a run", both()), cameras()[0].resized(24, 20)
    (tmp_path / "first.png").write_bytes(
        PictureRequest(setting(name), camera, (1.0, 0.5, 0.0)).content(run, lambda *_: None)
    )
    again = from_options({**OPTIONS, "like": tmp_path / "first.png"}, "png", run)
    assert again.setting == setting(name)  # type: ignore[union-attr]
    assert again.content(run, lambda *_: None) == (tmp_path / "first.png").read_bytes()
    other = from_options({**OPTIONS, "like": tmp_path / "first.png", "slice": "x=-29"}, "png", run)
    assert other.setting.cut == Cut(setting(name).cut.box, (0, -29.0))  # type: ignore[union-attr]


def test_files_that_hold_everything_are_not_cut() -> None:
    for kind in ("ply", "glb", "html", "site", "vti"):
        with pytest.raises(ValueError, match=f"--clip and --slice cut pictures and films, not .{kind} files"):
            from_options({**OPTIONS, "slice": "z=3"}, kind, Run("a run", both()))


def test_names_of_files_say_what_is_cut() -> None:
    run, camera = (
        Run("a run", both()),
        Camera.look_at((3, 0, 0), (0, 0, 0), vertical_fov_degrees=40.0, width=8, height=8),
    )
    names = {name: file_name(run, PictureRequest(setting(name), camera)) for name in RECORDS}
    assert "clip" in names["box"]
    assert "slice-z" in names["slice"]
    assert len(set(names.values())) == 3


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (("1,2,x", ""), "--clip takes X0,Y0,Z0,X1,Y1,Z1"),
        (("", "z"), "--slice takes AXIS=PLACE"),
        (("", "z=z"), "--slice takes"),
    ],
)
def test_other_options_are_refused(texts: tuple[str, str], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        cut_in(*texts)
