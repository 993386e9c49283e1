"""Promise: a film becomes markers in metres, through a lens, noise and short losses, or a refusal.

The film is *synthetic*: our renderer's rod and a checkerboard before the thesis' camera (focal
lengths, distortion and board of its appendix A), with exposure, blur, noise and compression.
"""

from __future__ import annotations

import csv

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2")

from rodgym import lab  # noqa: E402
from rodgym.cli import main  # noqa: E402
from rodgym.errors import ParameterError  # noqa: E402
from rodgym.lab.bench import Bench  # noqa: E402
from rodgym.lab.vision import (  # noqa: E402
    Board,
    Camera,
    Look,
    calibrate,
    synthetic,
    track,
)
from rodgym.lab.vision.follow import follow, path  # noqa: E402
from rodgym.lab.vision.markers import Spots, spots  # noqa: E402
from rodgym.lab.vision.plane import plane_of  # noqa: E402

yaml = pytest.importorskip("yaml")

ROD = {"youngs_modulus": 8.3e6, "bending_damping": 6e-4}
BENCH = Bench(rod=ROD, seconds=1.2)


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(threads)


@pytest.fixture(scope="module")
def film(tmp_path_factory):
    path = tmp_path_factory.mktemp("film") / "film.mp4"
    return path, synthetic.film(path, BENCH, seed=5)


@pytest.fixture(scope="module")
def tracked(film, tmp_path_factory):
    """What `rodgym track` writes."""
    out = tmp_path_factory.mktemp("track") / "out"
    assert main(["track", str(film[0]), "--board", "10x7:7.34mm", "--out", str(out)]) == 0
    return out


def test_a_film_of_the_thesis_camera_is_tracked_to_three_tenths_of_a_millimetre(film, tracked):
    truth = film[1]
    about = yaml.safe_load((tracked / "camera.yml").read_text())
    assert about["camera"]["reprojection_error"] < 0.3
    assert about["plane"]["reprojection_error"] < 0.3
    known = truth.optics.camera
    assert np.allclose(about["camera"]["focal_length"], np.diag(known.matrix)[:2], rtol=0.01)
    assert np.allclose(about["camera"]["distortion"][:2], known.distortion[:2], atol=0.02)
    assert abs(about["first_frame"] - truth.first) <= 0
    found = lab.read_tracks(tracked / "tracks.csv")
    assert found.points.shape == truth.tracks.points.shape
    assert np.isfinite(found.points).mean() > 0.98
    assert np.nanmedian(found.confidence) > 0.8
    # The truth has its own origin, and "up" is the picture's: turned and moved onto each other.
    gap = aligned(found.points, truth.tracks.points)
    assert np.nanmedian(gap) < 1.5e-4
    assert np.sqrt(np.nanmean(gap**2)) < 3e-4
    assert np.nanpercentile(gap, 95) < 3e-4


def aligned(points, truth):
    """Distances after the best turn and shift, without a change of scale."""
    seen = np.isfinite(points[..., 0])
    ours, theirs = (cloud[seen] @ [1, 1j] for cloud in (points, truth))
    ours, theirs = ours - ours.mean(), theirs - theirs.mean()
    gap = np.full(points.shape[:2], np.nan)
    gap[seen] = np.abs(ours * np.exp(1j * np.angle(np.vdot(ours, theirs))) - theirs)
    return gap


def test_a_film_leads_to_the_rod_that_it_shows(film, tracked, tmp_path):
    words = ["--known", "width=0.007", "--known", "length=0.3", "--out", str(tmp_path / "fit")]
    words += ["--on", str(film[0])]
    assert main(["fit", str(tracked / "tracks.csv"), *words]) == 0
    rod = yaml.safe_load((tmp_path / "fit" / "rod.yml").read_text())
    assert abs(rod["parameters"]["youngs_modulus"]["value"] / ROD["youngs_modulus"] - 1) < 0.01
    assert abs(rod["parameters"]["bending_damping"]["value"] / ROD["bending_damping"] - 1) < 0.2
    # A controller that knows the fitted rod stands the true one up.
    words = ["evaluate", "lqg", "--env", "PendulumSwingUpBase", "--seeds", "3", "--name", "true"]
    words += [f"--env-arg={name}={value}" for name, value in {"nodes": 25, **ROD}.items()]
    words += [f"--design=youngs_modulus={rod['parameters']['youngs_modulus']['value']}"]
    assert main([*words, "--runs", str(tmp_path)]) == 0
    with (tmp_path / "true" / "scores.csv").open() as stream:
        assert all(float(row["upright"]) > 0.9 for row in csv.DictReader(stream))
    # The report shows the model on the film: its line lies on the white markers.
    assert (tmp_path / "fit" / "report.html").read_text().count("data:image/png") == 4
    sheet = cv2.imread(str(tmp_path / "fit" / "on-film.png")).astype(int)
    line = (sheet[..., 2] > 200) & (sheet[..., 0] < 90)
    assert 1000 < line.sum() < 0.05 * line.size
    away = np.where(line, 0, 255).astype(np.uint8)
    distance = cv2.distanceTransform(away, cv2.DIST_L2, 5)
    white = sheet.min(axis=2) > 170
    # (Without the borders and the times in the corners of the two rows of pictures.)
    height = len(sheet) // 2
    inside = [slice(row * height + 40, (row + 1) * height - 5) for row in (0, 1)]
    near = np.concatenate([distance[rows, 10:470][white[rows, 10:470]] for rows in inside])
    assert len(near) > 50 and np.median(near) < 8.0


