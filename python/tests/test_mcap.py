"""`baliza convert`, read by the Python package `mcap`."""

import json

import pandas
from mcap.reader import make_reader


def test_a_recording_is_read_by_another_library(room, program, tmp_path):
    file = tmp_path / "room.mcap"
    program("convert", room, "--out", file)
    ranges = pandas.read_csv(room / "ranges.csv").sort_values("t_s", kind="stable")
    with file.open("rb") as stream:
        rows = [
            (schema.name, message.log_time, json.loads(message.data))
            for schema, _, message in make_reader(stream).iter_messages(topics=["/ranges"])
        ]
    assert {name for name, _, _ in rows} == {"baliza.Range"}
    assert [row["range_m"] for _, _, row in rows] == ranges["range_m"].tolist()
    assert [row["anchor"] for _, _, row in rows] == ranges["anchor"].astype(str).tolist()
    assert [time for _, time, _ in rows] == [round(t_s * 1e9) for t_s in ranges["t_s"]]
    with file.open("rb") as stream:
        counts = make_reader(stream).get_summary()
        numbers = counts.statistics.channel_message_counts
        topics = {channel.topic: numbers[of] for of, channel in counts.channels.items()}
    assert topics["/anchors"] == len(pandas.read_csv(room / "anchors.csv"))
    assert topics["/truth/pose"] == len(pandas.read_csv(room / "truth.csv"))
