"""Promise: tracks of other programs are read as those programs write them, or refused by name.

The files are made here as the programs' documentation describes them: DeepLabCut's tables by
pandas, SLEAP's analysis by h5py, the others as text.
"""

from __future__ import annotations

import numpy as np
import pytest
from rodgym import lab
from rodgym.cli import main
from rodgym.errors import ParameterError

NAMES = ("base", "m1", "m2", "tip")
#: Metres of a pixel, and the pixel of the origin.
SCALE, ORIGIN = 4e-4, (640.0, 100.0)
FRAMES = 15
TIMES = np.arange(FRAMES) / 30


@pytest.fixture(scope="module")
def points():
    """True places [m], y up, (frames, markers, 2)."""
    turn = 0.5 * np.cos(8 * TIMES)[:, None]
    along = np.linspace(0.0, 0.3, len(NAMES))
    return np.stack([along * np.sin(turn), -along * np.cos(turn)], axis=2)


@pytest.fixture(scope="module")
def pixels(points):
    return points * [1, -1] / SCALE + ORIGIN


def deeplabcut(pixels, individuals=()):
    pandas = pytest.importorskip("pandas")
    levels, values = [["DLC_resnet50"]], []
    for i, _ in enumerate(individuals or ("",)):
        sure = np.full((FRAMES, len(NAMES), 1), 0.98)
        values.append(np.concatenate([pixels + 100 * i, sure], axis=2).reshape(FRAMES, -1))
    levels += [list(individuals)] if individuals else []
    levels += [list(NAMES), ["x", "y", "likelihood"]]
    names = ["scorer", *(["individuals"] if individuals else []), "bodyparts", "coords"]
    columns = pandas.MultiIndex.from_product(levels, names=names)
    return pandas.DataFrame(np.concatenate(values, axis=1), columns=columns)


def rows(values, delimiter=","):
    return "\n".join(
        delimiter.join("" if v != v else repr(float(v)) for v in row) for row in values
    )


def xypts(pixels, cameras=1):
    head = [f"pt{p + 1}_cam{c + 1}_{a}" for p in range(4) for c in range(cameras) for a in "XY"]
    cells = np.repeat(pixels[:, :, None] + 1, cameras, axis=2).reshape(FRAMES, -1)
    body = rows(cells).replace(",,", ",NaN,")
    return ",".join(head) + "\n" + body + "\n"


def sleap_csv(pixels):
    head = "track,frame_idx,instance.score," + ",".join(
        f"{name}.x,{name}.y,{name}.score" for name in NAMES
    )
    lines = [
        f"rod,{i},0.9," + ",".join(f"{x!r},{y!r},0.9" for x, y in frame.tolist())
        for i, frame in enumerate(pixels)
    ]
    return "\n".join([head, *lines]) + "\n"


def tracker(points, comma=False):
    titles = "\t" + "\t\t".join(f"mass {c}" for c in "ABCD") + "\t\t"
    table = np.column_stack([TIMES, points.reshape(FRAMES, -1)])
    body = rows(table, "\t").replace(".", ",") if comma else rows(table, "\t")
    body = body.replace("\n", "\t\n")
    return "#multi:\n" + titles + "\nt\tx\ty" + "\tx\ty" * 3 + "\t\n" + body + "\t\n"


def plain(points, factor, head="time [s],x1 [mm],y1 [mm]"):
    start, *pair = head.split(",")
    names = [start, *(cell.replace("1", str(i)) for i in range(1, 5) for cell in pair)]
    table = np.column_stack([TIMES, factor * points.reshape(FRAMES, -1)])
    return ",".join(names) + "\n" + rows(table) + "\n"


