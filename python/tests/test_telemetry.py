"""Telemetry as dictionaries."""

import io
import json

import pytest

import baliza


def frame(body: bytes) -> bytes:
    """Schema, body and CRC-16/IBM-3740 as one COBS frame: docs/reference/wire-format.md."""
    plain = bytes([1]) + body
    crc = 0xFFFF
    for byte in plain:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021) & 0xFFFF if crc & 0x8000 else crc << 1
    plain += crc.to_bytes(2, "little")
    return b"".join(bytes([len(run) + 1]) + run for run in plain.split(b"\0")) + b"\0"


def varint(number: int) -> bytes:
    out = b""
    while number > 0x7F:
        out += bytes([number & 0x7F | 0x80])
        number >>= 7
    return out + bytes([number])


# A fix: number 1, 2 s, round 7, 8.5 ms old, 4 anchors asked, without a position because of too few anchors, by a track.
FIX = frame(bytes([1]) + varint(2_000_000) + varint(7) + varint(8500) + bytes([4, 1, 0, 1]))


def test_messages_are_those_of_the_wire_format():
    (message,) = baliza.decode(FIX)
    assert message["type"] == "fix" and message["t_s"] == 2.0 and message["round"] == 7
    assert message["reason"] == "too-few-anchors" and message["x_m"] is None and message["solver"] == "track"


def test_bytes_files_and_folders_are_the_same(tmp_path, program):
    stream = FIX * 3
    (tmp_path / "telemetry.bin").write_bytes(stream)
    expected = [json.loads(line) for line in program("decode", tmp_path / "telemetry.bin").splitlines()]
    assert len(expected) == 3
    for source in [stream, bytearray(stream), tmp_path / "telemetry.bin", tmp_path, io.BytesIO(stream)]:
        assert list(baliza.decode(source)) == expected
    with pytest.raises(FileNotFoundError):
        list(baliza.decode(tmp_path / "nowhere"))


def test_pieces_and_damage_are_counted():
    decoder = baliza.Decoder()
    assert decoder.feed(FIX[:5]) == []
    assert [message["type"] for message in decoder.feed(FIX[5:])] == ["fix"]
    broken = bytes([FIX[0], FIX[1], FIX[2] ^ 0x40]) + FIX[3:]
    assert decoder.feed(broken) == []
    summary = decoder.summary()
    assert summary["frames"]["fix"] == 1 and summary["malformed"]["total"] == 1
