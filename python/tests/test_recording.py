"""Recordings as tables, and what is wrong with a file."""

import numpy as np
import pandas
import pytest

import baliza


def test_tables_are_those_of_the_files(room):
    recording = baliza.read(room)
    anchors, ranges, truth = (pandas.read_csv(room / f"{name}.csv") for name in ["anchors", "ranges", "truth"])
    assert recording.anchors == anchors["anchor"].astype(str).tolist()
    np.testing.assert_array_equal(recording.anchors_m, anchors[["x_m", "y_m", "z_m"]])
    found = recording.ranges_frame()
    assert found["epoch"].tolist() == ranges["epoch"].astype(str).tolist()
    assert found["anchor"].tolist() == ranges["anchor"].astype(str).tolist()
    for column in ["t_s", "range_m", "los"]:
        np.testing.assert_array_equal(found[column], ranges[column])
    np.testing.assert_array_equal(recording.truth_frame()[["x_m", "y_m", "z_m"]], truth[["x_m", "y_m", "z_m"]])


def test_a_wrong_file_is_told_with_its_line(tmp_path, room):
    (tmp_path / "anchors.csv").write_bytes((room / "anchors.csv").read_bytes())
    first = pandas.read_csv(room / "anchors.csv")["anchor"].iloc[0]
    (tmp_path / "ranges.csv").write_text(f"epoch,anchor,range_m\n0,{first},4.5\n1,{first},4.o\n")
    with pytest.raises(baliza.InputError, match=r'ranges\.csv:3: range_m "4\.o" is not a number') as wrong:
        baliza.read(tmp_path)
    assert (wrong.value.file, wrong.value.line) == (str(tmp_path / "ranges.csv"), 3)
    with pytest.raises(baliza.InputError, match="no folder") as wrong:
        baliza.read(tmp_path / "nowhere")
    assert wrong.value.line is None


def test_single_ranges_become_rounds(tmp_path):
    anchors = {"a": (0.0, 0.0), "b": (8.0, 0.0), "c": (8.0, 6.0), "d": (0.0, 6.0)}
    (tmp_path / "anchors.csv").write_text(
        "anchor,x_m,y_m\n" + "".join(f"{name},{x},{y}\n" for name, (x, y) in anchors.items())
    )
    rows = [
        f"{epoch},{epoch * 0.02},{name},{np.hypot(3 - x, 2 - y)}\n"
        for epoch, (name, (x, y)) in enumerate(list(anchors.items()) * 5)
    ]
    (tmp_path / "ranges.csv").write_text("epoch,t_s,anchor,range_m\n" + "".join(rows))
    recording = baliza.read(tmp_path)
    grouped = recording.solve("nls", dims=2)
    assert len(grouped) == 5
    np.testing.assert_allclose(grouped.position_m[:, :2], [[3, 2]] * 5, atol=1e-3)
    assert len(recording.solve("nls", dims=2, group_s=0)) == 20
    assert recording.truth() is None and recording.truth_frame() is None
    with pytest.raises(ValueError, match="no z_m"):
        recording.solve("nls")
    with pytest.raises(ValueError, match="no truth"):
        recording.solve("nls", dims=2, height_from_truth=True)
    with pytest.raises(ValueError, match="group_s"):
        recording.solve("nls", dims=2, group_s=-1)


def test_several_tags_are_solved_by_themselves(tmp_path):
    anchors = {"a": (0.0, 0.0), "b": (8.0, 0.0), "c": (8.0, 6.0), "d": (0.0, 6.0)}
    (tmp_path / "anchors.csv").write_text(
        "anchor,x_m,y_m\n" + "".join(f"{name},{x},{y}\n" for name, (x, y) in anchors.items())
    )
    tags = {"cart": (3.0, 2.0), "fork": (6.0, 5.0)}
    rows = [
        f"{epoch},{epoch * 0.1},{tag},{name},{np.hypot(at[0] - x, at[1] - y)}\n"
        for epoch in range(3)
        for tag, at in tags.items()
        for name, (x, y) in anchors.items()
    ]
    (tmp_path / "ranges.csv").write_text("epoch,t_s,tag,anchor,range_m\n" + "".join(rows))
    (tmp_path / "recording.toml").write_text("dims = 2\n")
    recording = baliza.read(tmp_path)
    assert recording.tags == ["cart", "fork"]
    for found in [recording.solve("nls"), recording.track()]:
        assert found.tag == ["cart"] * 3 + ["fork"] * 3
        np.testing.assert_allclose(found.position_m[:, :2], [(3, 2)] * 3 + [(6, 5)] * 3, atol=0.05)
        assert found.frame()["tag"].tolist() == found.tag