def test_every_format_tells_the_same_rod(points, pixels, tmp_path):
    h5py, parquet = pytest.importorskip("h5py"), pytest.importorskip("pyarrow.parquet")
    pytest.importorskip("tables")
    import pyarrow

    table = deeplabcut(pixels)
    table.to_csv(tmp_path / "dlc.csv")
    table.to_hdf(tmp_path / "dlc.h5", key="df_with_missing", format="table", mode="w")
    deeplabcut(pixels, ("mouse", "rod")).to_csv(tmp_path / "many.csv")
    (tmp_path / "xypts.csv").write_text(xypts(pixels))
    (tmp_path / "two-xypts.csv").write_text(xypts(pixels, cameras=2))
    (tmp_path / "sleap.csv").write_text(sleap_csv(pixels))
    with h5py.File(tmp_path / "analysis.h5", "w") as file:
        file["tracks"] = np.transpose(pixels[None], (0, 3, 2, 1))
        file["node_names"] = [name.encode() for name in NAMES]
        file["track_names"] = [b"rod"]
        file["point_scores"] = np.full((1, len(NAMES), FRAMES), 0.9)
    with h5py.File(tmp_path / "dots.h5", "w") as file:
        file["tracks"] = np.transpose(pixels, (1, 2, 0))[:, :, None]
        file["node_names"] = [b"dot"]
        file["track_names"] = [name.encode() for name in NAMES]
    (tmp_path / "tracker.txt").write_text(tracker(points))
    (tmp_path / "komma.txt").write_text(tracker(points, comma=True))
    (tmp_path / "mm.csv").write_text(plain(points, 1e3))
    (tmp_path / "ms.csv").write_text(plain(points, 1.0, "time_s,x1 (m),y1 (m)"))
    lab.Tracks(TIMES, points).write_tidy(tmp_path / "tidy.csv")
    wide = {
        "time": TIMES,
        **{f"{a}{i + 1}": points[:, i, "xy".index(a)] for i in range(4) for a in "xy"},
    }
    parquet.write_table(pyarrow.table(wide), tmp_path / "film.parquet")

    film = {"rate": 30.0, "scale": SCALE, "origin": ORIGIN}
    # Times and units are said where a file does not have them.
    asked = {
        "dlc.csv": film,
        "dlc.h5": film,
        "many.csv": {**film, "animal": "mouse"},
        "xypts.csv": film,
        "two-xypts.csv": {**film, "camera": "1"},
        "sleap.csv": film,
        "analysis.h5": film,
        "dots.h5": film,
        **{f"{name}.csv": {} for name in ("mm", "ms", "tidy")},
        **{name: {} for name in ("tracker.txt", "komma.txt", "film.parquet")},
    }
    for name, words in asked.items():
        read = lab.read_tracks(tmp_path / name, **words)
        assert np.allclose(read.points, points, rtol=0, atol=1e-12), name
        assert np.allclose(read.times, TIMES), name


def test_guesses_are_said(pixels, tmp_path):
    moved = deeplabcut(pixels)
    moved.iloc[3, 5] = 0.2
    moved.drop(index=[6, 7]).to_csv(tmp_path / "dlc.csv")
    read = lab.read_tracks(tmp_path / "dlc.csv", rate=30, scale=SCALE)
    told = " ".join(read.notes)
    for word in (
        "read as DeepLabCut",
        "base, m1, m2, tip",
        "downwards",
        "1 positions are less sure",
    ):
        assert word in told
    assert np.isnan(read.points[3, 1]).all() and np.isfinite(read.points[3, 0]).all()
    # Frames that are not there leave a gap in time.
    assert len(read.times) == FRAMES - 2 and np.isclose(np.diff(read.times).max(), 0.1)


def test_markers_are_put_in_order_and_axes_turned(points, pixels, tmp_path):
    deeplabcut(pixels[:, ::-1]).to_csv(tmp_path / "dlc.csv")
    words = {"rate": 30, "scale": SCALE, "origin": ORIGIN}
    read = lab.read_tracks(tmp_path / "dlc.csv", markers=NAMES[::-1], **words)
    assert np.allclose(read.points, points)
    # Seen along an x axis that points up, what hung down goes to the left.
    turned = lab.read_tracks(tmp_path / "dlc.csv", markers=NAMES[::-1], axis=90.0, **words)
    assert np.allclose(turned.points[..., 0], points[..., 1])
    assert np.allclose(turned.points[..., 1], -points[..., 0])


