"""What a running station sends to maps, read by programs of others: NMEA by pynmea2, GPX by gpxpy.

Arguments: the station's URL, the address of the tag's NMEA, the tag. The site is that of the simulation.
"""

import json
import socket
import sys
import time
import urllib.request

import gpxpy
import pynmea2

ORIGIN = {"latitude_deg": 40.5, "longitude_deg": -3.75, "y_azimuth_deg": 0, "height_m": 650, "geoid_separation_m": 51}
# Degrees of 50 m, more than the simulated room is wide.
NEAR = 50 / 111_000


def ask(url, path, body=None):
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url + path, data, {"Content-Type": "application/json"})
    request.method = "GET" if body is None else "PUT"
    with urllib.request.urlopen(request, timeout=60) as answer:
        return answer.read().decode()


def is_near(latitude, longitude):
    return abs(latitude - 40.5) < NEAR and abs(longitude + 3.75) < NEAR / 0.76


def nmea(address):
    """GGA, RMC and GST of two positions that follow each other."""
    host, port = address.rsplit(":", 1)
    with socket.create_connection((host, int(port)), timeout=60) as connection:
        lines = connection.makefile("r", encoding="ascii", newline="\r\n")
        seen = []
        while len(seen) < 2:
            gga = pynmea2.parse(lines.readline().strip(), check=True)
            if gga.sentence_type != "GGA" or gga.gps_qual != 1:
                continue
            rmc, gst = (pynmea2.parse(lines.readline().strip(), check=True) for _ in range(2))
            assert (rmc.sentence_type, rmc.status, gst.sentence_type) == ("RMC", "A", "GST"), (rmc, gst)
            assert gga.timestamp == rmc.timestamp == gst.timestamp
            assert abs(time.time() - rmc.datetime.timestamp()) < 60, rmc
            assert (gga.latitude, gga.longitude) == (rmc.latitude, rmc.longitude)
            assert is_near(gga.latitude, gga.longitude), gga
            assert 640 < gga.altitude < 660 and float(gga.geo_sep) == 51, gga
            assert 3 <= int(gga.num_sats) <= 8 and gga.horizontal_dil == "", gga
            assert 0 < gst.std_dev_latitude < 5 and 0 < gst.std_dev_longitude < 5, gst
            seen.append(rmc.datetime)
        assert seen[0] < seen[1], seen


def gpx(url, tag):
    """The tag's history, as the JSON route has it."""
    path = f"/api/v1/tags/{tag}/positions"
    newest = json.loads(ask(url, f"{path}?site=simulation&limit=1"))[0]["t"]
    rows = json.loads(ask(url, f"{path}?site=simulation&to={newest}"))
    [track] = gpxpy.parse(ask(url, f"{path}.gpx?site=simulation&to={newest}")).tracks
    points = [point for segment in track.segments for point in segment.points]
    assert track.name == tag and len(points) == len(rows) > 0, (track.name, len(points), len(rows))
    assert all(is_near(point.latitude, point.longitude) and 640 < point.elevation < 660 for point in points)
    assert [point.time for point in points] == sorted(point.time for point in points)


url, address, tag = sys.argv[1:]
ask(url, "/api/v1/sites/simulation/geographic-origin", ORIGIN)
nmea(address)
gpx(url, tag)