def test_the_camera_of_an_earlier_run_needs_no_calibration(film, tracked, tmp_path):
    words = ["track", str(film[0]), "--board", "10x7:7.34mm", "--out", str(tmp_path / "again")]
    assert main([*words, "--camera", str(tracked / "camera.yml"), "--count", "7"]) == 0
    again = lab.read_tracks(tmp_path / "again" / "tracks.csv")
    assert np.allclose(again.points, lab.read_tracks(tracked / "tracks.csv").points, atol=1e-9)


def test_a_film_without_a_board_is_refused_by_name(film, tmp_path):
    with pytest.raises(lab.CalibrationError, match="seen whole in 0 poses"):
        track(film[0], Board(12, 9, 7.34e-3))
    with pytest.raises(lab.FilmError, match="no film"):
        track(tmp_path / "missing.mp4", synthetic.BOARD)
    (tmp_path / "text.mp4").write_text("no film")
    with pytest.raises(lab.FilmError, match="no film that OpenCV reads"):
        track(tmp_path / "text.mp4", synthetic.BOARD)


def views(count, noise, alike=False, seed=0):
    """Corners of a board in random poses, or in one, seen by the thesis' camera."""
    random, board = np.random.default_rng(seed), synthetic.BOARD
    optics = synthetic.Optics(poses=count)
    found = []
    poses = synthetic.poses(optics, board, random)
    for rotation, translation in poses[:1] * count if alike else poses:
        corners = synthetic.project(synthetic.THESIS, board.corners, rotation, translation)
        found.append(corners + random.normal(0.0, noise, corners.shape))
    return found


def test_calibration_finds_the_camera_and_says_how_sure_it_is():
    camera = calibrate(views(20, 0.1), synthetic.BOARD, (1280, 720))
    off = (
        camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
        - synthetic.THESIS.matrix[[0, 1, 0, 1], [0, 1, 2, 2]]
    )
    assert (np.abs(off) < 4 * np.array(camera.deviations)).all() and camera.error < 0.2
    assert Camera.from_dict(camera.as_dict()).as_dict() == camera.as_dict()
    # Rays and pixels are each other's inverse up to the corners of the picture.
    edge = np.array([[0.0, 0.0], [1279.0, 719.0], [640.0, 360.0], [5.0, 700.0]])
    assert np.allclose(camera.pixels(camera.rays(edge)), edge, atol=1e-3)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (views(3, 0.1), "at least 6"),
        (views(12, 0.2, alike=True), "in 1 poses"),
        (views(12, 6.0), "is it the board"),
    ],
)
def test_pictures_that_tell_no_camera_are_refused(given, says):
    with pytest.raises(lab.CalibrationError, match=says):
        calibrate(given, synthetic.BOARD, (1280, 720))


def test_a_plane_is_measured_in_metres_from_any_side():
    optics, board = synthetic.Optics(), synthetic.BOARD
    rotation, translation = optics.pose
    laid = [
        synthetic.project(
            optics.camera, board.corners, rotation, translation + rotation @ [x, y, 0.0]
        )
        for x, y in synthetic.LAID
    ]
    square = np.array([[-0.2, 0.1, 0.0], [0.2, 0.1, 0.0], [0.2, -0.2, 0.0], [-0.2, -0.2, 0.0]])
    pixels = synthetic.project(optics.camera, square, rotation, translation)
    for places in (laid[:1], laid):
        plane = plane_of(places, board, optics.camera)
        assert np.allclose(plane.pixels(plane.metres(pixels)), pixels, atol=1e-6)
        sides = np.linalg.norm(np.diff(plane.metres(pixels), axis=0, append=np.nan), axis=1)[:3]
        assert np.allclose(sides, [0.4, 0.3, 0.4], rtol=1e-4)
        # As it is seen: x to the right, y up.
        assert plane.metres(pixels[1:2])[0, 0] > plane.metres(pixels[0:1])[0, 0]
        assert plane.metres(pixels[1:2])[0, 1] > plane.metres(pixels[2:3])[0, 1]
    # A plane that is 10 mm nearer shows the same pixels as a smaller square.
    near = plane.moved(0.01)
    shrunk = np.linalg.norm(near.metres(pixels[:1]) - near.metres(pixels[1:2])) / 0.4
    assert 0.97 < shrunk < 0.995
    with pytest.raises(lab.CalibrationError, match="off one plane"):
        tilted = synthetic.project(
            optics.camera, board.corners, rotation @ cv2.Rodrigues(np.array([0.0, 0.6, 0.0]))[0],
            translation,
        )  # fmt: skip
        plane_of([*laid, tilted], board, optics.camera)


