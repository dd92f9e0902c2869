"""A track, step by step."""

import threading

import numpy as np
import pytest

import baliza

ANCHORS = {"a": (0.0, 0.0, 2.4), "b": (9.0, 0.0, 2.4), "c": (9.0, 7.0, 2.4), "d": (0.0, 7.0, 2.4)}
HEIGHT_M = 1.2


def ranges(x, y, names="abcd"):
    return {name: float(np.linalg.norm(np.subtract(ANCHORS[name], (x, y, HEIGHT_M)))) for name in names}


def test_a_walk_at_constant_speed_has_its_position_and_velocity():
    track = baliza.Track(ANCHORS, dims=2, height_m=HEIGHT_M)
    for step in range(50):
        fix = track.step(step * 0.1, ranges(1.0 + 0.08 * step, 3.0))
    assert fix.reason is None and fix.used == 4
    np.testing.assert_allclose(fix.position_m[:2], [1.0 + 0.08 * 49, 3.0], atol=0.03)
    assert np.isnan(fix.position_m[2])
    np.testing.assert_allclose(fix.velocity_m_s[:2], [0.8, 0.0], atol=0.1)
    np.testing.assert_allclose(np.diag(fix.covariance_m2)[:2], fix.sigma_m[:2] ** 2, rtol=1e-5)
    assert fix.alternative_share is None and fix.alternative_apart_m is None


def test_single_ranges_start_and_move_a_track():
    track = baliza.Track(ANCHORS, dims=2, height_m=HEIGHT_M)
    fixes = [track.step(step * 0.05, ranges(4.0, 3.0, "abcd"[step % 4])) for step in range(12)]
    assert fixes[0].reason == "too-few-anchors" and np.isnan(fixes[0].position_m).all()
    assert fixes[-1].reason is None
    np.testing.assert_allclose(fixes[-1].position_m[:2], [4.0, 3.0], atol=0.05)


def test_its_steps_are_those_of_a_recording(room):
    recording = baliza.read(room)
    whole = recording.track()
    track = baliza.Track(recording.anchors_m)
    rows = recording.ranges()
    epochs = np.array(rows["epoch"])
    for index, name in enumerate(whole.epoch[:100]):
        of = epochs == name
        fix = track.step(whole.t_s[index], dict(zip(rows["anchor"][of].tolist(), rows["range_m"][of])))
        np.testing.assert_allclose(fix.position_m, whole.position_m[index], atol=1e-4)


def test_a_tag_that_jumps_may_be_at_two_places():
    track = baliza.Track(ANCHORS, dims=2, height_m=HEIGHT_M)
    for step in range(20):
        track.step(step * 0.1, ranges(1.0, 1.0))
    shares = [track.step(2.0 + step * 0.1, ranges(8.0, 6.0)) for step in range(5)]
    doubtful = [fix for fix in shares if fix.alternative_share is not None]
    assert doubtful, "the first round elsewhere proves nothing"
    assert all(0.0 <= fix.alternative_share <= 0.5 for fix in doubtful)
    assert all((fix.flag == "ambiguous") == (fix.alternative_share is not None) for fix in shares)
    # From one corner to the other: (7, 5).
    np.testing.assert_allclose(np.abs(doubtful[0].alternative_apart_m[:2]), [7.0, 5.0], atol=0.3)
    np.testing.assert_allclose(shares[-1].position_m[:2], [8.0, 6.0], atol=0.1)


def test_it_may_be_used_by_another_thread():
    track = baliza.Track(ANCHORS, dims=2, height_m=HEIGHT_M)
    fixes = []
    thread = threading.Thread(target=lambda: fixes.append(track.step(0.0, ranges(4.0, 3.0))))
    thread.start()
    thread.join()
    np.testing.assert_allclose(fixes[0].position_m[:2], [4.0, 3.0], atol=0.05)


def test_wrong_steps_are_errors():
    track = baliza.Track(ANCHORS)
    with pytest.raises(KeyError):
        track.step(0.0, {"e": 1.0})
    with pytest.raises(ValueError, match="finite"):
        track.step(0.0, {"a": float("nan")})
    with pytest.raises(ValueError, match="t_s"):
        track.step(float("inf"), ranges(1.0, 1.0))
    with pytest.raises(ValueError, match="nlos"):
        baliza.Track(ANCHORS, nlos="guess")
    assert track.step(1e300, {}).reason == "too-few-anchors"
    assert track.step(-1e300, {"a": 1e30}).reason is not None


def test_the_whole_recording_makes_a_better_track(room):
    recording = baliza.read(room)
    track, smooth = recording.track(), recording.track(smooth=True)
    assert (track.method, smooth.method) == ("track", "track-smooth")
    assert smooth.epoch == track.epoch
    rms = [np.sqrt(np.nanmean(found.error_m**2)) for found in (track, smooth)]
    assert rms[1] < 0.9 * rms[0]