REFUSED = {
    "no times": (xypts, {"scale": 1e-3}, lab.FramesError, "--rate"),
    "pixels": (xypts, {"rate": 30}, lab.UnitsError, "--scale"),
    "two cameras": (
        lambda p: xypts(p, 2),
        {"rate": 30, "scale": 1e-3},
        lab.ChoiceError,
        "--camera",
    ),
    "no such camera": (xypts, {"camera": "3"}, lab.ChoiceError, "there are 1"),
    "half a point": (
        lambda p: xypts(p).replace("pt2_cam1_Y", "pt9_cam1_Y"),
        {},
        lab.HeaderError,
        "pt2_cam1_Y",
    ),
    "no point": (
        lambda p: xypts(p).replace("pt2_cam1_Y", "depth"),
        {},
        lab.HeaderError,
        "column 4",
    ),
    "a word": (
        lambda p: xypts(p).replace("641.0", "lost", 1),
        {},
        lab.CellError,
        "line 2, column pt1_cam1_X",
    ),
    "no coords": (lambda _: "scorer,a\nbodyparts,b\n0,1\n", {}, lab.HeaderError, "'coords'"),
    "ragged": (
        lambda _: "scorer,a,a\nbodyparts,b,b\ncoords,x\n",
        {},
        lab.HeaderError,
        "different lengths",
    ),
    "no y": (
        lambda _: "scorer,a\nbodyparts,b\ncoords,x\n0,1\n",
        {},
        lab.HeaderError,
        "'b' has no column 'y'",
    ),
    "no node": (
        lambda p: sleap_csv(p).replace("m1.y", "m1y"),
        {},
        lab.HeaderError,
        "not of the form",
    ),
    "twice": (
        lambda p: sleap_csv(p).replace("rod,4,", "rod,3,"),
        {},
        lab.CellError,
        "line 6: rod is there twice",
    ),
    "one track": (lambda _: "mass A\nt\tx\ty\n0\t1\t2\n", {}, lab.HeaderError, "1 tracks"),
    "speeds": (lambda _: "mass A\nt\tx\tv\n0\t1\t2\n", {}, lab.HeaderError, "'v'"),
    "no such marker": (
        xypts,
        {"rate": 30, "scale": 1e-3, "markers": ("pt1", "nose")},
        lab.OrderError,
        "'nose'",
    ),
    "marker twice": (
        xypts,
        {"rate": 30, "scale": 1e-3, "markers": ("pt1", "pt1")},
        lab.OrderError,
        "twice",
    ),
    "two units": (
        lambda p: plain(p, 1.0, "time,x1 [mm],y1 [cm]"),
        {},
        lab.UnitsError,
        "'cm' and 'mm'",
    ),
    "another unit": (lambda p: plain(p, 1.0), {"unit": "cm"}, lab.UnitsError, "says .* in mm"),
    "feet": (lambda p: plain(p, 1.0, "time,x1 [ft],y1 [ft]"), {}, lab.UnitsError, "'ft'"),
    "frames as times": (
        lambda p: plain(p, 1.0, "frame,x1 [m],y1 [m]"),
        {},
        lab.FramesError,
        "--rate",
    ),
    "rate beside times": (lambda p: plain(p, 1.0), {"rate": 30}, lab.FramesError, "of its own"),
    "hours": (lambda p: plain(p, 1.0, "time [h],x1 [m],y1 [m]"), {}, lab.UnitsError, "'h'"),
    "tidy, twice": (
        lambda _: "time,marker,x,y\n" + "".join(f"0,{m},0,0\n" for m in "abca"),
        {},
        lab.CellError,
        "marker a is there twice",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_known_is_refused_by_name(case, pixels, tmp_path):
    make, words, error, says = REFUSED[case]
    path = tmp_path / "film.csv"
    path.write_text(make(pixels))
    with pytest.raises(error, match=says):
        lab.read_tracks(path, **words)


def test_files_that_are_no_tracks_are_refused_by_name(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["numbers"] = [1, 2, 3]
    (tmp_path / "text.h5").write_text("no hdf")
    (tmp_path / "film.mp4").write_bytes(b"\x00\x00\x00\x20ftypisom\xff\xfe")
    for name in ("other.h5", "text.h5", "film.mp4", "missing.csv"):
        with pytest.raises(lab.FormatError):
            lab.read_tracks(tmp_path / name)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ({"unit": "inch"}, "unit"),
        ({"scale": -1.0}, "scale"),
        ({"y": "left"}, "'up' or 'down'"),
        ({"confidence": 2.0}, "confidence"),
        ({"rate": 0.0}, "rate"),
    ],
)
def test_arguments_that_mean_nothing_are_refused(words, says, pixels, tmp_path):
    path = tmp_path / "dlc.csv"
    deeplabcut(pixels).to_csv(path)
    with pytest.raises(ParameterError, match=says):
        lab.read_tracks(path, **{"rate": 30, "scale": 1e-3, **words})


def test_the_program_says_what_is_missing(pixels, tmp_path, capsys):
    path = tmp_path / "xypts.csv"
    path.write_text(xypts(pixels))
    assert main(["fit", str(path)]) != 0
    assert "--rate" in capsys.readouterr().err