def swinging(frames=60, count=9):
    """Places of markers on a bending rod in pixels, (frames, markers, 2)."""
    t = np.arange(frames)[:, None] / 30
    s = (np.arange(count - 1) + 0.5) / (count - 1)
    angle = 1.1 * np.cos(6 * t) + 0.9 * s * np.cos(15 * t)
    steps = 40 * np.stack([np.sin(angle), np.cos(angle)], axis=2)
    ways = np.cumsum(steps, axis=1)
    return np.concatenate([np.zeros((frames, 1, 2)), ways], axis=1) + np.array([600, 100])


def seen(places, lost=0.0, false=0.0, seed=0):
    """Spots in any order; some are lost, some are none."""
    random, found = np.random.default_rng(seed), []
    for frame in places:
        kept = frame[random.random(len(frame)) >= lost]
        if random.random() < false:
            kept = np.vstack([kept, random.uniform([200, 100], [1000, 500])])
        kept = random.permutation(kept)
        found.append(Spots(kept, np.full(len(kept), 90.0), np.full(len(kept), 200.0)))
    return found


@pytest.mark.parametrize(("lost", "false"), [(0.0, 0.0), (0.1, 0.0), (0.1, 0.2)])
def test_markers_keep_their_names_through_losses_and_false_spots(lost, false):
    places = swinging()
    followed = follow(seen(places, lost, false), 9)
    got = followed.places
    there = np.isfinite(got[..., 0])
    assert there.mean() > 0.9 * (1 - lost)
    # Never another marker's place in silence.
    assert np.abs(got - places)[there].max() < 1e-9


def test_the_order_is_that_along_the_rod_even_when_it_is_a_hook():
    angle = np.linspace(0, 1.5 * np.pi, 12)
    hook = np.cumsum(30 * np.column_stack([np.cos(angle), np.sin(angle)]), axis=0)
    shuffled = np.random.default_rng(2).permutation(12)
    way = shuffled[path(hook[shuffled])]
    assert list(way) in (list(range(12)), list(range(12))[::-1])


def test_centroids_are_good_to_a_fraction_of_a_pixel():
    """Discs drawn at sixteen times the resolution, on a background brighter on one side."""
    places = np.array([[30.3, 40.7], [61.9, 38.2], [90.45, 41.05]])
    large = np.full((80 * 16, 120 * 16), 40, np.uint8)
    large[: 40 * 16] = 50
    for x, y in places:
        centre = [round(16 * (v + 0.5) - 0.5) for v in (x, y)]
        cv2.circle(large, centre, 5 * 16, 230, -1)
    picture = cv2.resize(large, (120, 80), interpolation=cv2.INTER_AREA)
    noisy = np.clip(picture + np.random.default_rng(0).normal(0, 2, picture.shape), 0, 255)
    for light in (True, False):
        grey = noisy.astype(np.uint8) if light else 255 - noisy.astype(np.uint8)
        found = spots(grey, Look(light=light)).places
        assert np.abs(found[np.argsort(found[:, 0])] - places).max() < 0.15


def test_pictures_without_markers_are_refused_by_name():
    nothing = [Spots(np.zeros((0, 2)), np.zeros(0), np.zeros(0))] * 20
    with pytest.raises(lab.MarkersError, match="no markers were found"):
        follow(nothing)
    with pytest.raises(lab.MarkersError, match="most show 9"):
        follow(seen(swinging()), 12)


@pytest.mark.parametrize("text", ["10x7", "10x7:7.34", "axb:7mm", "1x7:7mm", "10x7:7km"])
def test_a_board_that_is_none_is_refused(text):
    with pytest.raises(ParameterError, match=r"10x7:7\.34mm"):
        Board.parse(text)
    assert Board.parse("10x7:7.34mm") == Board(10, 7, 7.34e-3)
