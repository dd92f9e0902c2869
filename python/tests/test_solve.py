"""Positions by solvers: hand-made geometry, scipy and the program's own output as references."""

import io

import numpy as np
import pandas
import pytest
from scipy.optimize import least_squares

import baliza

CORNERS = np.array([[0.0, 0.0, 2.5], [8.0, 0.0, 0.5], [8.0, 6.0, 2.5], [0.0, 6.0, 0.5], [4.0, 0.0, 2.9]])
TAG = np.array([2.0, 3.0, 1.2])


def ranges_to(tag, anchors=CORNERS):
    return np.linalg.norm(anchors - tag, axis=1)


@pytest.mark.parametrize("method", [name for name in baliza.METHODS if name not in ("bounding-box", "nls-ccv")])
def test_exact_ranges_give_the_exact_position(method):
    found = baliza.solve(CORNERS, ranges_to(TAG), method)
    assert found.reason == [None]
    # Ranges and positions are f32; the robust method's prior of a common error moves its mean by millimetres.
    np.testing.assert_allclose(found.position_m[0], TAG, atol=0.02)


def test_nonlinear_least_squares_is_that_of_scipy():
    rng = np.random.default_rng(7)
    tags = rng.uniform([1, 1, 0.8], [7, 5, 1.6], size=(50, 3))
    ranges = np.array([ranges_to(tag) for tag in tags]) + rng.normal(0, 0.05, size=(50, 5))
    found = baliza.solve(CORNERS, ranges, "nls")
    for row in range(50):
        best = least_squares(lambda at: ranges_to(at) - ranges[row], tags[row], xtol=1e-12, ftol=1e-12)
        np.testing.assert_allclose(found.position_m[row], best.x, atol=2e-3)
        # Its covariance is H⁻¹ M H⁻¹ with H = Σ uuᵀ, M = Σ (N ⁄ (N − D) e² + σ²) uuᵀ and σ = 0.1 m.
        units = (best.x - CORNERS) / ranges_to(best.x)[:, None]
        inverse = np.linalg.inv(units.T @ units)
        squares = 5 / 2 * best.fun**2 + 0.1**2
        expected = inverse @ (units.T * squares @ units) @ inverse
        np.testing.assert_allclose(found.covariance_m2[row], expected, rtol=0.02, atol=1e-5)
        np.testing.assert_allclose(found.sigma_m[row] ** 2, np.diag(found.covariance_m2[row]), rtol=1e-5)


@pytest.mark.parametrize("method", ["robust", "b-wls", "bb-nls"])
@pytest.mark.parametrize("space", [{}, {"dims": 2, "height_m": 1.2}, {"dims": 2, "height_from_truth": True}])
def test_a_recording_has_the_positions_of_the_program(room, program, method, space):
    flags = [word for key, value in space.items() for word in flag(key, value)]
    files = ["--anchors", room / "anchors.csv", "--ranges", room / "ranges.csv", "--truth", room / "truth.csv"]
    expected = pandas.read_csv(io.StringIO(program("solve", *files, "--method", method, *flags)))
    check(baliza.read(room).solve(method, **space).frame(), expected)


def test_a_track_has_the_positions_of_the_program(room, program):
    files = ["--anchors", room / "anchors.csv", "--ranges", room / "ranges.csv", "--truth", room / "truth.csv"]
    expected = pandas.read_csv(io.StringIO(program("track", *files, "--dims", "2", "--height-m", "1.2")))
    check(baliza.read(room).track(dims=2, height_m=1.2).frame(), expected)


@pytest.mark.parametrize("command", ["solve", "track"])
def test_a_frame_has_the_other_of_two_places(tmp_path, program, command):
    # Anchors nearly on a line: (4, 3) and (4, -3) are as far from them.
    (tmp_path / "anchors.csv").write_text("anchor,x_m,y_m,z_m\na,0,0,1\nb,5,0.05,1\nc,10,0,1\n")
    rows = [f"0,0,{name},{np.hypot(4 - x, 3 - y)}\n" for name, x, y in [("a", 0, 0), ("b", 5, 0.05), ("c", 10, 0)]]
    (tmp_path / "ranges.csv").write_text("epoch,t_s,anchor,range_m\n" + "".join(rows))
    expected = pandas.read_csv(io.StringIO(program(command, tmp_path, "--dims", "2", "--height-m", "1")))
    recording = baliza.read(tmp_path)
    found = getattr(recording, command)(dims=2, height_m=1.0)
    check(found.frame(), expected)
    assert found.flag == expected["flag"].tolist() == ["ambiguous"]
    both = sorted([found.frame()["y_m"][0], found.frame()["alt_y_m"][0]])
    np.testing.assert_allclose(both, [-3.0, 3.0], atol=0.2)


def flag(key, value):
    name = "--" + key.replace("_", "-")
    return [name] if value is True else [name, str(value)]


def check(found, expected):
    # The program's files also have the height that was given; the frames do not.
    if found["z_m"].isna().all():
        expected["z_m"] = np.nan
    assert list(found.columns) == list(expected.columns)
    assert found["epoch"].tolist() == [str(epoch) for epoch in expected["epoch"]]
    for column in {"reason", "flag"} & set(expected.columns):
        texts = [frame[column].astype(object).fillna("").tolist() for frame in (found, expected)]
        assert texts[0] == texts[1], column
    used = found["used"].where(found["x_m"].notna())
    np.testing.assert_array_equal(used, expected["used"])
    for column in [name for name in expected.columns if name.split("_")[-1] in ("m", "m2", "s")]:
        # The file has four decimals.
        np.testing.assert_allclose(found[column], expected[column], atol=0.6e-4, err_msg=column)


def test_a_plane_needs_no_heights_and_has_none():
    found = baliza.solve(CORNERS[:4, :2], np.linalg.norm(CORNERS[:4, :2] - TAG[:2], axis=1), "nls", dims=2)
    np.testing.assert_allclose(found.position_m[0, :2], TAG[:2], atol=1e-3)
    assert np.isnan(found.position_m[0, 2]) and np.isnan(found.sigma_m[0, 2])
    assert np.isnan(found.covariance_m2[0, 2]).all() and np.isfinite(found.covariance_m2[0, :2, :2]).all()


def test_a_missing_range_is_nan_and_too_few_have_a_reason():
    ranges = np.array([ranges_to(TAG), ranges_to(TAG)])
    ranges[0, 0] = np.nan
    ranges[1, :2] = np.nan
    found = baliza.solve(CORNERS, ranges, "nls")
    assert found.reason == [None, "too-few-anchors"]
    assert found.used.tolist() == [4, 0]
    assert np.isnan(found.position_m[1]).all() and np.isnan(found.covariance_m2[1]).all()


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (dict(method="nearest"), "robust"),
        (dict(dims=4), "neither 2 nor 3"),
        (dict(height_m=1.0), "only with dims=2"),
        (dict(side="left"), "left"),
        (dict(dims=2, height_m=float("nan")), "finite"),
        (dict(area_m=(0, 0, 0, 5)), "area_m"),
        (dict(ranges_m=[1.0, 2.0]), "2 columns for 5 anchors"),
        (dict(ranges_m=[[np.inf] * 5]), "infinite"),
        (dict(ranges_m=np.zeros((2, 2, 5))), "3 dimensions"),
        (dict(ranges_m="far"), "far"),
        (dict(anchors_m=[[0, 0, np.nan]] * 5), "finite"),
        (dict(anchors_m=[[0, 0]] * 5), "heights"),
        (dict(anchors_m=[[0, 0, 0, 0]] * 5), "shape"),
        (dict(anchors_m=np.zeros((0, 3)), ranges_m=np.zeros((1, 0))), "shape"),
        (dict(los=[[1.0]]), "shape of ranges_m"),
    ],
)
def test_wrong_arguments_are_value_errors(arguments, what):
    with pytest.raises(ValueError, match=what):
        baliza.solve(**{"anchors_m": CORNERS, "ranges_m": ranges_to(TAG), **arguments})
